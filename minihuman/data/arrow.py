"""The tables' columns in Arrow's words; apart, as importing Arrow takes longer than many a command."""

from functools import cache

import pyarrow as pa

from minihuman.data.columns import TABLES

_ARROW = {"text": pa.string(), "key": pa.string(), "whole": pa.int64(), "number": pa.float64(), "yes_no": pa.bool_()}


@cache
def schema(table: str, *, without: frozenset[str] = frozenset()) -> pa.Schema:
    """The table's Arrow schema, some columns left out, each field with its unit and meaning as metadata."""
    return pa.schema(
        [
            pa.field(column.name, _ARROW[column.kind], metadata={"unit": column.unit, "meaning": column.meaning})
            for column in TABLES[table]
            if column.name not in without
        ]
    )
