"""File columns for the keys of a study's JSON columns.

In the table ``steps`` the JSON column holds the recorded parts of the world's ``info``; in ``episodes`` and ``trials``
it holds the labels of the stimuli. Table files have one column for each key. The study's own table keeps a single JSON
column, so that every study has the same tables.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import duckdb
import pyarrow as pa

from minihuman.dataset.table_columns import TableColumn, TableColumnType
from minihuman.experiment.plan.session_plan import name_label_column


@dataclass(frozen=True, slots=True)
class JsonColumn:
    """A JSON column whose keys become columns of a table's files."""

    name: str
    meaning: str  # of a key's column; {!r} stands for the key


INFO = JsonColumn("info", "The world's info[{!r}] after the step; empty where it did not say.")
LABELS = JsonColumn("labels", "The label {!r} of the trial's stimulus; empty where it has none.")
LABELLED_TABLES = ("episodes", "trials")
_JSON_COLUMNS = {"steps": INFO, **dict.fromkeys(LABELLED_TABLES, LABELS)}
_KINDS: Mapping[frozenset[str], TableColumnType] = {  # by DuckDB's types of the values, beside NULL
    frozenset({"BOOLEAN"}): "boolean",
    frozenset({"BIGINT", "UBIGINT", "DOUBLE"}): "number",
}
_ARROW_TYPES = {"boolean": pa.bool_(), "number": pa.float64(), "text": pa.string()}


def list_info_columns(connection: duckdb.DuckDBPyConnection, table: str) -> dict[str, TableColumn]:
    """Return a file column for each key in a table's JSON column, by key; {} if the table has no JSON column.

    The column's type is boolean or number if all values of the key are, else text. The keys are read from the table
    of that name in the connection's schema "kept".
    """
    column = _JSON_COLUMNS.get(table)
    if column is None:
        return {}
    types_by_key = connection.execute(
        f"SELECT key, list(DISTINCT json_type({column.name}, '$.\"' || key || '\"')) "
        f"FROM (SELECT {column.name}, unnest(json_keys({column.name})) AS key FROM kept.{table} "
        f"WHERE {column.name} <> '') GROUP BY key ORDER BY key"
    ).fetchall()
    name = name_label_column if column is LABELS else "info_{}".format
    return {
        key: TableColumn(name(key), _choose_kind(types), "", column.meaning.format(key)) for key, types in types_by_key
    }


def _choose_kind(types: Sequence[str]) -> TableColumnType:
    """Return the type of a key's column, given DuckDB's types of its values; "text" if mixed or all missing."""
    types_present = {name for name in types if name != "NULL"}
    if types_present:
        for accepted_types, kind in _KINDS.items():
            if types_present <= accepted_types:
                return kind
    return "text"


def build_info_fields(columns: Mapping[str, TableColumn]) -> list[pa.Field]:
    """Build the Arrow fields of the columns for JSON keys."""
    return [pa.field(column.name, _ARROW_TYPES[column.kind]) for column in columns.values()]


def add_info_columns(rows: pa.Table, table: str, columns: Mapping[str, TableColumn]) -> pa.Table:
    """Return some rows of a table with the columns for JSON keys appended.

    Args:
        rows: the rows, with the table's JSON column.
        table: the table's name.
        columns: the columns to append, by JSON key, as ``list_info_columns`` returns them.
    """
    if not columns:
        return rows
    objects = [_parse_object(text) for text in rows.column(_JSON_COLUMNS[table].name).to_pylist()]
    for (key, column), field in zip(columns.items(), build_info_fields(columns), strict=True):
        values = [_convert_to_kind(content.get(key), column.kind) for content in objects]
        rows = rows.append_column(field, pa.array(values, field.type))
    return rows


def _parse_object(text: str | None) -> dict[str, Any]:
    """Parse the JSON object of a row; an empty cell is an empty object."""
    if not text:
        return {}
    content: dict[str, Any] = json.loads(text)
    return content


def _convert_to_kind(value: Any, kind: str) -> Any:
    """Convert a JSON value to a column's kind; a text column holds other values as JSON."""
    if value is None or kind == "boolean":
        return value
    if kind == "number":
        return float(value)
    if isinstance(value, str):
        return value
    return json.dumps(value)
