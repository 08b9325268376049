"""The hash chain over a finished log: one number that is another if anything before it is.

Every message, attachment and metadata record of ours, in the order of the file, takes the head of the chain so far
into its own SHA-256; a topic's schema is taken in before its first message. Left out are the second copy of a
segment's start, which repeats what is in the chain, and what other programs put into a log.
"""

import hashlib

from mcap.records import Attachment, Channel, Metadata, Schema

from minihuman.log import segment_head
from minihuman.log.kinds import known
from minihuman.log.read.chunk import LogMessage

HEAD = "chain"  # the fact of a segment's end that states the head
OURS = "minihuman."  # how our metadata records' names begin
_START = hashlib.sha256(b"minihuman chain 1").digest()


class Chain:
    """The chain as far as records were taken in."""

    def __init__(self) -> None:
        self._head = _START
        self._known: set[tuple[str, str]] = set()  # topics and their schemas

    @property
    def head(self) -> str:
        """SHA-256 over all so far, as 64 hexadecimal digits."""
        return self._head.hex()

    def message(self, message: LogMessage, schema: Schema | None) -> None:
        """Take a message in."""
        if known(message.channel.topic) is None:
            return
        channel, name = message.channel, "" if schema is None else schema.name
        if (channel.topic, name) not in self._known:
            self._known.add((channel.topic, name))
            self._channel(channel, schema)
        numbers = f"{message.sequence} {message.log_time} {message.publish_time}"
        self._take(b"message", channel.topic.encode(), name.encode(), numbers.encode(), message.data)

    def metadata(self, record: Metadata) -> None:
        """Take a metadata record in, but for the head that it states."""
        if not record.name.startswith(OURS):
            return
        facts = [text.encode() for fact in sorted(record.metadata.items()) if fact[0] != HEAD for text in fact]
        self._take(b"metadata", record.name.encode(), *facts)

    def attachment(self, record: Attachment) -> None:
        """Take an attachment in."""
        if record.name == segment_head.NAME:
            return
        times = f"{record.create_time} {record.log_time}"
        self._take(b"attachment", record.name.encode(), record.media_type.encode(), times.encode(), record.data)

    def _channel(self, channel: Channel, schema: Schema | None) -> None:
        encoding, data = ("", b"") if schema is None else (schema.encoding, schema.data)
        self._take(b"channel", channel.topic.encode(), channel.message_encoding.encode(), encoding.encode(), data)

    def _take(self, *parts: bytes) -> None:
        digest = hashlib.sha256(self._head)
        for part in parts:
            digest.update(len(part).to_bytes(8, "little"))
            digest.update(part)
        self._head = digest.digest()
