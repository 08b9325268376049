"""SQL over a study's tables: which tables a query reads, whether it requires the worlds, and how its result prints."""

import io
import re
from collections.abc import Iterator, Mapping, Set
from typing import Any

import duckdb
import msgspec
import pyarrow as pa
import pyarrow.csv

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.caches import CACHE_SETTINGS
from minihuman.dataset.column_aliases import use_current_columns
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_types import guard_texts

QUERY_SETTINGS = {  # SQL reads the tables: no files, no network, no variables of this program
    **CACHE_SETTINGS,
    "threads": "2",
    "enable_external_access": "false",
    "python_enable_replacements": "false",
    "lock_configuration": "true",
}


def find_queried_tables(sql: str) -> frozenset[str]:
    """Return the names of the tables that a query reads; all tables if the query alone does not show it."""
    try:
        with duckdb.connect(config=dict(QUERY_SETTINGS)) as parser:
            names = frozenset(name.lower() for name in parser.get_table_names(sql))
    except duckdb.Error:
        return frozenset(TABLES)
    is_computed = "query" in sql.lower()  # the functions query() and query_table() take names that are computed
    if is_computed:
        return frozenset(TABLES)
    return names & TABLES.keys()


def mentions_person_table(sql: str) -> bool:
    """Return whether the name of the person table occurs as a word in a query."""
    return re.search(rf"\b{PERSON_TABLE}\b", sql, re.IGNORECASE) is not None


def needs_shortest_paths(sql: str) -> bool:
    """Return whether a query may read a column that requires the worlds themselves; True if that is unclear."""
    names = find_queried_tables(sql)
    if not any(has_world_columns(name) for name in names):
        return False
    if "query" in sql.lower():  # query() runs SQL that is given as a text
        return True
    try:
        with duckdb.connect(config=dict(QUERY_SETTINGS)) as parser:
            ((tree,),) = parser.execute("SELECT json_serialize_sql(?::VARCHAR)", (use_current_columns(sql),)).fetchall()
    except duckdb.Error:
        return True
    nodes = list(_walk_objects(msgspec.json.decode(tree)))
    names_of_whole_rows = set()  # the name or alias of a table stands for its whole row where a column is expected
    for node in nodes:
        for key in ("alias", "table_name"):
            if node.get(key):
                names_of_whole_rows.add(str(node[key]).lower())
    return any(_may_read_columns(node, COLUMNS_NEEDING_WORLD | names_of_whole_rows) for node in nodes)


def _may_read_columns(node: Mapping[str, Any], columns: Set[str]) -> bool:
    """Return whether a node of a query's syntax tree names one of the columns, or may read it implicitly."""
    if node.get("error") or node.get("class") in ("STAR", "POSITIONAL_REFERENCE") or node.get("type") == "PIVOT":
        return True
    column_names = node.get("column_names")
    return isinstance(column_names, list) and column_names[-1].lower() in columns


def _walk_objects(tree: Any) -> Iterator[dict[str, Any]]:
    """Yield every object in a JSON document."""
    if isinstance(tree, dict):
        yield tree
        for part in tree.values():
            yield from _walk_objects(part)
    elif isinstance(tree, list):
        for part in tree:
            yield from _walk_objects(part)


def has_world_columns(name: str) -> bool:
    """Return whether a table has columns that require the worlds themselves."""
    return any(column.name in COLUMNS_NEEDING_WORLD for column in TABLES.get(name, ()))


MAX_SHOWN_ROWS = 100  # in the terminal; longer results are for a file


def format_result_csv(answer: pa.Table) -> str:
    """Format all rows as CSV with a header of column names; texts are guarded as in an export."""
    for index, field in enumerate(answer.schema):
        if pa.types.is_string(field.type):
            answer = answer.set_column(index, field, guard_texts(answer.column(index)))
    file = io.BytesIO()
    pa.csv.write_csv(answer, file)
    return file.getvalue().decode()


def format_result_lines(answer: pa.Table) -> Iterator[str]:
    """Yield the header and the first rows in aligned columns; a missing value is shown as a dot."""
    rows = [list(map(_format_cell, row.values())) for row in answer.slice(0, MAX_SHOWN_ROWS).to_pylist()]
    widths = [max(map(len, column)) for column in zip(answer.column_names, *rows, strict=True)]
    alignments = [_find_alignment(kind) for kind in answer.schema.types]
    for row in (answer.column_names, *rows):
        cells = zip(row, alignments, widths, strict=True)
        yield "  ".join(f"{cell:{alignment}{width}}" for cell, alignment, width in cells).rstrip()
    if answer.num_rows > MAX_SHOWN_ROWS:
        yield f"({answer.num_rows} rows, {MAX_SHOWN_ROWS} of them shown; --csv prints all)"


def _find_alignment(kind: pa.DataType) -> str:
    """Return the alignment of a column in a format specification: numbers to the right, texts to the left."""
    is_number = pa.types.is_integer(kind) or pa.types.is_floating(kind)
    return ">" if is_number else "<"


def _format_cell(cell: object) -> str:
    if cell is None:
        return "."
    if isinstance(cell, float):
        return f"{cell:.6g}"
    return str(cell)
