"""Scans a log file from front to back, whether finished, live, cut off or damaged; only intact records are read.

After a record that extends past the end of the file, a chunk with a wrong checksum, or bytes that are not a record,
scanning resumes at the next intact record. ``damage`` states where and why, and ``missing`` which of our messages are
lost. Other programs may add topics, and number their messages as they like.
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
from minihuman.log import integrity
from minihuman.log.codec import find_topic
from minihuman.log.integrity import SegmentHead
from minihuman.log.names import END_METADATA, MISSING_METADATA, SEGMENT_METADATA
from minihuman.log.paths import open_regular_file
from minihuman.log.salvage.records import (
    MAX_RECORD_BYTES,
    RECORD_HEADER,
    ChunkMessages,
    ChunkRecords,
    LogMessage,
    as_data_stream,
    check_record_size,
    find_next_record,
    parse_attachment,
    parse_chunk,
    parse_chunk_times,
    parse_metadata,
    split_chunk,
)
from minihuman.log.topics import PLAN

_CRC = struct.Struct("<I")
_FOOTER = struct.Struct("<QQI")  # position of the summary, position of its offsets, its checksum
_FEW = 64  # more numbers than this are compared faster as an array
_PAST_END = "its record"  # begins the reason if a record extends past the end of the file


@dataclass(frozen=True, slots=True)
class DamagedRange:
    """A range of bytes that could not be read, and the reason; reading resumed after it."""

    begin: int
    end: int
    reason: str


@dataclass(frozen=True, slots=True)
class MissingMessages:
    """Consecutive messages of a segment that are not in its file, by sequence number."""

    segment: int
    first: int
    last: int

    def without(self, sequences: Sequence[int]) -> "list[MissingMessages]":
        """Return what is still missing after messages with these numbers were found, as a list of at most one range.

        Only the first message of the range can be among them, which is that of a segment's plan.
        """
        first = self.first
        if first in sequences:
            first += 1
        if first <= self.last:
            return [MissingMessages(self.segment, first, self.last)]
        return []


FileRecord = ChunkMessages | Metadata | Attachment


class LogScanner:
    """Reads a file's records in file order. It can be iterated once; ``damage`` then states what it could not read.

    Raises:
        LogError: on iteration, if the file cannot be opened, is not a regular file, or is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.finished = False  # whether the summary and the file's end are intact
        self.gaps: list[DamagedRange] = []
        self.missing: list[MissingMessages] = []  # according to the numbers of adjacent messages
        self.declared: set[MissingMessages] = set()  # declared missing when the file was rewritten
        self.stop_reason = ""  # why the scan ended before the end of the file; "" if it did not
        self.crc = 0  # of all bytes read, up to the end of the data
        self.position = 0  # where the last record that was read begins
        self._record_end = 0  # where it ends, including its index; counted, since ``tell`` is a system call
        self._segment = 0
        self._sequence = 0  # number of our last message, which count from 1 in each segment
        self._between: list[int] = []  # consecutive numbers on unknown topics since then
        self._latest_metadata: dict[str, Metadata] = {}  # the latest of each name
        self._copy: SegmentHead | None = None  # of the segment that is being read

    @property
    def damage(self) -> str:
        """Return a description of all that could not be read; "" if everything could be."""
        gaps = [f"damaged at bytes {gap.begin} to {gap.end} ({gap.reason})" for gap in self.gaps]
        missing = [f"without messages {gap.first} to {gap.last}" for gap in self.missing if gap not in self.declared]
        reasons = [*gaps, *missing]
        if self.stop_reason:
            reasons.append(self.stop_reason)
        return "; ".join(reasons)

    @property
    def unfinished_reason(self) -> str:
        """Return a description of what a finished log lacks; "" if it is intact."""
        if self.damage or self.finished:
            return self.damage
        size = self.path.stat().st_size  # it ends after a record, and everything was read
        return f"cut off at byte {size}" if size else "empty"

    def __iter__(self) -> Iterator[LogMessage | Metadata | Attachment]:
        for record in self.records():
            if isinstance(record, ChunkMessages):
                yield from record
            else:
                yield record

    def records(self) -> Iterator[FileRecord]:
        """Yield the file's records chunk by chunk; if the start of a segment is damaged, its second copy is read."""
        for record in self._scan_file():
            yield from self._restore_start(record)
            yield record
        yield from self._restore_start(None)

    def _scan_file(self) -> Iterator[FileRecord]:
        """Yield the file's intact records chunk by chunk, and record the damage between them."""
        with open_regular_file(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            start = file.read(len(MAGIC))
            if start != MAGIC[: len(start)]:
                raise LogError(f"{self.path} is not a session log: it does not start with MCAP's magic bytes")
            self.crc = zlib.crc32(start)
            self.position = len(start)
            while self.position < size and not self.stop_reason:
                records: Sequence[FileRecord] = ()
                try:
                    opcode, content = self._read_record(file, size)
                    records = self._parse(opcode, content, file, size)
                    next_position = self._record_end
                except Exception as error:  # garbage can make a parser raise anything
                    reason = f"{type(error).__name__}: {error}".rstrip(": ")
                    next_position = self._skip_damage(file, reason)
                yield from records
                self.position = next_position

    def _skip_damage(self, file: BinaryIO, reason: str) -> int:
        """Record damage at the present position, and return the position of the next intact record.

        If there is none, record why the scan stops, and return the position of the file's end.

        Args:
            file: the file, which is moved to the next intact record.
            reason: why the record at the present position could not be read.
        """
        begin = self.position
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as view:
            next_begin = find_next_record(view, begin + 1)
            size = len(view)
            if next_begin is None:
                is_blank = not view[begin:].strip(b"\0")  # a power cut may preserve a write's size only
                if is_blank or _PAST_END in reason:
                    self.stop_reason = f"cut off at byte {begin}"
                else:
                    self.stop_reason = f"damaged at byte {begin}: {reason}"
                return size
            if not self.gaps:
                self._declare_channels(view)
        self.gaps.append(DamagedRange(begin, next_begin, reason))
        file.seek(next_begin)
        return next_begin

    def _declare_channels(self, view: mmap.mmap) -> None:
        """Read the channels from a finished file's summary, since the chunk that declared them may be damaged."""
        footer = len(view) - len(MAGIC) - RECORD_HEADER.size - _FOOTER.size
        with suppress(Exception):
            position, _, _ = _FOOTER.unpack_from(view, footer + RECORD_HEADER.size)
            while 0 < position < footer:  # 0 if there is no summary
                opcode, length = RECORD_HEADER.unpack_from(view, position)
                begin = position + RECORD_HEADER.size
                end = begin + length
                self._declare_record(opcode, view[begin:end])
                position = end

    def _restore_start(self, record: FileRecord | None) -> Iterator[ChunkMessages | Metadata]:
        """Yield those records of a segment's start that are damaged in the file, from the start's second copy.

        The metadata are yielded when the copy is read, and the plan before the messages that follow the copy.

        Args:
            record: the record that comes next in the file; None at the file's end.
        """
        match record:
            case Attachment() if record.name == integrity.SEGMENT_HEAD_NAME:
                yield from self._restore_start(None)  # of an earlier segment, which has no other records left
                with suppress(ValueError):
                    self._copy = SegmentHead.of(record.data)
                    for declared in self._copy.records.other_records:
                        self._declare_record(*declared)
                    for metadata in self._copy.metadata:
                        if self._latest_metadata.get(metadata.name) != metadata:
                            self._note_damage(f"metadata {metadata.name} differs from its copy")
                            yield metadata
            case Metadata():
                self._latest_metadata[record.name] = record
            case ChunkMessages() | None if self._copy is not None:
                copy = self._copy
                self._copy = None
                if record is None or not record.count(PLAN):
                    sequences = copy.records.heads["sequence"].tolist()
                    self.missing = [still_missing for gap in self.missing for still_missing in gap.without(sequences)]
                    yield ChunkMessages(copy.records, self.channels)

    def _note_damage(self, reason: str) -> None:
        """Record that something is wrong at the present position although nothing is skipped."""
        self.gaps.append(DamagedRange(self.position, self.position, reason))

    def _read_record(self, file: BinaryIO, size: int) -> tuple[int, bytes]:
        """Read the record at ``position``, and add it to the checksum unless it ends the data.

        Raises:
            ValueError: if the record extends past the end of the file, or is too large to be one of ours.
        """
        head = file.read(RECORD_HEADER.size)
        end = self.position + RECORD_HEADER.size
        if len(head) == RECORD_HEADER.size:
            opcode, length = RECORD_HEADER.unpack(head)
            end += length
        if end > size:
            raise ValueError(f"{_PAST_END} extends to byte {end}, but there are only {size} bytes")
        if length > MAX_RECORD_BYTES:
            raise ValueError(f"a record has {length} bytes; at most {MAX_RECORD_BYTES} are allowed")
        self._record_end = end
        content = file.read(length)
        if opcode != Opcode.DATA_END:
            self.crc = zlib.crc32(content, zlib.crc32(head, self.crc))
        return opcode, content

    def _parse(self, opcode: int, content: bytes, file: BinaryIO, size: int) -> Sequence[FileRecord]:
        """Parse a record and, for a chunk, the index that follows it.

        Args:
            opcode: the kind of the record.
            content: its content.
            file: the file, positioned after the record.
            size: the size of the file in bytes.

        Returns:
            A list with the parsed record; an empty list for a kind of record that readers do not use.

        Raises:
            ValueError: if the record is not intact.
        """
        match opcode:
            case Opcode.CHUNK:
                messages = self._read_chunk_messages(parse_chunk(content), self._read_index(file, size))
                if messages.times not in (None, parse_chunk_times(content)):
                    self._note_damage("a chunk's stated times differ from its messages'")
                return [messages]
            case Opcode.METADATA:
                metadata = parse_metadata(content)
                self._follow_segments(metadata)
                return [metadata]
            case Opcode.ATTACHMENT:
                return [parse_attachment(content)]
            case Opcode.DATA_END:
                self._check_end(content, file)
            case Opcode.HEADER | Opcode.MESSAGE_INDEX:
                check_record_size(opcode, content)
            case _:
                raise ValueError(f"opcode {opcode} is unknown")
        return []

    def _follow_segments(self, metadata: Metadata) -> None:
        """Note what metadata state: that a segment begins, which messages its end lacks, or which are missing."""
        facts = metadata.metadata
        if metadata.name == SEGMENT_METADATA:
            self._segment = _parse_number(facts.get("segment", ""))
            self._sequence = 0
        elif metadata.name == END_METADATA:
            last = _parse_number(facts.get("last_message", ""))
            if _parse_number(facts.get("segment", "")) == self._segment and 0 < self._sequence < last:
                self.missing.append(MissingMessages(self._segment, self._sequence + 1, last))
        elif metadata.name == MISSING_METADATA:
            self.declared.add(MissingMessages(**{name: _parse_number(value) for name, value in facts.items()}))

    def _check_end(self, content: bytes, file: BinaryIO) -> None:
        """Check what follows the data, and set ``finished`` if it is intact, else ``stop_reason`` to what is wrong.

        Args:
            content: the content of the record that ends the data.
            file: the file, positioned after this record.
        """
        (crc,) = _CRC.unpack(content)
        summary = file.read()
        self._record_end += len(summary)
        footer = len(summary) - len(MAGIC) - RECORD_HEADER.size - _FOOTER.size
        if footer < 0 or not summary.endswith(MAGIC):
            self.stop_reason = "cut off within its index"
            return
        opcode, length = RECORD_HEADER.unpack_from(summary, footer)
        footer_content = footer + RECORD_HEADER.size
        _, _, summary_crc = _FOOTER.unpack_from(summary, footer_content)
        summary_end = footer_content + _FOOTER.size - _CRC.size  # the checksum covers all before itself
        if (opcode, length) != (Opcode.FOOTER, _FOOTER.size):
            self.stop_reason = "damaged: its footer is invalid"
        elif summary_crc not in (0, zlib.crc32(summary[:summary_end])):
            self.stop_reason = "damaged: its index has a wrong checksum"
        elif crc not in (0, self.crc) and not self.gaps:  # 0: its writer kept none
            self.stop_reason = "damaged: it has a wrong checksum"
        else:
            self.finished = not self.gaps

    def _read_index(self, file: BinaryIO, size: int) -> list[bytes]:
        """Return the contents of the index records that follow a chunk, and move the file to the record after them.

        Args:
            file: the file, positioned after the chunk.
            size: the size of the file in bytes.
        """
        index_records: list[bytes] = []
        position = self._record_end
        while len(head := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
            opcode, length = RECORD_HEADER.unpack(head)
            end = position + RECORD_HEADER.size + length
            if opcode != Opcode.MESSAGE_INDEX or end > size or length > MAX_RECORD_BYTES:
                break
            content = file.read(length)
            try:
                check_record_size(opcode, content)
            except (ValueError, struct.error):
                break  # read again as a separate record, and refused there
            index_records.append(content)
            self.crc = zlib.crc32(content, zlib.crc32(head, self.crc))
            position = end
        file.seek(position)
        self._record_end = position
        return index_records

    def _read_chunk_messages(self, data: bytes, index: list[bytes]) -> ChunkMessages:
        """Return the messages in a chunk's uncompressed data, and record the channels and gaps that it reveals."""
        records = split_chunk(data, index)
        for opcode, content in records.other_records:
            self._declare_record(opcode, content)
        missing = self._find_gaps(self._list_own_numbers(records))
        self.missing += missing
        sequences = records.heads["sequence"]
        breaks = [int(np.flatnonzero(sequences == gap.last + 1)[0]) for gap in missing]
        return ChunkMessages(records, self.channels, breaks=breaks)

    def _list_own_numbers(self, records: ChunkRecords) -> NDArray[np.uint32]:
        """Return the sequence numbers of our messages in a chunk, without those of other programs' messages.

        A message on an unknown topic counts as ours, of a newer version, if its number lies between two of ours.
        """
        sequences: NDArray[np.uint32] = records.heads["sequence"]
        unknown_channels = [number for number, channel in self.channels.items() if find_topic(channel.topic) is None]
        if not unknown_channels and not self._between:
            return sequences
        is_unknown = np.isin(records.heads["channel"], unknown_channels)
        if not is_unknown.any() and not self._between:
            return sequences
        numbers: list[int] = []
        last = self._sequence
        for sequence, on_unknown_topic in zip(sequences.tolist(), is_unknown.tolist(), strict=True):
            if on_unknown_topic:
                if sequence == last + len(self._between) + 1:
                    self._between.append(sequence)
                continue
            numbers += [number for number in self._between if number < sequence]
            numbers.append(sequence)
            last = sequence
            self._between = []
        return np.array(numbers, np.uint32)

    def _find_gaps(self, sequences: NDArray[np.uint32]) -> list[MissingMessages]:
        """Return the messages missing before a chunk or in it, and continue counting after its last message.

        Args:
            sequences: the sequence numbers of our messages in the chunk.

        Raises:
            ValueError: if the messages are out of order.
        """
        expected = range(self._sequence + 1, self._sequence + 1 + len(sequences))
        is_short_run = len(sequences) < _FEW and sequences.tolist() == list(expected)
        if is_short_run or np.array_equal(sequences, np.array(expected)):
            self._sequence += len(sequences)  # the common case
            return []
        numbers = sequences[sequences > 0].astype(np.int64)  # previews have 0
        if not len(numbers):
            return []
        before = np.concatenate([[self._sequence], numbers[:-1]])
        differences = np.where(numbers == 1, 1, numbers - before)  # number 1 begins the next segment
        if (differences < 1).any():
            wrong = int(np.argmin(differences))
            raise ValueError(
                f"message {numbers[wrong]} follows message {before[wrong]}; messages are missing or out of order"
            )
        self._sequence = int(numbers[-1])
        return [
            MissingMessages(self._segment, int(before[index]) + 1, int(numbers[index]) - 1)
            for index in np.flatnonzero(differences > 1).tolist()
        ]

    def _declare_record(self, opcode: int, content: bytes) -> None:
        """Add the schema or the channel that a record declares; ignore a record of another kind.

        Args:
            opcode: the kind of the record.
            content: its content.
        """
        if opcode == Opcode.CHANNEL:
            channel = _parse_channel(content)
            self.channels[channel.id] = channel
        elif opcode == Opcode.SCHEMA:
            schema = _parse_schema(content)
            self.schemas[schema.id] = schema


@lru_cache(maxsize=64)  # most logs declare the same channels
def _parse_channel(content: bytes) -> Channel:
    channel: Channel = Channel.read(as_data_stream(content))
    return channel


@lru_cache(maxsize=64)
def _parse_schema(content: bytes) -> Schema:
    schema: Schema = Schema.read(as_data_stream(content))
    return schema


def _parse_number(text: str) -> int:
    """Return a number of fewer than ten digits; 0 for any other text."""
    if text.isdecimal() and len(text) < 10:
        return int(text)
    return 0
