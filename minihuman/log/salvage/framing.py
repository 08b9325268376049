"""Decide which bytes are a whole MCAP record: framed, of a plausible size, with the checksum that it states.

Where a file is damaged, the next whole record after the damage is searched for here.
"""

import mmap
import re
import struct
import zlib
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, Metadata

from minihuman.log.salvage.chunk import RECORD_HEADER

MAX_RECORD_BYTES = 64 * 1024 * 1024  # of a record, packed or unpacked; ours are a thousand times smaller
MAX_CANDIDATES = 256  # candidates whose checksum is wrong, before a damaged file's rest is given up
_RECORD_START = re.compile(rb"[\x06\x09\x0c\x0f]....\x00\x00\x00\x00", re.DOTALL)  # shorter than 4 GiB
_DATA_END = struct.Struct("<BQI")
_TIMES = struct.Struct("<QQ")
_LENGTH = struct.Struct("<I")
_INDEX = struct.Struct("<HI")  # channel, bytes of entries
_CHUNK_BYTES = 40  # of a chunk without its records and the name of their compression
_ATTACHMENT_BYTES = 36  # of an attachment without its texts and data
_ZSTD = "zstd"


def parse_chunk(content: bytes) -> bytes:
    """The records in a chunk's content.

    Raises:
        ValueError: if its checksum is wrong, there is more in it than it says, or it is or says it is larger than any
            chunk may be.
    """
    chunk: Chunk = Chunk.read(as_data_stream(content))
    if _CHUNK_BYTES + len(chunk.compression.encode()) + len(chunk.data) != len(content):
        raise ValueError("a chunk differs from its stated size")
    size, data = chunk.uncompressed_size, chunk.data
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk has {size} bytes; at most {MAX_RECORD_BYTES} are allowed")
    if chunk.compression == _ZSTD:
        data = _decompress_chunk(data, size)
    if len(data) != size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk has a wrong checksum")
    return data


def parse_chunk_times(content: bytes) -> tuple[int, int]:
    """The first and the last log time that a chunk says it holds."""
    first, last = _TIMES.unpack_from(content)
    return first, last


def decompress_zstd(data: bytes) -> bytes:
    """What was packed with zstd, up to the size that a record may have.

    Raises:
        ValueError: if it is more, or nothing that zstd has packed.
    """
    try:
        return _decompress_chunk(data, zstandard.get_frame_parameters(data).content_size)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _decompress_chunk(data: bytes, size: int) -> bytes:
    stated = zstandard.get_frame_parameters(data).content_size
    if not 0 <= size <= MAX_RECORD_BYTES:
        raise ValueError(f"compressed data expands to {size} bytes; at most {MAX_RECORD_BYTES} are allowed")
    if stated == size:
        return zstandard.decompress(data)
    if stated != zstandard.CONTENTSIZE_UNKNOWN:
        raise ValueError(f"a chunk of {size} bytes holds a zstd frame of {stated} bytes")
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        found: bytes = reader.read(size + 1)  # one more than it says is too much already
    return found


def find_next_record(view: mmap.mmap, begin: int) -> int | None:
    """The byte at which the next whole record begins, from a byte on; None if none is found soon."""
    tries = 0
    while (found := _RECORD_START.search(view, begin)) is not None and tries < MAX_CANDIDATES:
        begin = found.start()
        try:
            if _is_whole_record(view, begin):
                return begin
            tries += 1
        except Exception:  # garbage can make a parser raise anything
            tries += 1
        begin += 1
    return None


def _is_whole_record(view: mmap.mmap, begin: int) -> bool:
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
        case Opcode.METADATA:  # it has no checksum: known by its name
            name: str = parse_metadata(content).name
            return name.startswith("minihuman.")
        case Opcode.DATA_END:
            return bool(length == _DATA_END.size - RECORD_HEADER.size and end < len(view))
    return False


def parse_attachment(content: bytes) -> Attachment:
    """The attachment in a record's content.

    Raises:
        ValueError: if its checksum is wrong, or there is more in it than it says.
    """
    (crc,) = struct.unpack("<I", content[-4:])
    if crc not in (0, zlib.crc32(content[:-4])):
        raise ValueError("an attachment has a wrong checksum")
    attachment: Attachment = Attachment.read(as_data_stream(content))
    texts = len(attachment.name.encode()) + len(attachment.media_type.encode())
    if _ATTACHMENT_BYTES + texts + len(attachment.data) != len(content):
        raise ValueError("an attachment differs from its stated size")
    return attachment


def check_record_size(opcode: int, content: bytes) -> None:
    """Check the size of a file's header, or of a chunk's index: they have no checksum, and are passed over by it.

    Raises:
        ValueError: if there is more or less in it than it says.
    """
    if opcode == Opcode.MESSAGE_INDEX:
        _, length = _INDEX.unpack_from(content)
        stated = _INDEX.size + length
    else:  # a header: two texts
        (profile,) = _LENGTH.unpack_from(content)
        (library,) = _LENGTH.unpack_from(content, _LENGTH.size + profile)
        stated = 2 * _LENGTH.size + profile + library
    if stated != len(content):
        raise ValueError("a record differs from its stated size")


def parse_metadata(content: bytes) -> Metadata:
    """The metadata in a record's content.

    Raises:
        ValueError: if there is more in it than it says.
    """
    metadata: Metadata = Metadata.read(as_data_stream(content))
    size = 4 + len(metadata.name.encode()) + 4
    size += sum(8 + len(key.encode()) + len(value.encode()) for key, value in metadata.metadata.items())
    if size != len(content):
        raise ValueError("a metadata record's size differs from the size stated for it")
    return metadata


def as_data_stream(content: bytes) -> ReadDataStream:
    """Bytes as the readers of mcap want them."""
    return ReadDataStream(BytesIO(content))
