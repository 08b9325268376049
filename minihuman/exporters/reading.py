"""How programs read the exported CSV files without changing a cell: the lines of an export's README.

CSV has no types. Programs that guess them lose the zeros of "007" and "1.10", take "NA" for a missing answer and round
64-bit seeds; `dictionary.json` says which columns are texts and which numbers exceed what a double holds.
"""

_PANDAS = """\
```python
import json
import pandas
with open("{data_dictionary}", encoding="utf-8") as file:
    columns = json.load(file)["{table}"]
texts = {{name: "string" for name, column in columns.items() if column["type"] in ("text", "key")}}
frame = pandas.read_csv("{file}", dtype=texts, keep_default_na=False, na_values=[""])
```"""
_POLARS = """\
```python
import json
import polars
with open("{data_dictionary}", encoding="utf-8") as file:
    columns = json.load(file)["{table}"]
texts = {{name: polars.String for name, column in columns.items() if column["type"] in ("text", "key")}}
frame = polars.read_csv("{file}", schema_overrides=texts, infer_schema_length=None)
```"""
_R = """\
```r
columns <- jsonlite::fromJSON("{data_dictionary}")${table}
is_text <- sapply(columns, function(column) column$type %in% c("text", "key") || !is.null(column$exceeds_double))
texts <- names(columns)[is_text]
frame <- read.csv("{file}", na.strings = "", colClasses = setNames(rep("character", length(texts)), texts))
```"""
_JAVASCRIPT = """\
```js
import {{ readFileSync }} from "node:fs";
import Papa from "papaparse";
const columns = JSON.parse(readFileSync("{data_dictionary}", "utf8")).{table};
function readCell(cell, name) {{
  const column = columns[name];
  if (cell === "") return null;
  if (column.type === "boolean") return cell === "TRUE";
  if (column.exceeds_double) return BigInt(cell);
  return ["integer", "number"].includes(column.type) ? Number(cell) : cell;
}}
const file = readFileSync("{file}", "utf8");
const options = {{ header: true, skipEmptyLines: true, transform: readCell }};
const rows = Papa.parse(file, options).data;
```"""

_OTHER_PROGRAMS = (
    "In Excel, do not open the files by a double click: choose Data, From Text/CSV, and as Data Type Detection",
    '"Do not detect data types".',
    "",
)
GUARD_LINES = (
    "A text that a spreadsheet would run as a formula has an apostrophe before its `=`, `+`, `-` or `@` that was not",
    "typed. `minihuman.dataset.table_types.unguard_text` takes it off, as does replacing the regular expression",
    r"`(^|[;\t\r\n])'('*[=+\-@])` by its two groups.",
    "",
)


def describe_reading(table: str, file: str, *, data_dictionary: str = "dictionary.json") -> tuple[str, ...]:
    """Return the lines of a README about reading the exported CSV files.

    Args:
        table: the name of the table that is the example.
        file: the path of its file in the export.
        data_dictionary: the path of the file with the types and meanings of the columns.
    """
    names = {"table": table, "file": file, "data_dictionary": data_dictionary}
    return (
        "## How to read the files",
        "",
        'Texts such as "007", "1.10" and "NA" stay what they are if types are not guessed. In pandas:',
        "",
        _PANDAS.format(**names),
        "",
        "In Polars:",
        "",
        _POLARS.format(**names),
        "",
        "In R, which reads 64-bit numbers as text, too, as it has none:",
        "",
        _R.format(**names),
        "",
        "In JavaScript, with Papa Parse, where 64-bit numbers are `BigInt`:",
        "",
        _JAVASCRIPT.format(**names),
        "",
        *_OTHER_PROGRAMS,
        *GUARD_LINES,
    )
