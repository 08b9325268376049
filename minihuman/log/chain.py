"""The hash chain over a finished log: one number that is another if anything before it is.

Every message, attachment and metadata record, in the order of the file, takes the head of the chain so far into its own
SHA-256; a topic's schema is taken in before its first message. The second copy of a segment's start is left out: it
repeats what is in the chain.
"""

import hashlib

from mcap.records import Attachment, Channel, Metadata, Schema

from minihuman.log.read.chunk import LogMessage

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
        channel, name = message.channel, "" if schema is None else schema.name
        if (channel.topic, name) not in self._known:
            self._known.add((channel.topic, name))
            self._channel(channel, schema)
        numbers = f"{message.sequence} {message.log_time} {message.publish_time}"
        self._take(b"message", channel.topic.encode(), name.encode(), numbers.encode(), message.data)

    def metadata(self, record: Metadata) -> None:
        """Take a metadata record in."""
        facts = [text.encode() for fact in sorted(record.metadata.items()) for text in fact]
        self._take(b"metadata", record.name.encode(), *facts)

    def attachment(self, record: Attachment) -> None:
        """Take an attachment in."""
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
