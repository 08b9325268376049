"""A log at a glance: whose it is and what is in it, from its first kilobytes and its summary; no message is read."""

import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC as MAGIC

from minihuman.errors import LogError
from minihuman.log.regular import open_regular
from minihuman.log.topics import END_METADATA, FACTS_METADATA, SEGMENT_METADATA

_HEAD = struct.Struct("<BQ")  # of a record: its kind, how many bytes follow
_FOOTER = struct.Struct("<QQI")  # where the summary begins, where its offsets do, its checksum
_CRC = struct.Struct("<I")
_LENGTH = struct.Struct("<I")
_CHANNEL = struct.Struct("<HHI")  # its number, its schema's, how long its topic is
_PLACE = struct.Struct("<QQ")  # of a record that an index names: where it begins, how many bytes it has
_COUNT = struct.Struct("<HQ")  # a channel, its messages
_STATISTICS_BYTES = 46  # before the counts
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
        with open_regular(path) as file:
            start = file.read(_FIRST_BYTES)
    except (OSError, LogError):
        return {}
    if start.startswith(MAGIC):
        for kind, content in _records(start[len(MAGIC) :]):
            if kind == Opcode.METADATA:
                name, facts = _metadata(content)
                if name == SEGMENT_METADATA:
                    return facts
    return {}


def glance(path: Path) -> Glance | None:
    """Read a finished log's summary; None where it has none, or a checksum says that the file is not as it was."""
    try:
        with open_regular(path) as file:
            data = file.read()
        begin = _checked_summary(data)
        return None if begin is None else _glance(data, begin)
    except (OSError, struct.error, ValueError):
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
        if kind == Opcode.CHANNEL:
            number, _, length = _CHANNEL.unpack_from(content)
            topics[number] = content[_CHANNEL.size : _CHANNEL.size + length].decode()
        elif kind == Opcode.STATISTICS:
            for number, count in _COUNT.iter_unpack(content[_STATISTICS_BYTES:]):
                counts[topics.get(number, "")] += count
        elif kind == Opcode.METADATA_INDEX:
            offset, length = _PLACE.unpack_from(content)
            name, said = _metadata(data[offset + _HEAD.size : offset + length])
            if name in found:
                found[name].append(said)
    starts, facts, ends = (tuple(found[name]) for name in (SEGMENT_METADATA, FACTS_METADATA, END_METADATA))
    return Glance(starts, facts, ends, counts)


def _metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """A metadata record's name and facts, field by field: the library's own reader takes ten times as long."""
    name, at = _text(content, 0)
    (length,) = _LENGTH.unpack_from(content, at)
    at += _LENGTH.size
    end, facts = at + length, {}
    while at < end:
        key, at = _text(content, at)
        facts[key], at = _text(content, at)
    return name, facts


def _text(content: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and the place behind it."""
    begin = at + _LENGTH.size
    end = begin + _LENGTH.unpack_from(content, at)[0]
    return content[begin:end].decode(), end


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
