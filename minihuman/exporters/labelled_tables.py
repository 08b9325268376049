"""Write tables as SPSS (`.sav`) and Stata (`.dta`) files, whose numbers are doubles and whose columns have labels.

What these formats cannot hold as it is, is converted and named: whole numbers that a double would round become texts,
times become dates of the format in UTC, and columns whose names are too long or mean something to the program are
renamed.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, Literal

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.info_columns import LABELLED_TABLES, add_info_columns, list_info_columns
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.table_catalogue import EVERY_MOMENT, TABLE_VERSION, TABLES
from minihuman.dataset.table_columns import TableColumn, is_time
from minihuman.dataset.table_types import parse_times
from minihuman.dataset.tables import Tables
from minihuman.dataset.wide_integers import MAX_EXACT_INTEGER, WIDE_INTEGERS

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

LabelledFormat = Literal["sav", "dta"]
_LABEL_CHARACTERS = {"sav": 256, "dta": 80}  # of a column's label
_COUNTER_CHARACTERS = 4  # that make a shortened name unique: "_" and a number
_NAME_CHARACTERS = {"sav": 64, "dta": 32}
_SHORT_TEXT_BYTES = 2045  # of Stata's str; a column with a longer text is a strL
_LONG_TEXT_NOTE = (
    f"has texts of more than {_SHORT_TEXT_BYTES} bytes (strL), which R's haven 2.5 reads as empty; "
    "in R, take it from another format"
)
_TEXT_BYTES = {"sav": 32_767, "dta": 2_000_000}  # of a cell
_RESERVED = {
    "sav": frozenset({"all", "and", "by", "eq", "ge", "gt", "le", "lt", "ne", "not", "or", "to", "with"}),
    "dta": frozenset({"byte", "double", "float", "if", "in", "int", "long", "strl", "using", "with"}),
}


def write_labelled_tables(tables: Tables, out: Path, kind: LabelledFormat) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write each table that has rows, except those with a row per moment; return the files and notes on conversions."""
    paths: list[Path] = []
    notes: list[str] = []
    for name, columns, rows in _list_tables(tables):
        paths.append(out / f"{name}.{kind}")
        notes += _write_table(paths[-1], name, columns, rows, kind)
    return tuple(paths), tuple(notes)


def _list_tables(tables: Tables) -> Iterator[tuple[str, list[TableColumn], "pa.Table"]]:
    """Yield the name, the columns and the rows of each table to write."""
    for name, columns in TABLES.items():
        if name in EVERY_MOMENT or not tables.count(name):
            continue
        written_columns = [column for column in columns if column.name not in COLUMNS_NEEDING_WORLD]
        rows = tables.arrow(name, [column.name for column in written_columns])
        if name in LABELLED_TABLES:
            label_columns = list_info_columns(tables.store.tables.connection, name)
            rows = add_info_columns(rows, name, label_columns)
            written_columns += label_columns.values()
        yield name, written_columns, rows
    if tables.people is not None and tables.people.rows.num_rows:
        yield PERSON_TABLE, list(tables.people.columns), tables.people.rows


def _write_table(
    path: Path, table: str, columns: Sequence[TableColumn], rows: "pa.Table", kind: LabelledFormat
) -> Iterator[str]:
    """Write one table; yield a line about each column that was converted or renamed."""
    import pandas as pd  # tables are read without it
    import pyreadstat  # in no other format

    names = _fit_names([column.name for column in columns], kind)
    cells: dict[str, Any] = {}
    column_labels: dict[str, str] = {}
    value_labels: dict[str, dict[Any, str]] = {}
    for column, name in zip(columns, names, strict=True):
        column_labels[name] = _build_label(column, kind)
        series, labels, note = _convert_column(column, rows.column(column.name), kind)
        cells[name] = series
        if labels:
            value_labels[name] = labels
        if name != column.name:
            yield f"{table}: the column {column.name} is named {name}, as the format cannot name it so"
        if note:
            yield f"{table}: {column.name} {note}"
    frame = pd.DataFrame(cells)
    options: dict[str, Any] = {
        "column_labels": column_labels,
        "variable_value_labels": value_labels,
        "file_label": f"{table}, table version {TABLE_VERSION}",
    }
    if kind == "sav":
        pyreadstat.write_sav(frame, str(path), **options)
    else:
        pyreadstat.write_dta(frame, str(path), **options)


def _convert_column(
    column: TableColumn, cells: "pa.ChunkedArray", kind: LabelledFormat
) -> tuple["pd.Series[Any]", dict[Any, str], str]:
    """Convert a column for the format; return its cells, the labels of its values, and what was changed, or ""."""
    import pandas as pd

    if column.kind == "boolean":
        return cells.to_pandas().astype("float64"), {0.0: "no", 1.0: "yes"}, ""
    if column.kind == "integer":
        series, note = _convert_integers(column, cells)
        return series, {}, note
    if column.kind == "number":
        return cells.to_pandas(), {}, ""
    if is_time(column):
        times = parse_times(cells).to_pandas()
        return times.dt.tz_convert(None).dt.floor("ms"), {}, "is in UTC, to the millisecond, which a double still holds"
    texts = cells.to_pandas().fillna("").astype(object)
    if column.levels and kind == "dta":  # Stata labels nothing but numbers
        codes = {level: float(number) for number, (level, _) in enumerate(column.levels, 1)}
        labels = {codes[level]: level for level, _ in column.levels}
        return pd.Series([codes.get(text) for text in texts], dtype="float64"), labels, "is coded by number, labelled"
    texts, note = _cut_texts(texts, kind)
    return texts, dict(column.levels), note


def _convert_integers(column: TableColumn, cells: "pa.ChunkedArray") -> tuple["pd.Series[Any]", str]:
    """Convert a column of whole numbers to doubles, or to texts if a double would round one of them.

    Return the column, and a note if it has texts, else "".
    """
    import pandas as pd

    numbers = cells.to_pylist()
    is_wide = column.name in WIDE_INTEGERS
    if is_wide or any(number is not None and abs(number) > MAX_EXACT_INTEGER for number in numbers):
        texts = ["" if number is None else str(number) for number in numbers]
        return pd.Series(texts, dtype=object), "is text, as a number of this format would be rounded beyond 2^53"
    return pd.Series(numbers, dtype="float64"), ""


def _cut_texts(texts: "pd.Series[Any]", kind: LabelledFormat) -> tuple["pd.Series[Any]", str]:
    """Cut texts to the format's limit; return them, and a note on cut texts or on Stata's long texts, else ""."""
    limit = _TEXT_BYTES[kind]
    encoded = [text.encode() for text in texts]
    n_long = sum(len(content) > limit for content in encoded)
    if not n_long:
        has_long = kind == "dta" and any(len(content) > _SHORT_TEXT_BYTES for content in encoded)
        return texts, _LONG_TEXT_NOTE if has_long else ""
    fitting = [content[:limit].decode(errors="ignore") for content in encoded]
    series_class = type(texts)  # of pandas, which this module does not import at the top
    return series_class(fitting, dtype=object), f"is cut to {limit} bytes in {n_long} rows, which is the format's limit"


def _fit_names(names: Sequence[str], kind: LabelledFormat) -> list[str]:
    """Return a valid name for each column, unique without regard to case."""
    limit = _NAME_CHARACTERS[kind]
    fitted: list[str] = []
    taken = {name.lower() for name in names if len(name) <= limit}
    seen: set[str] = set()
    for name in names:
        candidate = name
        if name.lower() in _RESERVED[kind]:
            candidate = f"{name}_"
        number = 1
        is_valid = len(candidate) <= limit and candidate.lower() not in seen
        while not is_valid:
            number += 1
            candidate = f"{name[: limit - _COUNTER_CHARACTERS]}_{number}"
            is_valid = candidate.lower() not in seen | taken
        seen.add(candidate.lower())
        fitted.append(candidate)
    return fitted


def _build_label(column: TableColumn, kind: LabelledFormat) -> str:
    """Return a column's label: its meaning and unit, shortened to what the format allows."""
    text = column.meaning
    if column.unit:
        text = f"{column.meaning} ({column.unit})"
    return shorten(text, _LABEL_CHARACTERS[kind], placeholder=" ...")
