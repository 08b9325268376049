"""Protobuf messages of one flat type read column by column: one field of all of them at a time, no message is made.

A session has thousands of steps, key presses and pictures. Field by field, numpy reads them several times sooner than
a parser makes one object after the other. What is read is what protobuf's own parser reads, but for two things that
no writer of ours does: groups are refused, and of a nested message that comes twice the last one counts.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]  # (n,) a byte of each message

_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5  # wire types
_WIRE_TYPE = {
    FieldDescriptor.TYPE_INT64: _VARINT,
    FieldDescriptor.TYPE_UINT64: _VARINT,
    FieldDescriptor.TYPE_BOOL: _VARINT,
    FieldDescriptor.TYPE_DOUBLE: _FIXED64,
    FieldDescriptor.TYPE_FIXED64: _FIXED64,
    FieldDescriptor.TYPE_STRING: _LENGTH,
    FieldDescriptor.TYPE_MESSAGE: _LENGTH,
}
_VARINT_BITS = 70  # ten groups of seven are the most that a varint has
_BEYOND = bytes(16)  # behind the last message, so that a number cut off there can be read before it is refused


@dataclass(frozen=True, slots=True)
class Column:
    """One field of n messages: (n,) numbers, n texts, or the columns of a nested message; and which hold it at all."""

    values: Any
    there: NDArray[np.bool_]  # (n,) False: the field's default stands in ``values``


def read_columns(kind: type[Message], data: bytes, begins: Places, ends: Places) -> dict[str, Column]:
    """Read every field, by name, of the messages of one kind that lie between these places in ``data``.

    Raises:
        ValueError: if the bytes are no such messages.
    """
    return _columns(kind.DESCRIPTOR, data + _BEYOND, begins, ends)


def _columns(kind: Any, data: bytes, begins: Places, ends: Places) -> dict[str, Column]:
    buffer = np.frombuffer(data, np.uint8)
    columns = {field.number: _Reader(field, buffer, ends) for field in kind.fields}
    at = begins.copy()
    while (at < ends).any():
        before = at.copy()
        for column in columns.values():  # writers keep the fields' order, so once through is enough
            column.take(at)
        for row in np.flatnonzero((at == before) & (at < ends)):
            at[row] = _after_unknown(data, int(at[row]), int(ends[row]))
    return {column.field.name: column.read(data) for column in columns.values()}


class _Reader:
    """One field as it is met in one message after the other."""

    def __init__(self, field: FieldDescriptor, buffer: Bytes, ends: Places) -> None:
        assert field.number < 16, f"{field.full_name}: a tag of two bytes"
        self.field = field
        self._wire_type = _WIRE_TYPE[field.type]
        self._tag = field.number << 3 | self._wire_type
        self._buffer = buffer
        self._ends = ends
        self._there = np.zeros(len(ends), np.bool_)
        self._numbers = np.zeros(len(ends), np.uint64)  # the number itself, or where a text or message begins
        self._lengths = np.zeros(len(ends), np.int64)

    def take(self, at: Places) -> None:
        """Read the field of every message that has it at its place, and put that place behind it."""
        rows = np.flatnonzero((self._buffer[at] == self._tag) & (at < self._ends))
        if not rows.size:
            return
        here, ends = at[rows] + 1, self._ends[rows]
        if self._wire_type == _FIXED64:
            self._numbers[rows] = self._buffer[here[:, np.newaxis] + np.arange(8)].view("<u8")[:, 0]
            here += 8
        else:
            numbers, here = _varints(self._buffer, here)
            if self._wire_type == _LENGTH:
                if (numbers > (ends - here).clip(0).astype(np.uint64)).any():
                    raise ValueError(f"{self.field.name} is cut off")
                numbers, self._lengths[rows] = here.astype(np.uint64), numbers
                here = here + self._lengths[rows]
            self._numbers[rows] = numbers
        if (here > ends).any():
            raise ValueError(f"{self.field.name} is cut off")
        self._there[rows] = True
        at[rows] = here

    def read(self, data: bytes) -> Column:
        """The whole column, when every message has been gone through."""
        return Column(self._values(data), self._there)

    def _values(self, data: bytes) -> Any:
        match self.field.type:
            case FieldDescriptor.TYPE_INT64:
                return self._numbers.view(np.int64)
            case FieldDescriptor.TYPE_DOUBLE:
                return self._numbers.view(np.float64)
            case FieldDescriptor.TYPE_BOOL:
                return self._numbers != 0
            case FieldDescriptor.TYPE_STRING | FieldDescriptor.TYPE_MESSAGE:
                begins = self._numbers.view(np.int64)
                ends = begins + self._lengths
                if self.field.message_type is not None:
                    return _columns(self.field.message_type, data, begins, ends)
                return _texts(data, begins, ends)
        return self._numbers


def _varints(buffer: Bytes, at: Places) -> tuple[NDArray[np.uint64], Places]:
    """The number at each place, seven bits a byte, the lowest first; and the places behind them."""
    byte = buffer[at]
    numbers, at = (byte & 127).astype(np.uint64), at + 1
    more, shift = np.flatnonzero(byte > 127), 7
    while more.size:
        if shift >= _VARINT_BITS:
            raise ValueError("a number is too long")
        byte = buffer[at[more]]
        numbers[more] |= (byte & 127).astype(np.uint64) << np.uint64(shift)
        at[more] += 1
        more, shift = more[byte > 127], shift + 7
    return numbers, at


def _texts(data: bytes, begins: Places, ends: Places) -> list[str]:
    """The texts between the places; equal ones are one object."""
    raw = [data[begin:end] for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]
    texts = {text: text.decode() for text in set(raw)}
    return [texts[text] for text in raw]


def _after_unknown(data: bytes, at: int, end: int) -> int:
    """Where the field after an unknown one begins: a newer writer may have added it."""
    tag, at = _varint(data, at)
    match tag & 7:
        case _ if tag >> 3 == 0:
            raise ValueError("a field has no number")
        case 0:
            _, at = _varint(data, at)
        case 1:
            at += 8
        case 2:
            length, at = _varint(data, at)
            at += length
        case 5:
            at += 4
        case wire_type:
            raise ValueError(f"no field is of wire type {wire_type}")
    if at > end:
        raise ValueError("an unknown field is cut off")
    return at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    number, places = _varints(np.frombuffer(data, np.uint8), np.array([at]))
    return int(number[0]), int(places[0])
