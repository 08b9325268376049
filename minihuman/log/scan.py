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
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_NOT_NEEDED = frozenset({Opcode.HEADER, Opcode.MESSAGE_INDEX})


class LogMessage(NamedTuple):
    """One message with the channel it came on. Times are wall clock, ns since 1970."""

    channel: Channel
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


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
        with self._open() as file:
            size = os.fstat(file.fileno()).st_size
            start = file.read(len(MAGIC))
            if start != MAGIC[: len(start)]:
                raise LogError(f"{self.path} is not a session log (it does not start like an MCAP file)")
            at = len(start)
            self._crc = zlib.crc32(start)
            while at < size:
                try:
                    records, at_next = self._next(file, at, size)
                except Exception as error:  # garbage can make a parser raise anything
                    self.stopped = f"damaged at byte {at}: {type(error).__name__} {error}".rstrip()
                    return
                yield from records
                if self.finished or self.stopped:
                    return
                at = at_next

    def _open(self) -> BinaryIO:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path} cannot be opened: {error.strerror}") from error

    def _next(self, file: BinaryIO, at: int, size: int) -> tuple[list[LogMessage | Metadata | Attachment], int]:
        """Read the record at a byte: what it holds, and where the next one starts."""
        head = file.read(_HEAD.size)
        end = at + _HEAD.size
        if len(head) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            end += length
        if end > size:
            self.stopped = f"cut off at byte {at}"
            return [], end
        content = file.read(length)
        if opcode == Opcode.DATA_END:
            self._end(content, file)
            return [], end
        self._crc = zlib.crc32(content, zlib.crc32(head, self._crc))
        if opcode == Opcode.CHUNK:
            return list(self._messages(_chunk_bytes(Chunk.read(_stream(content))))), end
        if opcode == Opcode.METADATA:
            return [Metadata.read(_stream(content))], end
        if opcode == Opcode.ATTACHMENT:
            return [Attachment.read(_stream(content))], end
        if opcode not in _NOT_NEEDED:
            self.stopped = f"damaged at byte {at}: no record starts with {opcode}"
        return [], end

    def _end(self, content: bytes, file: BinaryIO) -> None:
        (crc,) = _CRC.unpack(content)
        file.seek(-len(MAGIC), os.SEEK_END)
        if crc not in (0, self._crc):  # 0: its writer kept none
            self.stopped = "damaged: its checksum is wrong"
        elif file.read() != MAGIC:
            self.stopped = "cut off within its index"
        else:
            self.finished = True

    def _messages(self, data: bytes) -> Iterator[LogMessage]:
        at, size = 0, len(data)
        while at < size:
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
                if self._sequence and sequence not in (self._sequence + 1, 1):  # 1: the next segment
                    raise ValueError(f"message {sequence} follows message {self._sequence}")
                self._sequence = sequence
                payload = data[at + _MESSAGE.size : at + length]
                yield LogMessage(self.channels[channel], sequence, log_time, publish_time, payload)
            elif opcode == Opcode.CHANNEL:
                new = Channel.read(_stream(data[at : at + length]))
                self.channels[new.id] = new
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(data[at : at + length]))
                self.schemas[schema.id] = schema
            at += length


def _chunk_bytes(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.decompress(data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return data


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
