"""A log file read from front to back, as far as it is whole: finished, live, cut off, or with a garbage tail.

Every record is framed and checked here before anything is believed: a record that runs past the file's end, a chunk
whose checksum is wrong, a message that is missing or bytes that are no record stop the scan, and ``stopped`` says
where and why.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC
from numpy.typing import NDArray

from minihuman.errors import LogError

_HEAD = struct.Struct("<BQ")  # opcode, length
_LENGTH = struct.Struct("<Q")
_CRC = struct.Struct("<I")
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
_NOT_NEEDED = frozenset({Opcode.HEADER, Opcode.MESSAGE_INDEX})


class LogMessage(NamedTuple):
    """One message with the channel it came on. Times are wall clock, ns since 1970."""

    channel: Channel
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class OfTopic(NamedTuple):
    """A chunk's messages on one topic, each (n,)."""

    topic: str
    places: NDArray[np.int64]  # among the chunk's messages
    begins: NDArray[np.int64]  # of the payloads, in the chunk's bytes
    ends: NDArray[np.int64]


class Messages:
    """The messages of one chunk, in file order: cut apart, and read when they are looked at."""

    def __init__(
        self, data: bytes, starts: NDArray[np.int64], heads: NDArray[np.void], channels: dict[int, Channel]
    ) -> None:
        self.data = data  # the chunk
        self._begins = starts + _MESSAGE.itemsize  # of the payloads
        self._ends = starts + _HEAD.size + heads["length"].astype(np.int64)
        self._heads = heads
        self._channels = channels

    def __len__(self) -> int:
        return len(self._heads)

    def __iter__(self) -> Iterator[LogMessage]:
        heads = self._heads[["channel", "sequence", "log_time", "publish_time"]].tolist()
        for begin, end, (channel, sequence, log_time, publish_time) in zip(
            self._begins.tolist(), self._ends.tolist(), heads, strict=True
        ):
            yield LogMessage(self._channels[channel], sequence, log_time, publish_time, self.data[begin:end])

    def count(self, topic: str) -> int:
        """How many messages are of a topic."""
        its = [number for number, channel in self._channels.items() if channel.topic == topic]
        return int(np.isin(self._heads["channel"], its).sum())

    def by_topic(self) -> Iterator[OfTopic]:
        """Yield the messages of each topic that has any."""
        numbers = self._heads["channel"]
        for number in np.unique(numbers).tolist():
            places = np.flatnonzero(numbers == number)
            yield OfTopic(self._channels[number].topic, places, self._begins[places], self._ends[places])


class Scan:
    """Reads a file's records in file order. Iterate once; then ``finished`` and ``stopped`` tell how it ended.

    Raises:
        LogError: on iteration, if the file cannot be opened or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.finished = False  # it has its summary and its end
        self._crc = 0  # of all that was read
        self._sequence = 0  # of the last message; others' logs may not count, ours count from 1 in each segment
        self.stopped = ""  # why the scan ended before the end of the file; "" if it did not

    def __iter__(self) -> Iterator[LogMessage | Metadata | Attachment]:
        for record in self.records():
            if isinstance(record, Messages):
                yield from record
            else:
                yield record

    def records(self) -> Iterator[Messages | Metadata | Attachment]:
        """Read chunk by chunk."""
        with self._open() as file:
            size = os.fstat(file.fileno()).st_size
            start = file.read(len(MAGIC))
            if start != MAGIC[: len(start)]:
                raise LogError(f"{self.path} is not a session log (it does not start like an MCAP file)")
            at = len(start)
            self._crc = zlib.crc32(start)
            while at < size:
                try:
                    record, at_next = self._next(file, at, size)
                except Exception as error:  # garbage can make a parser raise anything
                    self.stopped = f"damaged at byte {at}: {type(error).__name__} {error}".rstrip()
                    return
                if record is not None:
                    yield record
                if self.finished or self.stopped:
                    return
                at = at_next

    def _open(self) -> BinaryIO:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path} cannot be opened: {error.strerror}") from error

    def _next(self, file: BinaryIO, at: int, size: int) -> tuple[Messages | Metadata | Attachment | None, int]:
        """Read the record at a byte: what it holds, and where the next one starts."""
        head = file.read(_HEAD.size)
        end = at + _HEAD.size
        if len(head) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            end += length
        if end > size:
            self.stopped = f"cut off at byte {at}"
            return None, end
        content = file.read(length)
        if opcode == Opcode.DATA_END:
            self._end(content, file)
            return None, end
        self._crc = zlib.crc32(content, zlib.crc32(head, self._crc))
        if opcode == Opcode.CHUNK:
            return self._messages(_chunk_bytes(Chunk.read(_stream(content)))), end
        if opcode == Opcode.METADATA:
            return Metadata.read(_stream(content)), end
        if opcode == Opcode.ATTACHMENT:
            return Attachment.read(_stream(content)), end
        if opcode not in _NOT_NEEDED:
            self.stopped = f"damaged at byte {at}: no record starts with {opcode}"
        return None, end

    def _end(self, content: bytes, file: BinaryIO) -> None:
        (crc,) = _CRC.unpack(content)
        file.seek(-len(MAGIC), os.SEEK_END)
        if crc not in (0, self._crc):  # 0: its writer kept none
            self.stopped = "damaged: its checksum is wrong"
        elif file.read() != MAGIC:
            self.stopped = "cut off within its index"
        else:
            self.finished = True

    def _messages(self, data: bytes) -> Messages:
        """Cut a chunk's messages apart: a session has thousands, so this loop does no more than it must."""
        found: list[int] = []
        at, size, length, head = 0, len(data), _LENGTH.unpack_from, _HEAD.size
        while at < size:
            found.append(at)
            at += head + length(data, at + 1)[0]
        if at > size:
            raise ValueError("a record runs past its chunk's end")
        starts, buffer = np.array(found, np.int64), np.frombuffer(data, np.uint8)
        is_message = buffer[starts] == Opcode.MESSAGE
        for start in starts[~is_message].tolist():
            self._declared(data, start)
        starts = starts[is_message]
        heads = buffer[starts[:, np.newaxis] + np.arange(_MESSAGE.itemsize)].view(_MESSAGE)[:, 0]
        if unknown := set(heads["channel"].tolist()) - self.channels.keys():
            raise ValueError(f"no channel {min(unknown)} was declared")
        self._check_sequence(heads["sequence"])
        return Messages(data, starts, heads, self.channels)

    def _check_sequence(self, sequences: NDArray[np.uint32]) -> None:
        """Refuse a chunk before which, or in which, a message is missing."""
        before = np.concatenate([np.array([self._sequence], np.uint32), sequences])
        follows = (sequences == before[:-1] + 1) | (before[:-1] == 0) | (sequences == 1)  # 1: the next segment
        if not follows.all():
            wrong = int(np.argmin(follows))
            raise ValueError(f"message {sequences[wrong]} follows message {before[wrong]}")
        self._sequence = int(before[-1])

    def _declared(self, data: bytes, at: int) -> None:
        """Take the schema or channel at a byte of a chunk."""
        opcode, length = _HEAD.unpack_from(data, at)
        content = data[at + _HEAD.size : at + _HEAD.size + length]
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(content))
            self.channels[channel.id] = channel
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(content))
            self.schemas[schema.id] = schema


def _chunk_bytes(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.decompress(data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return data


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
