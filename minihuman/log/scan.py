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

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from minihuman.errors import LogError

_HEAD = struct.Struct("<BQ")  # opcode, length
_CRC = struct.Struct("<I")
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_Head = tuple[int, int, int, int, int, int]
_NOT_NEEDED = frozenset({Opcode.HEADER, Opcode.MESSAGE_INDEX})


class LogMessage(NamedTuple):
    """One message with the channel it came on. Times are wall clock, ns since 1970."""

    channel: Channel
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class Messages:
    """The messages of one chunk, in file order: cut apart, and read when they are looked at."""

    def __init__(self, data: bytes, starts: list[int], heads: list[_Head], channels: dict[int, Channel]) -> None:
        self._data = data
        self._starts = starts
        self._heads = heads
        self._channels = channels

    def __len__(self) -> int:
        return len(self._heads)

    def __iter__(self) -> Iterator[LogMessage]:
        for start, (_, length, channel, sequence, log_time, publish_time) in zip(
            self._starts, self._heads, strict=True
        ):
            payload = self._data[start + _MESSAGE.size : start + _HEAD.size + length]
            yield LogMessage(self._channels[channel], sequence, log_time, publish_time, payload)

    def count(self, topic: str) -> int:
        """How many messages are of a topic."""
        its = {channel.id for channel in self._channels.values() if channel.topic == topic}
        return sum(head[2] in its for head in self._heads)

    def by_topic(self) -> dict[str, tuple[list[int], list[bytes]]]:
        """The messages of each topic: their places in this chunk, and their bytes."""
        found: dict[int, tuple[list[int], list[bytes]]] = {channel: ([], []) for channel in self._channels}
        data, payload, record = self._data, _MESSAGE.size, _HEAD.size
        for place, (start, head) in enumerate(zip(self._starts, self._heads, strict=True)):
            places, payloads = found[head[2]]
            places.append(place)
            payloads.append(data[start + payload : start + record + head[1]])
        return {self._channels[channel].topic: group for channel, group in found.items() if group[0]}


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
        starts: list[int] = []
        heads: list[_Head] = []
        a_message, last = int(Opcode.MESSAGE), self._sequence
        at, size = 0, len(data)
        while at < size:
            if data[at] == a_message:
                head = _MESSAGE.unpack_from(data, at)
                if head[3] != last + 1 and last and head[3] != 1:  # 1: the next segment
                    raise ValueError(f"message {head[3]} follows message {last}")
                last = head[3]
                starts.append(at)
                heads.append(head)
                at += _HEAD.size + head[1]
            else:
                at = self._declared(data, at)
        self._sequence = last
        return Messages(data, starts, heads, self.channels)

    def _declared(self, data: bytes, at: int) -> int:
        """Take the schema or channel at a byte of a chunk; give where the next record starts."""
        opcode, length = _HEAD.unpack_from(data, at)
        end: int = at + _HEAD.size + length
        content = data[at + _HEAD.size : end]
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(content))
            self.channels[channel.id] = channel
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(content))
            self.schemas[schema.id] = schema
        return end


def _chunk_bytes(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.decompress(data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return data


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
