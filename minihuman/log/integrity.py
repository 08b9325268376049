"""Protects a log's content with a hash chain over the whole log, and a second copy of each segment's start.

Hash chain: every message, attachment and metadata record of ours, in file order, adds the previous head to its own
SHA-256; a topic's schema is added before its first message. Records of other programs are left out, and so are the
segment-head copies, whose content is in the chain already.

Segment head: a compressed attachment with the segment's metadata, the channels known by then, and the message with the
plan. A log whose plan was damaged is read from this copy.
"""

import hashlib
from collections.abc import Iterable, Sequence

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Schema

from minihuman.log.codec import find_topic
from minihuman.log.names import CHAIN_KEY
from minihuman.log.salvage.records import ChunkRecords, LogMessage, decompress_zstd, parse_metadata, split_chunk

SEGMENT_HEAD_NAME = "session_plan.zst"
SEGMENT_HEAD_MEDIA_TYPE = "application/zstd"
_LEVEL = 9  # 2 ms for a thousand episodes; level 19 saves a tenth, but would block a server for 110 ms


class SegmentHead:
    """A segment's start, read from its second copy."""

    def __init__(self, records: ChunkRecords) -> None:
        self.records = records
        self.metadata = [
            parse_metadata(content) for opcode, content in records.other_records if opcode == Opcode.METADATA
        ]

    @classmethod
    def of(cls, data: bytes) -> "SegmentHead":
        """Parse the second copy of a segment's start.

        Raises:
            ValueError: if the data are not such a copy.
        """
        return cls(split_chunk(decompress_zstd(data), []))


def pack_segment_head(
    metadata: Iterable[Metadata], schemas: Sequence[Schema], channels: Sequence[Channel], plan: Message
) -> bytes:
    """Return the second copy of a segment's start as compressed bytes.

    Args:
        metadata: the metadata at the segment's start.
        schemas: the schemas of the channels.
        channels: the channels that are known by then.
        plan: the message with the plan.
    """
    builder = RecordBuilder()
    for record in (*metadata, *schemas, *channels, plan):
        record.write(builder)
    return zstandard.compress(bytes(builder.end()), _LEVEL)


METADATA_PREFIX = "minihuman."  # all names of our metadata records begin with it
_CHAIN_START = hashlib.sha256(b"minihuman chain 1").digest()


class HashChain:
    """A hash chain over the records that have been added so far."""

    def __init__(self) -> None:
        self._head = _CHAIN_START
        self._beginnings: dict[tuple[str, str], bytes] = {}  # of a message's record, by topic and schema

    @property
    def head(self) -> str:
        """Return the SHA-256 of everything added so far, as 64 hexadecimal digits."""
        return self._head.hex()

    def add_message(self, message: LogMessage, schema: Schema | None) -> None:
        """Add a message to the chain, unless its topic is another program's; ``schema`` is the channel's, if any."""
        channel = message.channel
        name = "" if schema is None else schema.name
        beginning = self._beginnings.get((channel.topic, name))
        if beginning is None:
            if find_topic(channel.topic) is None:
                return
            self._add_channel(channel, schema)
            beginning = _join_parts(b"message", channel.topic.encode(), name.encode())
            self._beginnings[channel.topic, name] = beginning
        numbers = b"%d %d %d" % (message.sequence, message.log_time, message.publish_time)
        content = _join_parts(numbers, message.data)
        self._head = hashlib.sha256(self._head + beginning + content).digest()

    def add_metadata(self, record: Metadata) -> None:
        """Add a metadata record to the chain, without the chain head that it states."""
        if not record.name.startswith(METADATA_PREFIX):
            return
        parts = [b"metadata", record.name.encode()]
        for key, text in sorted(record.metadata.items()):
            if key != CHAIN_KEY:
                parts += [key.encode(), text.encode()]
        self._extend(*parts)

    def add_attachment(self, record: Attachment) -> None:
        """Add an attachment to the chain, unless it is a segment-head copy."""
        if record.name == SEGMENT_HEAD_NAME:
            return
        times = f"{record.create_time} {record.log_time}"
        self._extend(b"attachment", record.name.encode(), record.media_type.encode(), times.encode(), record.data)

    def _add_channel(self, channel: Channel, schema: Schema | None) -> None:
        """Add a channel and its schema to the chain; a channel without a schema counts as one with an empty schema."""
        encoding, data = ("", b"") if schema is None else (schema.encoding, schema.data)
        self._extend(b"channel", channel.topic.encode(), channel.message_encoding.encode(), encoding.encode(), data)

    def _extend(self, *parts: bytes) -> None:
        """Extend the chain by a record, whose parts are given in order."""
        self._head = hashlib.sha256(self._head + _join_parts(*parts)).digest()


def _join_parts(*parts: bytes) -> bytes:
    """Join the parts of a record, each preceded by its length."""
    return b"".join(piece for part in parts for piece in (len(part).to_bytes(8, "little"), part))
