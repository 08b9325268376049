"""Parses the records of an MCAP file, and finds where each message of a chunk begins and ends.

A record is intact if it is framed, of a plausible size, and has the checksum that it states.
"""

import mmap
import re
import struct
import zlib
from collections.abc import Container, Iterator, Mapping, Sequence
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata
from numpy.typing import NDArray

ByteOffsets = NDArray[np.int64]

RECORD_HEADER = struct.Struct("<BQ")  # opcode, length
_LENGTH = struct.Struct("<Q")
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
_INDEX_HEAD = struct.Struct("<HI")  # channel, bytes of entries
_INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("place", "<u8")])


class LogMessage(NamedTuple):
    """One message with its channel. Times are wall clock times in nanoseconds since 1970."""

    channel: Channel
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class TopicMessages(NamedTuple):
    """A chunk's messages on one topic; each array has shape (n,)."""

    topic: str
    places: ByteOffsets  # positions among the chunk's messages
    begins: ByteOffsets  # of the payloads, in the chunk's bytes
    ends: ByteOffsets


class ChunkRecords(NamedTuple):
    """A chunk's records: the positions and heads of its messages, and all other records."""

    data: bytes
    starts: ByteOffsets  # (n,) positions of the messages in the data
    heads: NDArray[np.void]  # (n,) their heads
    other_records: list[tuple[int, bytes]]  # opcode and content


def split_chunk(data: bytes, index: Sequence[bytes]) -> ChunkRecords:
    """Split a chunk's bytes into records.

    The index records that follow a chunk save walking from one message to the next. If there are none, or they do not
    match, the records are walked.

    Args:
        data: the uncompressed bytes.
        index: the contents of the index records; empty if there are none.

    Raises:
        ValueError: if the bytes are not records.
    """
    try:
        starts = _find_starts(data, _read_index(index))
    except (ValueError, IndexError):
        starts = _find_starts(data, np.zeros(0, np.int64))
    is_message = _view_at_each_byte(data, np.dtype("u1"))[starts] == Opcode.MESSAGE
    other_records = []
    for start in starts[~is_message].tolist():
        opcode, length = RECORD_HEADER.unpack_from(data, start)
        other_records.append((opcode, data[start + RECORD_HEADER.size : start + RECORD_HEADER.size + length]))
    starts = starts[is_message]
    return ChunkRecords(data, starts, _view_at_each_byte(data, _MESSAGE)[starts], other_records)


class ChunkMessages:
    """The messages of one chunk in file order, each read when it is accessed.

    Raises:
        ValueError: if a message is on a channel that was not declared.
    """

    def __init__(self, records: ChunkRecords, channels: Mapping[int, Channel], *, breaks: Sequence[int] = ()) -> None:
        self.breaks = breaks  # indices of messages before which others are missing
        self.data = records.data
        self._heads = records.heads
        self._begins = records.starts + _MESSAGE.itemsize  # of the payloads
        self._ends = records.starts + RECORD_HEADER.size + records.heads["length"].astype(np.int64)
        self._channels: dict[int, Channel] = {}
        for number in sorted(set(records.heads["channel"].tolist())):
            if number not in channels:
                raise ValueError(f"channel {number} is not declared")
            self._channels[number] = channels[number]

    def __len__(self) -> int:
        return len(self._heads)

    @property
    def times(self) -> tuple[int, int] | None:
        """Return the first and the last log time of the messages; None if there are no messages."""
        log_times = self._heads["log_time"]
        if len(self):
            return (int(log_times.min()), int(log_times.max()))
        return None

    def times_at(self, places: ByteOffsets) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """Return the log times and the publish times of the messages at these positions in the chunk."""
        return self._heads["log_time"][places], self._heads["publish_time"][places]

    def __iter__(self) -> Iterator[LogMessage]:
        heads = self._heads[["channel", "sequence", "log_time", "publish_time"]].tolist()
        for begin, end, (channel, sequence, log_time, publish_time) in zip(
            self._begins.tolist(), self._ends.tolist(), heads, strict=True
        ):
            yield LogMessage(self._channels[channel], sequence, log_time, publish_time, self.data[begin:end])

    def count(self, topic: str) -> int:
        """Return the number of messages on a topic."""
        return sum(len(messages.places) for messages in self.by_topic(among=(topic,)))

    def by_topic(self, *, among: Container[str]) -> Iterator[TopicMessages]:
        """Yield the positions of the chunk's messages on each topic in ``among`` that occurs in the chunk."""
        numbers = self._heads["channel"].copy()  # contiguous, since it is scanned for each topic
        for number, channel in self._channels.items():
            if channel.topic in among:
                places = np.flatnonzero(numbers == number)
                yield TopicMessages(channel.topic, places, self._begins[places], self._ends[places])


def _view_at_each_byte(data: bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an array with the value at each position of the data, so that many positions can be read at once."""
    return np.ndarray(max(0, len(data) + 1 - dtype.itemsize), dtype, data, strides=(1,))


def _read_index(index: Sequence[bytes]) -> ByteOffsets:
    """Return where a chunk's messages begin, in ascending order, according to the index records that follow it."""
    entries = [np.frombuffer(record, _INDEX_ENTRY, offset=_INDEX_HEAD.size) for record in index]
    return np.sort(np.concatenate([np.zeros(0, np.int64), *(entry["place"].astype(np.int64) for entry in entries)]))


def _find_starts(data: bytes, indexed_starts: ByteOffsets) -> ByteOffsets:
    """Return where each record begins, in ascending order.

    Args:
        data: the bytes of a chunk.
        indexed_starts: where those records begin that are in the index, in ascending order.

    Raises:
        ValueError: if the bytes between these records are not records.
        IndexError: if the index points outside the data.
    """
    lengths = _view_at_each_byte(data, np.dtype("<u8"))[indexed_starts + 1].astype(np.int64)  # after the opcode
    indexed_ends = indexed_starts + RECORD_HEADER.size + lengths
    gap_begins = np.concatenate([[0], indexed_ends])
    gap_ends = np.concatenate([indexed_starts, [len(data)]])
    gaps = np.flatnonzero(gap_begins != gap_ends)
    walked = (_walk_records(data, int(gap_begins[gap]), int(gap_ends[gap])) for gap in gaps)
    return np.sort(np.concatenate([indexed_starts, *walked]))


def _walk_records(data: bytes, begin: int, end: int) -> ByteOffsets:
    """Return where each record between two positions begins.

    Raises:
        ValueError: if the last record does not end at ``end``.
    """
    starts: list[int] = []
    position = begin
    unpack_length = _LENGTH.unpack_from
    header_bytes = RECORD_HEADER.size
    while position < end:
        starts.append(position)
        position += header_bytes + unpack_length(data, position + 1)[0]  # the length follows the opcode
    if position != end:
        raise ValueError("a record extends past the end of its chunk")
    return np.array(starts, np.int64)


MAX_RECORD_BYTES = 64 * 1024 * 1024  # the largest record allowed, packed or not; ours are a thousand times smaller
MAX_CANDIDATES = 256  # possible record starts that are tried before the rest of a damaged file is given up
_RECORD_START = re.compile(rb"[\x06\x09\x0c\x0f]....\x00\x00\x00\x00", re.DOTALL)  # of a record shorter than 4 GiB
_DATA_END = struct.Struct("<BQI")
_TIMES = struct.Struct("<QQ")
_TEXT_LENGTH = struct.Struct("<I")
_CHUNK_BYTES = 40  # size of a chunk without its records and the name of their compression
_ATTACHMENT_BYTES = 36  # size of an attachment without its texts and data
_ZSTD = "zstd"


def parse_chunk(content: bytes) -> bytes:
    """Return the uncompressed records in a chunk's content.

    Raises:
        ValueError: if the checksum is wrong, the content does not have its stated size, or the chunk is, or claims to
            be, larger than any chunk may be.
    """
    chunk: Chunk = Chunk.read(as_data_stream(content))
    if _CHUNK_BYTES + len(chunk.compression.encode()) + len(chunk.data) != len(content):
        raise ValueError("a chunk differs from its stated size")
    size = chunk.uncompressed_size
    data = chunk.data
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk has {size} bytes; at most {MAX_RECORD_BYTES} are allowed")
    if chunk.compression == _ZSTD:
        data = _decompress_chunk(data, size)
    if len(data) != size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk has a wrong checksum")
    return data


def parse_chunk_times(content: bytes) -> tuple[int, int]:
    """Return the first and the last log time that a chunk states, in nanoseconds since 1970, given its content."""
    first, last = _TIMES.unpack_from(content)
    return first, last


def decompress_zstd(data: bytes) -> bytes:
    """Decompress zstd data, up to the size that a record may have.

    Raises:
        ValueError: if the result would be larger, or the data are not zstd.
    """
    try:
        return _decompress_chunk(data, zstandard.get_frame_parameters(data).content_size)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _decompress_chunk(data: bytes, size: int) -> bytes:
    """Decompress a zstd frame of ``size`` bytes; the result may be longer or shorter if the frame states no size.

    Raises:
        ValueError: if the size is larger than a record may be, or the frame states another size.
        zstandard.ZstdError: if the data are not zstd.
    """
    stated = zstandard.get_frame_parameters(data).content_size
    if not 0 <= size <= MAX_RECORD_BYTES:
        raise ValueError(f"compressed data expands to {size} bytes; at most {MAX_RECORD_BYTES} are allowed")
    if stated == size:
        return zstandard.decompress(data)
    if stated != zstandard.CONTENTSIZE_UNKNOWN:
        raise ValueError(f"a chunk of {size} bytes holds a zstd frame of {stated} bytes")
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        content: bytes = reader.read(size + 1)  # one byte more than stated shows that the size is wrong
    return content


def find_next_record(view: mmap.mmap, begin: int) -> int | None:
    """Return the position of the next intact record of a file, at or after position ``begin``.

    None if there is none, or if ``MAX_CANDIDATES`` places that look like the start of a record are not intact records.
    """
    n_tried = 0
    while (candidate := _RECORD_START.search(view, begin)) is not None and n_tried < MAX_CANDIDATES:
        begin = candidate.start()
        try:
            is_whole = _is_whole_record(view, begin)
        except Exception:  # garbage can make a parser raise anything
            is_whole = False
        if is_whole:
            return begin
        n_tried += 1
        begin += 1
    return None


def _is_whole_record(view: mmap.mmap, begin: int) -> bool:
    """Return whether an intact record begins at a byte; any error that a parser raises means that none does."""
    opcode, length = RECORD_HEADER.unpack_from(view, begin)
    end = begin + RECORD_HEADER.size + length
    if length > MAX_RECORD_BYTES or end > len(view):
        return False
    content = view[begin + RECORD_HEADER.size : end]
    match opcode:
        case Opcode.CHUNK:
            parse_chunk(content)
            return True
        case Opcode.ATTACHMENT:
            parse_attachment(content)
            return True
        case Opcode.METADATA:  # it has no checksum, so its name must do
            name: str = parse_metadata(content).name
            return name.startswith("minihuman.")
        case Opcode.DATA_END:
            return bool(length == _DATA_END.size - RECORD_HEADER.size and end < len(view))
    return False


def parse_attachment(content: bytes) -> Attachment:
    """Parse the attachment in a record's content.

    Raises:
        ValueError: if the checksum is wrong, or the content does not have its stated size.
    """
    (crc,) = struct.unpack("<I", content[-4:])
    if crc not in (0, zlib.crc32(content[:-4])):
        raise ValueError("an attachment has a wrong checksum")
    attachment: Attachment = Attachment.read(as_data_stream(content))
    text_bytes = len(attachment.name.encode()) + len(attachment.media_type.encode())
    if _ATTACHMENT_BYTES + text_bytes + len(attachment.data) != len(content):
        raise ValueError("an attachment differs from its stated size")
    return attachment


def check_record_size(opcode: int, content: bytes) -> None:
    """Check the stated size of a file's header or of a chunk's index, which have no checksum.

    Raises:
        ValueError: if the content does not have its stated size.
    """
    if opcode == Opcode.MESSAGE_INDEX:
        _, length = _INDEX_HEAD.unpack_from(content)
        stated = _INDEX_HEAD.size + length
    else:  # a header: two texts
        (profile,) = _TEXT_LENGTH.unpack_from(content)
        (library,) = _TEXT_LENGTH.unpack_from(content, _TEXT_LENGTH.size + profile)
        stated = 2 * _TEXT_LENGTH.size + profile + library
    if stated != len(content):
        raise ValueError("a record differs from its stated size")


def parse_metadata(content: bytes) -> Metadata:
    """Parse the metadata in a record's content.

    Raises:
        ValueError: if the content does not have its stated size.
    """
    metadata: Metadata = Metadata.read(as_data_stream(content))
    texts = (metadata.name, *metadata.metadata.keys(), *metadata.metadata.values())
    map_length_bytes = _TEXT_LENGTH.size
    size = map_length_bytes + sum(_TEXT_LENGTH.size + len(text.encode()) for text in texts)
    if size != len(content):
        raise ValueError("a metadata record's size differs from the size stated for it")
    return metadata


def as_data_stream(content: bytes) -> ReadDataStream:
    """Wrap bytes in the stream that the readers of the mcap library require."""
    return ReadDataStream(BytesIO(content))
