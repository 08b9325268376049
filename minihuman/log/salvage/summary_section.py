"""Reads a log's first and last kilobytes, which identify its session and summarize its content; no message is read.

The summary section of a finished log is trusted only if its checksum is correct. The rest of the file is not read:
readers of messages check it, and ``verify`` checks the whole file. The module imports neither protobuf nor NumPy, so
that ``status`` starts quickly.
"""

import os
import struct
import zlib
from collections import Counter
from collections.abc import Container, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode

from minihuman.errors import LogError
from minihuman.log.names import END_METADATA, FACTS_METADATA, SEGMENT_METADATA
from minihuman.log.paths import MAGIC, open_regular_file
from minihuman.operating_system import read_at

_HEAD = struct.Struct("<BQ")  # of a record: its kind and length
_FOOTER = struct.Struct("<QQI")  # position of the summary, position of its offsets, its checksum
_CRC = struct.Struct("<I")
_DATA_END_BYTES = _HEAD.size + _CRC.size  # size of the record that ends the data, before the summary
_LENGTH = struct.Struct("<I")
_LENGTH_BYTES = _LENGTH.size
_unpack_length = _LENGTH.unpack_from
_CHANNEL = struct.Struct("<HHI")  # its number, its schema's number, length of its topic
_PLACE = struct.Struct("<QQ")  # of a record in an index: its position and length
_COUNT = struct.Struct("<HQ")  # a channel's number and its count of messages
_STATISTICS_BYTES = 46  # of a statistics record before the counts
_FIRST_BYTES = 4096
_LAST_BYTES = 48 * 1024  # most summaries are shorter
_INDEXED_METADATA = (SEGMENT_METADATA, FACTS_METADATA, END_METADATA)
_METADATA = frozenset({int(Opcode.METADATA)})
_SUMMARY_OPCODES = frozenset(map(int, (Opcode.CHANNEL, Opcode.STATISTICS, Opcode.METADATA_INDEX)))  # to read
_NAMES = {_LENGTH.pack(len(name)) + name.encode(): name for name in _INDEXED_METADATA}  # by their encoding in an index


@dataclass(frozen=True, slots=True)
class LogSummary:
    """A finished log's summary, whose checksum is correct, and the metadata that it refers to."""

    starts: tuple[dict[str, str], ...]  # per segment, in order
    facts: tuple[dict[str, str], ...]  # facts about the station, per segment
    ends: tuple[dict[str, str], ...]  # how each finished segment ended
    counts: Counter[str]  # messages per topic


def all_ended_cleanly(starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]]) -> bool:
    """Return whether every segment that started also ended normally, from the metadata of starts and ends."""
    return len(ends) == len(starts) and all(end["clean"] == "true" for end in ends)


def read_first_metadata(path: Path) -> dict[str, str]:
    """Return a log's first segment metadata (study, participant, session, start); empty if it cannot be read."""
    try:
        with open_regular_file(path) as file:
            start = file.read(_FIRST_BYTES)
    except (OSError, LogError):
        return {}
    if start.startswith(MAGIC):
        with suppress(struct.error, ValueError):  # it may be damaged, since metadata has no checksum
            for _, content in _list_records(start, len(MAGIC), among=_METADATA):
                name, facts = _parse_metadata(content)
                if name == SEGMENT_METADATA:
                    return facts
    return {}


def read_summary(path: Path) -> LogSummary | None:
    """Return a finished log's summary.

    None if the file cannot be read or has no summary, or if the summary's checksum or a record that it points to is
    wrong.
    """
    try:
        with open_regular_file(path) as file:
            fd = file.fileno()
            size = os.fstat(fd).st_size
            data = read_at(fd, _LAST_BYTES, max(0, size - _LAST_BYTES))
            begin = _find_summary_begin(data, size)
            if begin is None:
                return None
            needed_bytes = size - begin + _DATA_END_BYTES
            if needed_bytes > len(data):
                data = read_at(fd, needed_bytes, begin - _DATA_END_BYTES)
            return _parse_summary(fd, data[len(data) - needed_bytes :])
    except (OSError, LogError, struct.error, ValueError):
        return None


def _find_summary_begin(data: bytes, size: int) -> int | None:
    """Return the byte at which a file's summary begins; None if the file does not end in a footer.

    Args:
        data: the file's last bytes.
        size: the size of the file in bytes.
    """
    footer = len(data) - len(MAGIC) - _FOOTER.size - _HEAD.size
    if not data.endswith(MAGIC) or footer < 0 or _HEAD.unpack_from(data, footer) != (Opcode.FOOTER, _FOOTER.size):
        return None
    begin: int = _FOOTER.unpack_from(data, footer + _HEAD.size)[0]
    footer_in_file = size - (len(data) - footer)
    if len(MAGIC) + _DATA_END_BYTES <= begin <= footer_in_file:
        return begin
    return None


def _parse_summary(fd: int, data: bytes) -> LogSummary | None:
    """Parse a file's summary; return None if it is not valid.

    Args:
        fd: the file's descriptor, from which the metadata that the summary refers to are read.
        data: the file's last bytes, beginning with the record that ends the data section.
    """
    if _HEAD.unpack_from(data) != (Opcode.DATA_END, _CRC.size):
        return None
    begin = _DATA_END_BYTES
    end = len(data) - len(MAGIC) - _CRC.size
    (stated_crc,) = _CRC.unpack_from(data, end)
    if zlib.crc32(memoryview(data)[begin:end]) != stated_crc:
        return None
    topics: dict[int, str] = {}
    facts_by_name: dict[str, list[dict[str, str]]] = {name: [] for name in _INDEXED_METADATA}
    counts = Counter[str]()
    for kind, content in _list_records(data, begin, among=_SUMMARY_OPCODES):
        if kind == Opcode.CHANNEL:
            number, _, length = _CHANNEL.unpack_from(content)
            topics[number] = content[_CHANNEL.size :][:length].decode()
        elif kind == Opcode.STATISTICS:
            for number, count in _COUNT.iter_unpack(content[_STATISTICS_BYTES:]):
                counts[topics.get(number, "")] += count
        elif kind == Opcode.METADATA_INDEX:
            name = _NAMES.get(content[_PLACE.size :])
            if name is not None:
                facts = _read_indexed_metadata(fd, content, name)
                if facts is None:
                    return None
                facts_by_name[name].append(facts)
    starts, station_facts, ends = (tuple(facts_by_name[name]) for name in _INDEXED_METADATA)
    return LogSummary(starts, station_facts, ends, counts)


def _read_indexed_metadata(fd: int, index: bytes, name: str) -> dict[str, str] | None:
    """Return the facts of the metadata record to which an index record points; None if another record is there.

    Args:
        fd: the file's descriptor.
        index: the content of the index record.
        name: the name of the metadata that the index states.
    """
    offset, length = _PLACE.unpack_from(index)
    record = read_at(fd, length, offset)
    if _HEAD.unpack_from(record) != (Opcode.METADATA, length - _HEAD.size):
        return None
    stated_name, facts = _parse_metadata(record[_HEAD.size :])
    return facts if stated_name == name else None


def _parse_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Return a metadata record's name and facts, ten times as fast as the library's reader."""
    name, position = _read_text(content, 0)
    (map_bytes,) = _unpack_length(content, position)
    position += _LENGTH_BYTES
    end = position + map_bytes
    texts = list[str]()
    while position < end:  # keys and values alternate; ``_read_text`` is inlined for speed
        begin = position + _LENGTH_BYTES
        position = begin + _unpack_length(content, position)[0]
        texts.append(content[begin:position].decode())
    return name, dict(zip(texts[::2], texts[1::2], strict=True))


def _read_text(content: bytes, position: int) -> tuple[str, int]:
    """Return the text whose length is stated at a position, and the position after the text."""
    begin = position + _LENGTH_BYTES
    end = begin + _unpack_length(content, position)[0]
    return content[begin:end].decode(), end


def _list_records(data: bytes, position: int, *, among: Container[int]) -> Iterator[tuple[int, bytes]]:
    """Yield the kind and the content of every whole record of the given kinds.

    Args:
        data: bytes of a file.
        position: the position in ``data`` at which a record begins.
        among: the kinds of records to yield.
    """
    size = len(data)
    while position + _HEAD.size <= size:
        kind, length = _HEAD.unpack_from(data, position)
        begin = position + _HEAD.size
        end = begin + length
        if end > size:
            return
        if kind in among:
            yield kind, data[begin:end]
        position = end
