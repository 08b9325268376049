"""A log file read from front to back, as far as it is whole: finished, live, cut off, or with a garbage tail.

Every record is framed and checked here before anything is believed: a record that runs past the file's end, a chunk
whose checksum is wrong, a message of ours that is missing or bytes that are no record stop the scan, and ``stopped``
says where and why. Other programs may add topics of their own; how they number their messages is theirs.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log.read.chunk import HEAD, LogMessage, Messages, Records, cut
from minihuman.log.topics import BY_NAME

_CRC = struct.Struct("<I")
_NOT_NEEDED = frozenset({Opcode.HEADER, Opcode.MESSAGE_INDEX})


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
        self._sequence = 0  # of our last message; others' logs may not count, ours count from 1 in each segment
        self._between: list[int] = []  # of unknown topics since then: a newer version's, if our next one counts them
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
        head = file.read(HEAD.size)
        end = at + HEAD.size
        if len(head) == HEAD.size:
            opcode, length = HEAD.unpack(head)
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
            index, end = self._index(file, end, size)
            return self._messages(_chunk_bytes(Chunk.read(_stream(content))), index), end
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

    def _index(self, file: BinaryIO, at: int, size: int) -> tuple[list[bytes], int]:
        """Read the index records behind a chunk, and where the next record starts."""
        found: list[bytes] = []
        while len(head := file.read(HEAD.size)) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            if opcode != Opcode.MESSAGE_INDEX or at + HEAD.size + length > size:
                break
            found.append(file.read(length))
            self._crc = zlib.crc32(found[-1], zlib.crc32(head, self._crc))
            at += HEAD.size + length
        file.seek(at)
        return found, at

    def _messages(self, data: bytes, index: list[bytes]) -> Messages:
        records = cut(data, index)
        for opcode, content in records.others:
            self._declared(opcode, content)
        self._check_sequence(self._counted(records))
        return Messages(records, self.channels)

    def _counted(self, records: Records) -> NDArray[np.uint32]:
        """The numbers of our messages, and of a newer version's topics where they lie between ours."""
        sequences: NDArray[np.uint32] = records.heads["sequence"]
        unknown = [number for number, channel in self.channels.items() if channel.topic not in BY_NAME]
        guests = np.isin(records.heads["channel"], unknown)
        if not guests.any() and not self._between:
            return sequences
        counted: list[int] = []
        last = self._sequence
        for sequence, guest in zip(sequences.tolist(), guests.tolist(), strict=True):
            if guest:
                self._between += [sequence] if sequence == last + len(self._between) + 1 else []
                continue
            counted += [number for number in self._between if number < sequence]
            counted.append(sequence)
            last, self._between = sequence, []
        return np.array(counted, np.uint32)

    def _check_sequence(self, sequences: NDArray[np.uint32]) -> None:
        """Refuse a chunk before which, or in which, a message is missing."""
        sequences = sequences[sequences > 0]  # those that only repeat others for viewers are not counted
        before = np.concatenate([np.array([self._sequence], np.uint32), sequences])
        follows = (sequences == before[:-1] + 1) | (before[:-1] == 0) | (sequences == 1)  # 1: the next segment
        if not follows.all():
            wrong = int(np.argmin(follows))
            raise ValueError(f"message {sequences[wrong]} follows message {before[wrong]}")
        self._sequence = int(before[-1] if not len(sequences) else sequences[-1])

    def _declared(self, opcode: int, content: bytes) -> None:
        """Take a schema or channel of a chunk."""
        if opcode == Opcode.CHANNEL:
            channel = _channel(content)
            self.channels[channel.id] = channel
        elif opcode == Opcode.SCHEMA:
            schema = _schema(content)
            self.schemas[schema.id] = schema


@lru_cache(maxsize=64)  # every log declares the same few
def _channel(content: bytes) -> Channel:
    channel: Channel = Channel.read(_stream(content))
    return channel


@lru_cache(maxsize=64)
def _schema(content: bytes) -> Schema:
    schema: Schema = Schema.read(_stream(content))
    return schema


def _chunk_bytes(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.decompress(data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return data


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
