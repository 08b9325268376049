"""Messages read column by column: the same numbers and texts as protobuf's own parser reads, or a refusal."""

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
import pytest
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError, Message
from google.protobuf.message_factory import GetMessageClass
from hypothesis import given, strategies as st

from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.protobuf_columns import BEYOND, FieldColumn, MessageColumns

VALUES = {
    FieldDescriptor.TYPE_INT64: st.integers(-(2**63), 2**63 - 1) | st.integers(-300, 300),
    FieldDescriptor.TYPE_BOOL: st.booleans(),
    FieldDescriptor.TYPE_DOUBLE: st.floats(allow_nan=False),
    FieldDescriptor.TYPE_FIXED64: st.integers(0, 2**64 - 1),
    FieldDescriptor.TYPE_STRING: st.text(max_size=20) | st.just("long" * 50),
}
LISTS = {"action_vector"}  # repeated fields
NEWER = (
    b"\xf0\x01\x96\x01",
    b"\xd1\x01" + bytes(8),
    b"\xd2\x01\x03abc",
    b"\xd5\x01" + bytes(4),
)  # one of each wire type


def messages(kind: type[Message]) -> st.SearchStrategy[Message]:
    fields = {
        field.name: messages(v1.Pose) if field.message_type is not None else VALUES[field.type]
        for field in kind.DESCRIPTOR.fields
    }
    fields |= {name: st.lists(fields[name], max_size=3) for name in LISTS & fields.keys()}
    return st.fixed_dictionaries({}, optional=fields).map(lambda given: kind(**given))


def many_fields() -> type[Message]:
    """A message whose later fields have tags of two bytes, as one that has grown over the years."""
    numbers = (1, 15, 16, 17, 127, 128, 2047)
    file = FileDescriptorProto(name="grown.proto", package="grown", syntax="proto3")
    message = file.message_type.add(name="Grown")
    for number, kind in zip(numbers, cycle((3, 9, 1, 8)), strict=False):  # int64, string, double, bool
        message.field.add(name=f"field_{number}", number=number, type=kind, label=1)
    pool = DescriptorPool()
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName("grown.Grown"))


ANY = st.sampled_from([v1.Step, v1.KeyEvent, v1.FrameShown, many_fields()])
MANY = ANY.flatmap(lambda kind: st.lists(messages(kind), min_size=1, max_size=4))


def columns(kind: type[Message], payloads: Sequence[bytes]) -> Mapping[str, FieldColumn]:
    lengths = np.array([len(payload) for payload in payloads], np.int64)
    ends = np.cumsum(lengths)
    found = MessageColumns(kind.DESCRIPTOR, b"".join(payloads) + BEYOND, ends - lengths, ends)
    return dict(found)  # every field looked at


def assert_read(read: Mapping[str, FieldColumn], parsed: Sequence[Message]) -> None:
    assert set(read) == set(parsed[0].DESCRIPTOR.fields_by_name)
    for name, column in read.items():
        values = [getattr(message, name) for message in parsed]
        if isinstance(column.values, Mapping):
            assert_read(column.values, values)
        elif name in LISTS:
            rows = [row[: len(value)].tolist() for row, value in zip(column.values, values, strict=True)]
            assert rows == [list(value) for value in values]
            assert all(np.isnan(row[len(value) :]).all() for row, value in zip(column.values, values, strict=True))
        else:
            assert list(column.values) == values
        if parsed[0].DESCRIPTOR.fields_by_name[name].has_presence:
            assert column.is_present.tolist() == [message.HasField(name) for message in parsed]


@given(MANY)
def test_every_field_is_what_the_parser_reads(sent: list[Message]) -> None:
    assert_read(columns(type(sent[0]), [message.SerializeToString() for message in sent]), sent)


@given(MANY, st.data())
def test_a_newer_writers_fields_are_passed_over_wherever_they_stand(sent: list[Message], data: st.DataObject) -> None:
    def with_newer(message: Message) -> bytes:
        known = [type(message)(**{field.name: value}).SerializeToString() for field, value in message.ListFields()]
        return b"".join(data.draw(st.permutations([*known, *NEWER])))

    assert_read(columns(type(sent[0]), [with_newer(message) for message in sent]), sent)


@given(ANY.flatmap(messages), st.data())
def test_a_message_cut_off_anywhere_is_read_as_far_as_the_parser_reads_it_or_refused(
    sent: Message, data: st.DataObject
) -> None:
    whole = (sent.SerializeToString() or b"\x08\x01") + NEWER[2]
    cut = whole[: data.draw(st.integers(0, len(whole)))]
    try:
        parsed = type(sent).FromString(cut)
    except DecodeError:
        # too long: what stands behind the cut may go on with a number as if it were its own
        with pytest.raises(ValueError, match=r"truncated|utf-8|longer than"):
            columns(type(sent), [cut, whole])
    else:
        assert_read(columns(type(sent), [cut]), [parsed])


@pytest.mark.parametrize(
    ("damaged", "why"),
    [
        (b"\x08" + b"\xff" * 11, "longer than"),
        (b"\x12\x02\xff\xfe", "utf-8"),
        (b"\x12\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", "key is truncated"),
        (b"\x7a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", "unknown field is truncated"),
        (b"\x00\x01", "number 0"),
        (b"\x7b\x7c", "wire type 3"),
    ],
)
def test_bytes_that_are_no_message_are_refused(damaged: bytes, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        columns(v1.KeyEvent, [damaged])


def test_no_messages_are_columns_without_rows() -> None:
    assert all(len(column.is_present) == 0 for column in columns(v1.KeyEvent, []).values())


def test_thousands_of_different_texts_are_read() -> None:
    """More than the table has slots by which equal texts are found."""
    sent = [v1.KeyEvent(key=f"key {number % 3_000}", symbol="x") for number in range(5_000)]
    assert_read(columns(v1.KeyEvent, [message.SerializeToString() for message in sent]), sent)
