"""Split the records of an MCAP chunk: where each message begins and ends, its topic, and what the chunk declares.

A session has thousands of messages, so none is parsed before it is needed.
"""

import struct
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel
from numpy.typing import NDArray

ByteOffsets = NDArray[np.int64]

RECORD_HEADER = struct.Struct("<BQ")  # opcode, length
_LENGTH = struct.Struct("<Q")
_MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_INDEX_HEAD = struct.Struct("<HI")  # channel, bytes of entries
_INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("place", "<u8")])


class LogMessage(NamedTuple):
    """One message with the channel it came on. Times are wall clock, ns since 1970."""

    channel: Channel
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class TopicMessages(NamedTuple):
    """A chunk's messages on one topic, each (n,)."""

    topic: str
    places: ByteOffsets  # among the chunk's messages
    begins: ByteOffsets  # of the payloads, in the chunk's bytes
    ends: ByteOffsets


class ChunkRecords(NamedTuple):
    """A chunk's records: where its messages begin and what their heads say, and whatever else it holds."""

    data: bytes
    starts: ByteOffsets  # (n,) of the messages, in the data
    heads: NDArray[np.void]  # (n,) their heads
    other_records: list[tuple[int, bytes]]  # opcode and content


def split_chunk(data: bytes, index: Sequence[bytes]) -> ChunkRecords:
    """Cut a chunk's records apart.

    The index records behind a chunk spare the way from one message to the next; where there are none, or they do not
    fit, that way is gone.

    Raises:
        ValueError: if the bytes are no records.
    """
    try:
        starts = _starts(data, _indexed(index))
    except (ValueError, IndexError):
        starts = _starts(data, np.zeros(0, np.int64))
    is_message = _at_each(data, np.dtype("u1"))[starts] == Opcode.MESSAGE
    others = []
    for start in starts[~is_message].tolist():
        opcode, length = RECORD_HEADER.unpack_from(data, start)
        others.append((opcode, data[start + RECORD_HEADER.size : start + RECORD_HEADER.size + length]))
    starts = starts[is_message]
    return ChunkRecords(data, starts, _at_each(data, _MESSAGE)[starts], others)


class ChunkMessages:
    """The messages of one chunk, in file order: read when they are looked at.

    Raises:
        ValueError: if one is on a channel that was not declared.
    """

    def __init__(self, records: ChunkRecords, channels: Mapping[int, Channel], *, breaks: Sequence[int] = ()) -> None:
        self.breaks = breaks  # places before which messages are missing
        self.data = records.data
        self._heads = records.heads
        self._begins = records.starts + _MESSAGE.itemsize  # of the payloads
        self._ends = records.starts + RECORD_HEADER.size + records.heads["length"].astype(np.int64)
        self._channels: dict[int, Channel] = {}
        for number in sorted(set(records.heads["channel"].tolist())):
            if number not in channels:
                raise ValueError(f"channel {number} is not declared")
            self._channels[number] = channels[number]

    def __len__(self) -> int:
        return len(self._heads)

    @property
    def times(self) -> tuple[int, int] | None:
        """The first and the last log time among them; None where there are none."""
        log_times = self._heads["log_time"]
        return (int(log_times.min()), int(log_times.max())) if len(self) else None

    def __iter__(self) -> Iterator[LogMessage]:
        heads = self._heads[["channel", "sequence", "log_time", "publish_time"]].tolist()
        for begin, end, (channel, sequence, log_time, publish_time) in zip(
            self._begins.tolist(), self._ends.tolist(), heads, strict=True
        ):
            yield LogMessage(self._channels[channel], sequence, log_time, publish_time, self.data[begin:end])

    def count(self, topic: str) -> int:
        """How many messages are of a topic."""
        return sum(len(found.places) for found in self.by_topic(among=(topic,)))

    def by_topic(self, *, among: Container[str]) -> Iterator[TopicMessages]:
        """Yield the messages of each of these topics that has any."""
        numbers = self._heads["channel"].copy()  # side by side: every topic goes through them
        for number, channel in self._channels.items():
            if channel.topic in among:
                places = np.flatnonzero(numbers == number)
                yield TopicMessages(channel.topic, places, self._begins[places], self._ends[places])


def _at_each(data: bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """What begins at each byte, if something of this type does: to be looked up at many places at once."""
    return np.ndarray(max(0, len(data) + 1 - dtype.itemsize), dtype, data, strides=(1,))


def _indexed(index: Sequence[bytes]) -> ByteOffsets:
    """Where a chunk's messages begin, if its index is right."""
    entries = [np.frombuffer(record, _INDEX_ENTRY, offset=_INDEX_HEAD.size) for record in index]
    return np.sort(np.concatenate([np.zeros(0, np.int64), *(entry["place"].astype(np.int64) for entry in entries)]))


def _starts(data: bytes, known: ByteOffsets) -> ByteOffsets:
    """Where each record begins, given where some do."""
    ends = known + RECORD_HEADER.size + _at_each(data, np.dtype("<u8"))[known + 1].astype(np.int64)
    before, behind = np.concatenate([[0], ends]), np.concatenate([known, [len(data)]])
    gaps = np.flatnonzero(before != behind)
    walked = (_walked(data, int(before[gap]), int(behind[gap])) for gap in gaps)
    return np.sort(np.concatenate([known, *walked]))


def _walked(data: bytes, begin: int, end: int) -> ByteOffsets:
    """Where each record between two places begins."""
    found: list[int] = []
    at, length, head = begin, _LENGTH.unpack_from, RECORD_HEADER.size
    while at < end:
        found.append(at)
        at += head + length(data, at + 1)[0]
    if at != end:
        raise ValueError("a record extends past the end of its chunk")
    return np.array(found, np.int64)
