"""A log at a glance: whose it is and what is in it, from its first kilobytes and its summary; no message is read."""

import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, MetadataIndex, Statistics
from mcap.writer import MCAP0_MAGIC as MAGIC

from minihuman.log.topics import END_METADATA, FACTS_METADATA, SEGMENT_METADATA

_HEAD = struct.Struct("<BQ")  # of a record: its kind, how many bytes follow
_FOOTER = struct.Struct("<QQI")  # where the summary begins, where its offsets do, its checksum
_CRC = struct.Struct("<I")
_FIRST_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Glance:
    """What a finished log's summary says, its checksums having been looked at; nothing is checked by the messages."""

    starts: tuple[dict[str, str], ...]  # one a segment, in order
    facts: tuple[dict[str, str], ...]  # of the station, one a segment
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
            if kind == Opcode.METADATA:
                found = Metadata.read(ReadDataStream(BytesIO(content)))
                if found.name == SEGMENT_METADATA:
                    return dict(found.metadata)
    return {}


def glance(path: Path) -> Glance | None:
    """Read a finished log's summary; None where it has none, or a checksum says that the file is not as it was."""
    try:
        data = path.read_bytes()
        begin = _checked_summary(data)
        return None if begin is None else _glance(data, begin)
    except (OSError, struct.error, ValueError, EndOfFile):
        return None


def _checked_summary(data: bytes) -> int | None:
    """Where the summary begins; None unless the checksums of data and summary are there and hold."""
    at = len(data) - len(MAGIC) - _FOOTER.size - _HEAD.size
    if not data.endswith(MAGIC) or at < 0 or _HEAD.unpack_from(data, at) != (Opcode.FOOTER, _FOOTER.size):
        return None
    begin, _, of_summary = _FOOTER.unpack_from(data, at + _HEAD.size)
    ends = begin - _HEAD.size - _CRC.size
    if ends < len(MAGIC) or _HEAD.unpack_from(data, ends) != (Opcode.DATA_END, _CRC.size):
        return None
    (of_data,) = _CRC.unpack_from(data, begin - _CRC.size)
    view = memoryview(data)
    whole = of_data and zlib.crc32(view[:ends]) == of_data
    last = len(data) - len(MAGIC) - _CRC.size
    return begin if whole and zlib.crc32(view[begin:last]) == of_summary else None


def _glance(data: bytes, begin: int) -> Glance:
    topics: dict[int, str] = {}
    found: dict[str, list[dict[str, str]]] = {SEGMENT_METADATA: [], FACTS_METADATA: [], END_METADATA: []}
    counts = Counter[str]()
    for kind, content in _records(data[begin:]):
        stream = ReadDataStream(BytesIO(content))
        if kind == Opcode.CHANNEL:
            channel = Channel.read(stream)
            topics[channel.id] = channel.topic
        elif kind == Opcode.STATISTICS:
            numbers = Statistics.read(stream).channel_message_counts
            counts.update({topics[channel]: count for channel, count in numbers.items() if channel in topics})
        elif kind == Opcode.METADATA_INDEX:
            index = MetadataIndex.read(stream)
            if index.name in found:
                found[index.name].append(_metadata(data[index.offset + _HEAD.size : index.offset + index.length]))
    starts, facts, ends = (tuple(found[name]) for name in (SEGMENT_METADATA, FACTS_METADATA, END_METADATA))
    return Glance(starts, facts, ends, counts)


def _metadata(content: bytes) -> dict[str, str]:
    found: dict[str, str] = Metadata.read(ReadDataStream(BytesIO(content))).metadata
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
