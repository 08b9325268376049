"""Reads flat protobuf messages by column: one field of all messages at a time, without message objects.

NumPy reads a session's thousands of messages field by field several times faster than a parser creates objects. The
result is that of protobuf's own parser, with two exceptions that none of our writers produce: groups are rejected, and
if a nested message occurs twice the last one is used. (ptars 0.0.25 saves 0.6 of 8 ms per session, but panics at a
length that is too large, which no exception handler catches.)
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from numpy.typing import NDArray

from minihuman.log.model.event_columns import CategoricalTexts

ByteArray = NDArray[np.uint8]
Uint64Array = NDArray[np.uint64]  # the eight bytes from each position on
MessageOffsets = NDArray[np.int64]  # (n,) one position per message

# wire types
_VARINT = 0
_FIXED64 = 1
_LENGTH = 2
_FIXED32 = 5
_WIRE_TYPE = {
    FieldDescriptor.TYPE_INT64: _VARINT,
    FieldDescriptor.TYPE_UINT64: _VARINT,
    FieldDescriptor.TYPE_BOOL: _VARINT,
    FieldDescriptor.TYPE_DOUBLE: _FIXED64,
    FieldDescriptor.TYPE_FIXED64: _FIXED64,
    FieldDescriptor.TYPE_STRING: _LENGTH,
    FieldDescriptor.TYPE_MESSAGE: _LENGTH,
}
_LONGEST_VARINT = 10  # bytes
_VARINT_BITS = 70  # a varint has at most ten groups of seven
# the bits of the number in a byte, and the bit that marks a following byte
_SEVEN = np.uint64(0x7F)
_EIGHTH = np.uint64(0x80)
_ONES, _SEVENS, _EIGHTHS = (byte * np.uint64(0x0101010101010101) for byte in (np.uint64(1), _SEVEN, _EIGHTH))
_PAIRS = tuple(  # the shift that joins the upper of two neighbours to the lower, and the mask of the lower ones
    (np.uint64(bits), np.uint64(lower))
    for bits, lower in ((1, 0x007F007F007F007F), (2, 0x00003FFF00003FFF), (4, 0x000000000FFFFFFF))
)
# hashing to one of 2,048 slots by the upper bits of a product
_SPREAD = np.uint64(0x9E3779B97F4A7C15)
_DOWN = np.uint64(53)
_FIRST_BYTES = np.array([(1 << 8 * count) - 1 for count in range(8)], np.uint64)  # masks of 0 to 7 bytes
BEYOND = bytes(16)  # follows the last message, so that a truncated number can be read before it is rejected


class FieldColumn(NamedTuple):
    """One field of n messages: numbers, texts or the columns of a nested message, and which messages have the field."""

    values: Any
    is_present: NDArray[np.bool_]  # (n,) if False, ``values`` has the field's default


class MessageColumns(Mapping[str, FieldColumn]):
    """Every field of some messages, by name. Texts and nested messages are read when they are first accessed.

    Attributes:
        is_canonical: bool[n], whether a message's bytes are the ones that protobuf writes for its fields: each known
            field once, in the order of numbers, in as few bytes as possible, and none that is its default. All are
            False without ``canonical``; nested messages and the letters of texts are not considered.

    Raises:
        ValueError: on creation or when a field is accessed, if the bytes are not such messages.
    """

    def __init__(
        self, kind: Any, data: bytes, begins: MessageOffsets, ends: MessageOffsets, *, canonical: bool = False
    ) -> None:
        """Locate every field.

        Args:
            kind: the messages' descriptor.
            data: the bytes of the messages, followed by ``BEYOND``.
            begins: where each message begins in ``data``.
            ends: where each message ends in ``data``.
            canonical: whether to find out which messages are in their canonical form.
        """
        self._data = data
        self._looks_for_canonical = canonical
        fields = sorted(kind.fields, key=lambda field: field.number)
        self._fields = {field.name: _Field(field, data, ends, canonical=canonical) for field in fields}
        self._read: dict[str, FieldColumn] = {}
        self.is_canonical = np.full(len(begins), canonical)
        positions = begins.copy()
        while (positions < ends).any():
            before = positions.copy()
            for field in self._fields.values():  # writers keep the fields' order, so one round suffices
                field.take(positions)
            self.is_canonical &= positions == ends  # otherwise a field is out of order, repeated or unknown
            for row in np.flatnonzero((positions == before) & (positions < ends)):
                positions[row] = _skip_unknown_field(data, int(positions[row]), int(ends[row]))
        if canonical:
            for field in self._fields.values():
                self.is_canonical &= field.mark_canonical()

    def __getitem__(self, name: str) -> FieldColumn:
        if name not in self._read:
            field = self._fields[name]
            values = field.values(self._data, canonical=self._looks_for_canonical)
            self._read[name] = FieldColumn(values, field.is_present)
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        return len(self._fields)


class _Field:
    """One field of n messages, which is read from all of them together.

    Args:
        field: the field's descriptor.
        data: the bytes of the messages.
        ends: where each message ends in ``data``.
        canonical: whether ``mark_canonical`` will be called.
    """

    def __init__(self, field: FieldDescriptor, data: bytes, ends: MessageOffsets, *, canonical: bool) -> None:
        assert field.number < 2048, f"{field.full_name}: a tag of three bytes"
        self._kind = field
        # a repeated field's default in every release of protobuf; its numbers are packed
        self._is_list = field.default_value == []
        self._wire_type = _LENGTH if self._is_list else _WIRE_TYPE[field.type]
        tag = field.number << 3 | self._wire_type  # written as a varint of one or two bytes
        self._second_tag_byte = tag >> 7  # 0 if the tag has one byte
        self._first_tag_byte = (tag & 0x7F) | 0x80 if self._second_tag_byte else tag
        self._tag_bytes = 2 if self._second_tag_byte else 1
        self._bytes: ByteArray = np.frombuffer(data, np.uint8)
        self._eights = _view_eight_bytes(data)
        self._ends = ends
        self.is_present = np.zeros(len(ends), np.bool_)
        self._numbers = np.zeros(len(ends), np.uint64)  # the number itself, or the position of a text or message
        self._lengths = np.zeros(len(ends), np.int64)
        self._varint_bytes = np.ones(len(ends), np.int64) if canonical else None  # bytes of the number or length

    def take(self, positions: MessageOffsets) -> None:
        """Read the field from every message that has it at its position, and move these positions past the field.

        Args:
            positions: the position in each message from which on it has not been read; changed in place.
        """
        has_field = (self._bytes[positions] == self._first_tag_byte) & (positions < self._ends)
        if self._second_tag_byte:
            has_field &= self._bytes[positions + 1] == self._second_tag_byte
        count = np.count_nonzero(has_field)
        if not count:
            return
        rows = slice(None) if count == len(has_field) else np.flatnonzero(has_field)
        cursors = positions[rows] + self._tag_bytes
        ends = self._ends[rows]
        if self._wire_type == _FIXED64:
            self._numbers[rows] = self._eights[cursors]
            cursors += 8
        else:
            varints_begin = cursors
            numbers, cursors = _decode_varints(self._eights, cursors)
            if self._varint_bytes is not None:
                self._varint_bytes[rows] = cursors - varints_begin
            if self._wire_type == _LENGTH:
                if (numbers > (ends - cursors).clip(0).astype(np.uint64)).any():
                    raise ValueError(f"field {self._kind.name} is truncated")
                self._lengths[rows] = numbers
                numbers = cursors.astype(np.uint64)
                cursors = cursors + self._lengths[rows]
            self._numbers[rows] = numbers
        if (cursors > ends).any():
            raise ValueError(f"field {self._kind.name} is truncated")
        self.is_present[rows] = True
        positions[rows] = cursors

    def mark_canonical(self) -> NDArray[np.bool_]:
        """Return bool[n], whether the field, if present, has the bytes that protobuf writes for its value.

        It is False for numbers of ten bytes, negative ones and the largest unsigned ones, whose bytes are not judged.
        """
        assert self._varint_bytes is not None
        numbers = self._lengths.view(np.uint64) if self._wire_type == _LENGTH else self._numbers
        upper_bits = (7 * (self._varint_bytes - 1)).clip(0, 63).astype(np.uint64)
        # a varint is as short as possible if its last seven bits are not all 0
        is_canonical: NDArray[np.bool_] = (self._varint_bytes == 1) | ((numbers >> upper_bits) > 0)
        is_canonical &= self._varint_bytes < _LONGEST_VARINT
        if self._kind.type == FieldDescriptor.TYPE_BOOL:
            is_canonical &= numbers <= 1
        if not self._kind.has_presence:
            is_canonical &= numbers != 0
        is_canonical |= ~self.is_present
        return is_canonical

    def values(self, data: bytes, *, canonical: bool = False) -> Any:
        """Return the whole column, after all messages have been read.

        Args:
            data: the bytes of the messages.
            canonical: whether the columns of a nested message find out which messages are in their canonical form.
        """
        match self._kind.type:
            case FieldDescriptor.TYPE_DOUBLE if self._is_list:
                return self._read_lists(data)
            case FieldDescriptor.TYPE_INT64:
                return self._numbers.view(np.int64)
            case FieldDescriptor.TYPE_DOUBLE:
                return self._numbers.view(np.float64)
            case FieldDescriptor.TYPE_BOOL:
                return self._numbers != 0
            case FieldDescriptor.TYPE_STRING | FieldDescriptor.TYPE_MESSAGE:
                begins = self._numbers.view(np.int64)
                ends = begins + self._lengths
                if self._kind.message_type is not None:
                    return MessageColumns(self._kind.message_type, data, begins, ends, canonical=canonical)
                return _read_texts(data, begins, ends)
        return self._numbers

    def _read_lists(self, data: bytes) -> NDArray[np.float64]:
        """Return lists of doubles as rows, float64[n, longest list], padded with NaN.

        Raises:
            ValueError: if a list ends inside a number.
        """
        if (self._lengths % 8).any():  # a double has eight bytes
            raise ValueError(f"field {self._kind.name} is truncated: it ends inside a number")
        counts = self._lengths // 8
        rows = np.full((len(counts), int(counts.max(initial=0))), np.nan)
        for row in np.flatnonzero(counts):
            rows[row, : counts[row]] = np.frombuffer(data, "<f8", int(counts[row]), int(self._numbers[row]))
        return rows


def _view_eight_bytes(data: bytes) -> Uint64Array:
    """Return, for each position but the last seven, its eight bytes as one little-endian number.

    Thus many positions can be read at once.
    """
    return np.ndarray(len(data) - 7, "<u8", data, strides=(1,))


def _decode_varints(eights: Uint64Array, positions: MessageOffsets) -> tuple[Uint64Array, MessageOffsets]:
    """Decode the varint at each position, lowest seven bits first; return the numbers and the next positions.

    Args:
        eights: the eight bytes from each position of the data on, as ``_view_eight_bytes`` returns them.
        positions: the positions of the varints.

    Raises:
        ValueError: if a varint is longer than ten bytes.
    """
    eight = eights[positions]
    if not (eight & _EIGHTH).any():  # the common case: lengths, flags, small numbers
        return eight & _SEVEN, positions + 1
    stops = ~eight & _EIGHTHS
    within = (stops & -stops) - np.uint64(1)  # the bits up to the first stop; all without a stop
    numbers = eight & within & _SEVENS
    for bits, lower in _PAIRS:  # joins groups of 7 bits to 14, 28 and 56
        numbers = (numbers & lower) | ((numbers & ~lower) >> bits)
    # the product adds up, in its highest byte, the lowest bit of each byte within: the number of these bytes
    positions = positions + ((within & _ONES) * _ONES >> np.uint64(56)).astype(np.int64)
    unfinished = np.flatnonzero(stops == 0)  # numbers of more than eight bytes
    shift = 56
    while unfinished.size:
        if shift >= _VARINT_BITS:
            raise ValueError("a varint is longer than 10 bytes")
        byte = eights[positions[unfinished]] & np.uint64(0xFF)
        numbers[unfinished] |= (byte & _SEVEN) << np.uint64(shift)
        positions[unfinished] += 1
        unfinished = unfinished[byte > 127]
        shift = shift + 7
    return numbers, positions


def _read_texts(data: bytes, begins: MessageOffsets, ends: MessageOffsets) -> CategoricalTexts:
    """Read the text of each message, which lies between its positions ``begins`` and ``ends``.

    To find the distinct texts, parts of seven bytes are compared as numbers whose eighth byte is the part's length.
    """
    eights = _view_eight_bytes(data)
    last_eight = len(eights) - 1
    lengths = ends - begins
    longest = int(lengths.max(initial=0))
    codes = np.zeros_like(lengths)
    for offset in range(0, max(1, longest), 7):
        byte_counts = (lengths - offset).clip(0, 7).astype(np.uint64)
        positions = np.minimum(begins + offset, last_eight)
        seven_bytes = eights[positions] & _FIRST_BYTES[byte_counts]
        part_keys = seven_bytes | (byte_counts << np.uint64(56))
        firsts, part_codes = _find_distinct(part_keys)
        if offset:  # texts are equal if their earlier parts and this one are
            pairs = codes.astype(np.uint64) * np.uint64(len(firsts)) + part_codes.astype(np.uint64)
            firsts, part_codes = _find_distinct(pairs)
        codes = part_codes
    texts = tuple(data[begins[first] : ends[first]].decode() for first in firsts.tolist())
    return CategoricalTexts(codes, texts)


def _find_distinct(values: Uint64Array) -> tuple[MessageOffsets, NDArray[np.int64]]:
    """Return the position of one occurrence of each distinct value, and for each row the index of its value.

    It sorts only if two values share a hash slot.
    """
    slots = (values * _SPREAD >> _DOWN).astype(np.int64)
    holders = np.full(1 << 64 - int(_DOWN), -1)
    holders[slots] = np.arange(len(values))
    is_held = holders >= 0
    occurrences = holders[is_held]
    codes = (np.cumsum(is_held) - 1)[slots]
    if (values[occurrences[codes]] == values).all():
        return occurrences, codes
    _, occurrences, codes = np.unique(values, return_index=True, return_inverse=True)
    return occurrences, codes


def _skip_unknown_field(data: bytes, position: int, end: int) -> int:
    """Return the position after an unknown field, which a newer writer may have added.

    Args:
        data: the bytes of the messages.
        position: the position of the field.
        end: the position at which its message ends.

    Raises:
        ValueError: if the bytes are not such a field.
    """
    tag, position = _decode_varint(data, position)
    number = tag >> 3  # the lowest three bits of a tag are the wire type
    wire_type = tag & 7
    if number == 0:
        raise ValueError("a field has number 0")
    if wire_type == _VARINT:
        _, position = _decode_varint(data, position)
    elif wire_type == _FIXED64:
        position += 8
    elif wire_type == _LENGTH:
        length, position = _decode_varint(data, position)
        position += length
    elif wire_type == _FIXED32:
        position += 4
    else:
        raise ValueError(f"wire type {wire_type} is not supported")
    if position > end:
        raise ValueError("an unknown field is truncated")
    return position


def _decode_varint(data: bytes, position: int) -> tuple[int, int]:
    numbers, next_positions = _decode_varints(_view_eight_bytes(data), np.array([position]))
    return int(numbers[0]), int(next_positions[0])
