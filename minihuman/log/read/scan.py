"""A log file read from front to back: finished, live, cut off, or damaged. What is whole is read, and only that.

Every record is framed and checked before anything is believed. Behind a record that runs past the file's end, a chunk
whose checksum is wrong or bytes that are no record, reading goes on at the next record that is whole; ``damage`` says
where and why, ``missing`` which messages of ours are gone. Other programs may add topics of their own; how they number
their messages is theirs.
"""

import mmap
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log import segment_head
from minihuman.log.kinds import known
from minihuman.log.read.chunk import HEAD, LogMessage, Messages, Records, cut
from minihuman.log.read.frames import (
    LARGEST_BYTES,
    attachment_of,
    check_size,
    chunk_of,
    metadata_of,
    next_whole,
    stream,
    times_of,
)
from minihuman.log.regular import open_regular
from minihuman.log.segment_head import SegmentHead
from minihuman.log.topics import END_METADATA, MISSING_METADATA, PLAN, SEGMENT_METADATA

_CRC = struct.Struct("<I")
_FOOTER = struct.Struct("<QQI")  # where the summary starts, where its offsets start, its checksum
_CUT_OFF = "its record"
_NOT_NEEDED = frozenset({Opcode.HEADER, Opcode.MESSAGE_INDEX})


@dataclass(frozen=True, slots=True)
class Gap:
    """Bytes that could not be read, and why; reading went on behind them."""

    begin: int
    end: int
    reason: str


@dataclass(frozen=True, slots=True)
class Missing:
    """Messages of a segment that are not in its file, by their sequence."""

    segment: int
    first: int
    last: int

    def without(self, found: Sequence[int]) -> "list[Missing]":
        """What is missing still when these are found, which may be the first."""
        first = self.first + (self.first in found)
        return [Missing(self.segment, first, self.last)] if first <= self.last else []


class Scan:
    """Reads a file's records in file order. Iterate once; then ``damage`` tells what it could not read.

    Raises:
        LogError: on iteration, if the file cannot be opened, is no regular file or no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.finished = False  # it has its summary and its end, and nothing before is damaged
        self.gaps: list[Gap] = []
        self.missing: list[Missing] = []  # as their neighbours' numbers say
        self.declared: set[Missing] = set()  # said to be missing, by whoever rewrote the file
        self.stopped = ""  # why the scan ended before the end of the file; "" if it did not
        self.crc = 0  # of all that was read, up to the end of the data
        self.at = 0  # where the record begins that was read last
        self._segment = 0
        self._sequence = 0  # of our last message; others' logs may not count, ours count from 1 in each segment
        self._between: list[int] = []  # of unknown topics since then: a newer version's, if our next one counts them
        self._seen: dict[str, Metadata] = {}  # the latest of each name
        self._copy: SegmentHead | None = None  # of the start of the segment that is being read

    @property
    def damage(self) -> str:
        """What could not be read, in words; "" if all could."""
        gaps = [f"damaged at bytes {gap.begin} to {gap.end} ({gap.reason})" for gap in self.gaps]
        missing = [f"without messages {gap.first} to {gap.last}" for gap in self.missing if gap not in self.declared]
        return "; ".join([*gaps, *missing, *([self.stopped] if self.stopped else [])])

    @property
    def unfinished(self) -> str:
        """What a finished log lacks, in words; "" if it is whole."""
        if self.damage or self.finished:
            return self.damage
        size = self.path.stat().st_size  # it ends where a record does, and reading met nothing wrong
        return f"cut off at byte {size}" if size else "empty"

    def __iter__(self) -> Iterator[LogMessage | Metadata | Attachment]:
        for record in self.records():
            if isinstance(record, Messages):
                yield from record
            else:
                yield record

    def records(self) -> Iterator[Messages | Metadata | Attachment]:
        """Read chunk by chunk; where the start of a segment is damaged, its second copy is read."""
        for record in self._found():
            yield from self._restored(record)
            yield record
        yield from self._restored(None)

    def _found(self) -> Iterator[Messages | Metadata | Attachment]:
        with open_regular(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            start = file.read(len(MAGIC))
            if start != MAGIC[: len(start)]:
                raise LogError(f"{self.path} is not a session log (it does not start like an MCAP file)")
            at = len(start)
            self.crc = zlib.crc32(start)
            while at < size:
                record, reason = None, ""
                try:
                    record, at_next = self._next(file, at, size)
                except Exception as error:  # garbage can make a parser raise anything
                    reason = f"{type(error).__name__}: {error}".rstrip(": ")
                if record is not None:
                    yield record
                if self.finished or self.stopped:
                    return
                if reason:
                    at_next = self._behind(file, at, reason)
                at = at_next

    def _behind(self, file: BinaryIO, at: int, reason: str) -> int:
        """Where to go on behind a record that cannot be read; the file's end if nothing behind it is whole."""
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as view:
            found = next_whole(view, at + 1)
            size = len(view)
            if found is None:
                self.stopped = f"cut off at byte {at}" if _CUT_OFF in reason else f"damaged at byte {at}: {reason}"
                return size
            if not self.gaps:
                self._declare(view)
        self.gaps.append(Gap(at, found, reason))
        file.seek(found)
        return found

    def _declare(self, view: mmap.mmap) -> None:
        """Take the channels that a finished file's summary repeats: the chunk that declared them may be damaged."""
        footer = len(view) - len(MAGIC) - HEAD.size - _FOOTER.size
        with suppress(Exception):
            at, _, _ = _FOOTER.unpack_from(view, footer + HEAD.size)
            while at and at < footer:
                opcode, length = HEAD.unpack_from(view, at)
                self._declared(opcode, view[at + HEAD.size : at + HEAD.size + length])
                at += HEAD.size + length

    def _restored(self, record: Messages | Metadata | Attachment | None) -> Iterator[Messages | Metadata]:
        """Yield what of a segment's start is known from its copy only, before what comes behind it."""
        match record:
            case Attachment() if record.name == segment_head.NAME:
                yield from self._restored(None)  # of a segment before, of which nothing else was left
                with suppress(ValueError):
                    self._copy = SegmentHead.of(record.data)
                    for declared in self._copy.records.others:
                        self._declared(*declared)
                    for metadata in self._copy.metadata:
                        if self._seen.get(metadata.name) != metadata:
                            self._note(f"metadata {metadata.name} is not what its copy says")
                            yield metadata
            case Metadata():
                self._seen[record.name] = record
            case Messages() | None if self._copy is not None:
                copy, self._copy = self._copy, None
                if record is None or not record.count(PLAN):
                    found = copy.records.heads["sequence"].tolist()
                    self.missing = [left for gap in self.missing for left in gap.without(found)]
                    yield Messages(copy.records, self.channels)

    def _note(self, reason: str) -> None:
        self.gaps.append(Gap(self.at, self.at, reason))

    def _complete(self, segment: int, last_message: str) -> None:
        """Note the messages that are missing at a segment's end."""
        if segment == self._segment and 0 < self._sequence < _number(last_message):
            self.missing.append(Missing(segment, self._sequence + 1, _number(last_message)))

    def _next(self, file: BinaryIO, at: int, size: int) -> tuple[Messages | Metadata | Attachment | None, int]:
        """Read the record at a byte: what it holds, and where the next one starts."""
        self.at = at
        head = file.read(HEAD.size)
        end = at + HEAD.size
        if len(head) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            end += length
        if end > size:
            raise ValueError(f"{_CUT_OFF} runs to byte {end} of {size}")
        if length > LARGEST_BYTES:
            raise ValueError(f"a record of {length} bytes; {LARGEST_BYTES} are the most")
        content = file.read(length)
        if opcode == Opcode.DATA_END:
            self._end(content, file)
            return None, size
        self.crc = zlib.crc32(content, zlib.crc32(head, self.crc))
        if opcode == Opcode.CHUNK:
            index, end = self._index(file, end, size)
            messages = self._messages(chunk_of(content), index)
            if messages.times not in (None, times_of(content)):
                self._note("a chunk says other times than its messages")
            return messages, end
        if opcode == Opcode.METADATA:
            metadata = metadata_of(content)
            if metadata.name == SEGMENT_METADATA:
                self._segment, self._sequence = _number(metadata.metadata.get("segment", "")), 0
            elif metadata.name == END_METADATA:
                self._complete(_number(metadata.metadata.get("segment", "")), metadata.metadata.get("last_message", ""))
            elif metadata.name == MISSING_METADATA:
                self.declared.add(Missing(**{name: _number(value) for name, value in metadata.metadata.items()}))
            return metadata, end
        if opcode == Opcode.ATTACHMENT:
            return attachment_of(content), end
        if opcode not in _NOT_NEEDED:
            raise ValueError(f"no record starts with {opcode}")
        check_size(opcode, content)
        return None, end

    def _end(self, content: bytes, file: BinaryIO) -> None:
        """Check what is behind the data: the summary, by its checksum, and the file's end."""
        (crc,) = _CRC.unpack(content)
        summary = file.read()
        footer = len(summary) - len(MAGIC) - HEAD.size - _FOOTER.size
        if footer < 0 or not summary.endswith(MAGIC):
            self.stopped = "cut off within its index"
            return
        opcode, length = HEAD.unpack_from(summary, footer)
        _, _, summary_crc = _FOOTER.unpack_from(summary, footer + HEAD.size)
        if (opcode, length) != (Opcode.FOOTER, _FOOTER.size):
            self.stopped = "damaged: its footer is no footer"
        elif summary_crc not in (0, zlib.crc32(summary[: footer + HEAD.size + _FOOTER.size - _CRC.size])):
            self.stopped = "damaged: its index's checksum is wrong"
        elif crc not in (0, self.crc) and not self.gaps:  # 0: its writer kept none
            self.stopped = "damaged: its checksum is wrong"
        else:
            self.finished = not self.gaps

    def _index(self, file: BinaryIO, at: int, size: int) -> tuple[list[bytes], int]:
        """Read the index records behind a chunk, and where the next record starts."""
        found: list[bytes] = []
        while len(head := file.read(HEAD.size)) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            if opcode != Opcode.MESSAGE_INDEX or at + HEAD.size + length > size or length > LARGEST_BYTES:
                break
            content = file.read(length)
            try:
                check_size(opcode, content)
            except (ValueError, struct.error):
                break  # read once more as a record of its own, and found wanting there
            found.append(content)
            self.crc = zlib.crc32(found[-1], zlib.crc32(head, self.crc))
            at += HEAD.size + length
        file.seek(at)
        return found, at

    def _messages(self, data: bytes, index: list[bytes]) -> Messages:
        records = cut(data, index)
        for opcode, content in records.others:
            self._declared(opcode, content)
        missing = self._gaps_between(self._counted(records))
        self.missing += missing
        sequences = records.heads["sequence"]
        breaks = [int(np.flatnonzero(sequences == gap.last + 1)[0]) for gap in missing]
        return Messages(records, self.channels, breaks=breaks)

    def _counted(self, records: Records) -> NDArray[np.uint32]:
        """The numbers of our messages, and of a newer version's topics where they lie between ours."""
        sequences: NDArray[np.uint32] = records.heads["sequence"]
        unknown = [number for number, channel in self.channels.items() if known(channel.topic) is None]
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

    def _gaps_between(self, sequences: NDArray[np.uint32]) -> list[Missing]:
        """Name the messages that are missing before a chunk or in it; refuse one in which they are out of order."""
        counted = sequences[sequences > 0].astype(np.int64)  # those that only repeat others for viewers have 0
        if not len(counted):
            return []
        before = np.concatenate([[self._sequence], counted[:-1]])
        ahead = np.where(counted == 1, 1, counted - before)  # 1: the next segment
        if (ahead < 1).any():
            wrong = int(np.argmin(ahead))
            raise ValueError(f"message {counted[wrong]} follows message {before[wrong]}")
        self._sequence = int(counted[-1])
        return [
            Missing(self._segment, int(before[place]) + 1, int(counted[place]) - 1)
            for place in np.flatnonzero(ahead > 1).tolist()
        ]

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
    channel: Channel = Channel.read(stream(content))
    return channel


@lru_cache(maxsize=64)
def _schema(content: bytes) -> Schema:
    schema: Schema = Schema.read(stream(content))
    return schema


def _number(text: str) -> int:
    return int(text) if text.isdecimal() and len(text) < 10 else 0
