"""Table rows, kept as plain columns until the rows of many sessions become one Arrow table.

Arrow's cost per column is the same for one session as for a hundred, and plain columns travel faster between processes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from minihuman.dataset.table_catalogue import TABLES, TableSet, list_tables
from minihuman.dataset.table_columns import TableColumnType, table_key_name
from minihuman.log.model.event_columns import CategoricalTexts

_ARROW = {"text": pa.string(), "key": pa.string(), "integer": pa.int64(), "number": pa.float64(), "boolean": pa.bool_()}


def arrow_schema(table: str, *, without: frozenset[str] = frozenset()) -> pa.Schema:
    """Build the Arrow schema of the table named ``table``, omitting the columns named in ``without``.

    Each field carries its column's unit and meaning as metadata.
    """
    return _build_schema(list_tables(), table, without)


@cache
def _build_schema(tables: TableSet, table: str, without: frozenset[str]) -> pa.Schema:
    return pa.schema(
        [
            pa.field(column.name, _ARROW[column.kind], metadata={"unit": column.unit, "meaning": column.meaning})
            for column in tables.columns[table]
            if column.name not in without
        ]
    )


_NUMPY: dict[pa.DataType, type] = {pa.int64(): np.int64, pa.float64(): np.float64, pa.bool_(): np.bool_}


@dataclass(frozen=True, slots=True)
class RowBatch:
    """Rows of a table by column.

    A column is n values in an array, list or categories, or one value shared by all rows.
    """

    count: int  # n
    columns: Mapping[str, Any]

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]]) -> "RowBatch":
        """Build a batch from one mapping per row, from column name to value; all rows have the same columns."""
        if not rows:
            return cls(0, {})
        return cls(len(rows), {name: [row[name] for row in rows] for name in rows[0]})

    @classmethod
    def stack(cls, parts: Sequence["RowBatch"], **shared: Any) -> "RowBatch":
        """Concatenate batches of one table; ``shared`` are further columns with one value for all rows."""
        if not parts:
            return cls(0, shared)
        filled = [part for part in parts if part.count]
        counts = [part.count for part in filled]
        columns = {}
        for name in parts[0].columns:
            columns[name] = _concatenate_column([part.columns[name] for part in filled], counts)
        return cls(sum(counts), columns | shared)


def _concatenate_column(parts: Sequence[Any], counts: Sequence[int]) -> Any:
    """Concatenate one column of several batches, which have ``counts`` rows.

    All parts are arrays, lists or categories; or all are single values, each shared by the rows of its batch.
    """
    match parts:
        case [np.ndarray(), *_]:
            return np.concatenate(parts)
        case [CategoricalTexts(), *_]:
            return CategoricalTexts.joined(parts)
        case [list(), *_]:
            return list(chain.from_iterable(parts))
        case [str(), *_]:
            texts = CategoricalTexts.of(parts)
            return CategoricalTexts(np.repeat(texts.codes, counts), texts.categories)
    return np.repeat(parts, counts)


@dataclass(frozen=True, slots=True)
class SessionTables(Mapping[str, pa.Table]):
    """A session's rows of every table, by table name; a lookup converts the rows to Arrow."""

    parts: Mapping[str, RowBatch]

    def __getitem__(self, name: str) -> pa.Table:
        schema = arrow_schema(name)
        columns = zip(arrow_columns(name, [self.parts[name]]), schema.types, strict=True)
        return pa.Table.from_arrays([values.cast(kind) for values, kind in columns], schema=schema)

    def __iter__(self) -> Iterator[str]:
        return iter(TABLES)

    def __len__(self) -> int:
        return len(TABLES)

    def count(self, name: str) -> int:
        """Return the number of rows of one table."""
        return self.parts[name].count


def arrow_columns(name: str, parts: Sequence[RowBatch]) -> list[pa.Array]:
    """Build the Arrow columns of the table named ``name``, in the table's order, from the rows of several sessions.

    Texts are encoded as dictionary indices.
    A NaN or an empty text becomes NULL: both mean that there is no value.
    """
    columns = RowBatch.stack([part for part in parts if part.count]).columns
    return [_build_arrow_column(column.kind, columns.get(column.name, [])) for column in TABLES[name]]


def _build_arrow_column(kind: TableColumnType, values: Any) -> pa.Array:
    """Build an Arrow array of a column of the given type; texts and keys become dictionaries."""
    if kind == "key":
        return _encode_texts(values, table_key_name)
    if kind == "text":
        return _encode_texts(values, str)
    return _encode_numbers(values, _ARROW[kind])


# The next functions build arrays from buffers: pa.array would import pandas, which takes half a second.


def _encode_texts(texts: CategoricalTexts | list[str | None], rename: Callable[[str], str]) -> pa.DictionaryArray:
    """Encode a column of texts as an Arrow dictionary; None and empty texts are missing.

    ``rename`` returns the text to write for each distinct text.
    """
    if isinstance(texts, list):
        categorical = CategoricalTexts.of(text or "" for text in texts)
    else:
        categorical = texts
    encoded = [rename(category).encode() for category in categorical.categories]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    is_present = np.array([bool(word) for word in encoded], np.bool_)
    buffers = [
        pa.py_buffer(np.packbits(is_present, bitorder="little")),
        pa.py_buffer(offsets),
        pa.py_buffer(b"".join(encoded)),
    ]
    text_array = pa.Array.from_buffers(pa.string(), len(encoded), buffers)
    return pa.DictionaryArray.from_arrays(as_int64(categorical.codes), text_array)


def as_int64(numbers: NDArray[np.integer[Any]]) -> pa.Array:
    """Convert counts or indices to an Arrow int64 array."""
    return pa.Array.from_buffers(pa.int64(), len(numbers), [None, pa.py_buffer(numbers.astype(np.int64, copy=False))])


def _encode_numbers(values: NDArray[Any] | list[float | None], kind: pa.DataType) -> pa.Array:
    """Encode a column of numbers as an Arrow array; None and NaN are missing."""
    dtype = _NUMPY[kind]
    numbers: NDArray[Any]
    if isinstance(values, list):
        missing = np.array([value is None for value in values], np.bool_)
        numbers = np.array([value or 0 for value in values], dtype)
    else:
        missing = np.isnan(values)
        numbers = values.astype(dtype, copy=False)
    if dtype is np.bool_:
        numbers = np.packbits(numbers, bitorder="little")
    if missing.any():
        validity = pa.py_buffer(np.packbits(~missing, bitorder="little"))
    else:
        validity = None
    return pa.Array.from_buffers(kind, len(values), [validity, pa.py_buffer(numbers)])
