"""A log at a glance: whose it is and what is in it, from its first kilobytes and its summary; no message is read."""

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, MetadataIndex, Statistics
from mcap.writer import MCAP0_MAGIC as MAGIC

from minihuman.log.topics import END_METADATA, SEGMENT_METADATA

_HEAD = struct.Struct("<BQ")  # of a record: its kind, how many bytes follow
_FOOTER = struct.Struct("<QQI")  # where the summary begins, where its offsets do, its checksum
_FIRST_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Glance:
    """What a finished log's summary says. Nothing of it is checked against the messages."""

    starts: tuple[dict[str, str], ...]  # a segment's facts, in order
    ends: tuple[dict[str, str], ...]  # how each finished segment ended
    counts: Counter[str]  # messages a topic


def first_facts(path: Path) -> dict[str, str]:
    """What a log's first segment says of itself: study, participant, session, start; {} where that cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(_FIRST_BYTES)
    except OSError:
        return {}
    if start.startswith(MAGIC):
        for kind, content in _records(start[len(MAGIC) :]):
            if kind == Opcode.METADATA and (found := _metadata(content)).name == SEGMENT_METADATA:
                return found.metadata
    return {}


def glance(path: Path) -> Glance | None:
    """Read a finished log's summary; None where it has none, or it cannot be understood."""
    try:
        with path.open("rb") as file:
            return _glance(file)
    except (OSError, struct.error, ValueError, EOFError):
        return None


def _glance(file: BinaryIO) -> Glance | None:
    end = file.seek(0, 2) - len(MAGIC)
    file.seek(max(0, end - _HEAD.size - _FOOTER.size))
    tail = file.read()
    if not tail.endswith(MAGIC) or _HEAD.unpack_from(tail) != (Opcode.FOOTER, _FOOTER.size):
        return None
    begin, _, _ = _FOOTER.unpack_from(tail, _HEAD.size)
    if not begin:
        return None
    file.seek(begin)
    topics: dict[int, str] = {}
    starts: list[dict[str, str]] = []
    ends: list[dict[str, str]] = []
    counts = Counter[str]()
    for kind, content in _records(file.read(end - begin)):
        stream = ReadDataStream(BytesIO(content))
        if kind == Opcode.CHANNEL:
            channel = Channel.read(stream)
            topics[channel.id] = channel.topic
        elif kind == Opcode.STATISTICS:
            numbers = Statistics.read(stream).channel_message_counts
            counts.update({topics[channel]: count for channel, count in numbers.items() if channel in topics})
        elif kind == Opcode.METADATA_INDEX:
            index = MetadataIndex.read(stream)
            if index.name in (SEGMENT_METADATA, END_METADATA):
                (starts if index.name == SEGMENT_METADATA else ends).append(_metadata_at(file, index))
    return Glance(tuple(starts), tuple(ends), counts)


def _metadata_at(file: BinaryIO, index: MetadataIndex) -> dict[str, str]:
    file.seek(index.offset + _HEAD.size)
    return _metadata(file.read(index.length - _HEAD.size)).metadata


def _metadata(content: bytes) -> Metadata:
    found: Metadata = Metadata.read(ReadDataStream(BytesIO(content)))
    return found


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Every whole record's kind and content."""
    at = 0
    while at + _HEAD.size <= len(data):
        kind, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + length > len(data):
            return
        yield kind, data[at : at + length]
        at += length
