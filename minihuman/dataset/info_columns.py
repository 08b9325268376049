"""Columns of the files of the table ``steps`` for what a study keeps of its worlds' ``info``: one for each key.

In the study's table itself it is one column of JSON, as every study has the same tables.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import duckdb
import pyarrow as pa

from minihuman.dataset.table_columns import TableColumn, TableColumnType

INFO_TABLE, INFO_COLUMN = "steps", "info"
_MEANING = "The world's info[{!r}] after the step; empty where it did not say."
_KINDS: Mapping[frozenset[str], TableColumnType] = {  # by DuckDB's types of the values, beside NULL
    frozenset({"BOOLEAN"}): "boolean",
    frozenset({"BIGINT", "UBIGINT", "DOUBLE"}): "number",
}
_ARROW_TYPES = {"boolean": pa.bool_(), "number": pa.float64(), "text": pa.string()}


def list_info_columns(connection: duckdb.DuckDBPyConnection, table: str) -> dict[str, TableColumn]:
    """List the columns of a table's kept keys, by key: boolean or number where all values are, else text."""
    if table != INFO_TABLE:
        return {}
    found = connection.execute(
        "SELECT key, list(DISTINCT json_type(info, '$.\"' || key || '\"')) "
        f"FROM (SELECT info, unnest(json_keys(info)) AS key FROM kept.{INFO_TABLE} WHERE {INFO_COLUMN} <> '') "
        "GROUP BY key ORDER BY key"
    ).fetchall()
    return {
        key: TableColumn(f"{INFO_COLUMN}_{key}", _find_kind(types), "", _MEANING.format(key)) for key, types in found
    }


def _find_kind(types: Sequence[str]) -> TableColumnType:
    said = {name for name in types if name != "NULL"}
    return next((kind for names, kind in _KINDS.items() if said and said <= names), "text")


def build_info_schema(columns: Mapping[str, TableColumn]) -> list[pa.Field]:
    """Build the fields of these columns."""
    return [pa.field(column.name, _ARROW_TYPES[column.kind]) for column in columns.values()]


def add_info_columns(table: pa.Table, columns: Mapping[str, TableColumn]) -> pa.Table:
    """Add these columns to some rows of the table."""
    if not columns:
        return table
    infos = [json.loads(text) if text else {} for text in table.column(INFO_COLUMN).to_pylist()]
    for (key, column), field in zip(columns.items(), build_info_schema(columns), strict=True):
        values = [_convert(info.get(key), column.kind) for info in infos]
        table = table.append_column(field, pa.array(values, field.type))
    return table


def _convert(value: Any, kind: str) -> Any:
    if value is None or kind == "boolean":
        return value
    if kind == "number":
        return float(value)
    return value if isinstance(value, str) else json.dumps(value)
