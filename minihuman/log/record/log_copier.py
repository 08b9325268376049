"""Copies log files record by record into one finished log, with its hash chain, counts, previews and second copies."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress

from google.protobuf.message import Message as Protobuf
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer

from minihuman.experiment.machine.events import EpisodeEnded, EpisodesSkipped, Event, SessionEnded, SessionStarted
from minihuman.log import integrity, names, topics
from minihuman.log.codec import RECORD_TOPICS, decode_event
from minihuman.log.integrity import HashChain
from minihuman.log.model.session_log import CUT_OFF
from minihuman.log.names import CHAIN_KEY
from minihuman.log.preview import PreviewEncoder
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner, MissingMessages

UNNUMBERED = 0  # the sequence number of previews
EPISODE_BYTES = 16 * 1024  # a smaller episode shares its chunk with the next
_PREVIEW_TOPICS = frozenset(topic.name for topic in topics.TOPICS if topic.is_preview)
_SUMMARY_TOPICS = frozenset({topics.SKIP, topics.PLAN, topics.EPISODE_END, topics.SESSION_END})  # for a segment's end
_HEAD_METADATA = (names.SEGMENT_METADATA, names.FACTS_METADATA)


class LogCopier:
    """Copies whole files into one writer; equal schemas and equal channels share one number."""

    def __init__(self, writer: Writer) -> None:
        self.chain = HashChain()
        self.starts: list[dict[str, str]] = []  # the segments' metadata
        self.ends: list[dict[str, str]] = []
        self.counts: Counter[str] = Counter()  # messages per topic, of the last segment copied
        self.total: Counter[str] = Counter()  # of all segments
        self.end_reason = ""  # of the last segment copied; "" if it has none
        self.last_sequence = 0  # of the last segment copied
        self.planned = 0  # episodes of the session
        self.skipped = 0  # episodes skipped in all copied segments, by a criterion or a time limit
        self.completed: set[int] = set()  # episodes with an outcome other than abandoned, in all copied segments
        self.lasted_ns = 0  # from the last segment's first message to its last
        self._first_ns = 0
        self._writer = writer
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._channels: dict[tuple[str, int], int] = {}
        self._attachments: set[tuple[str, bytes]] = set()
        self._head: dict[str, Metadata] = {}  # metadata of the segment whose plan comes next
        self._early_attachments: list[Attachment] = []  # attachments before that plan
        self._early_previews: list[tuple[LogMessage, Schema | None]] = []  # before that plan
        self._draw = False
        self._previews: PreviewEncoder | None = None  # None if no previews are added
        self._last: LogMessage | None = None  # the last message of the record
        self._chunk_bytes = 0

    def copy_file(self, scan: LogScanner, *, draw: bool = False) -> None:
        """Copy every record that a scan of a file finds.

        Args:
            scan: the scan, which has not begun.
            draw: whether to add previews, unless the file has some.
        """
        self._previews = None
        self._draw = draw
        for record in scan:
            match record:
                case LogMessage():
                    self._copy_message(record, scan.schemas.get(record.channel.schema_id))
                case Metadata() if record.name in _HEAD_METADATA:
                    self._head[record.name] = record
                case Metadata():
                    self.add_metadata(record.name, record.metadata)
                case Attachment() if record.name != integrity.SEGMENT_HEAD_NAME and self._head:
                    self._early_attachments.append(record)
                case Attachment() if record.name != integrity.SEGMENT_HEAD_NAME:
                    self._copy_attachment(record)
        self._write_segment_start()
        if self._previews is not None and self._last is not None:
            self._add_previews(self._previews.finish(), self._last)

    def add_metadata(self, name: str, facts: Mapping[str, object], *, sealed: bool = False) -> None:
        """Add a metadata record.

        Args:
            name: the name of the record.
            facts: its contents, which are written as text.
            sealed: whether to add the head of the hash chain, which covers the record.
        """
        record = Metadata(name, {key: _format_fact(fact) for key, fact in facts.items()})
        self._flush()  # so that the record comes after the messages before it
        self.chain.add_metadata(record)
        if sealed:
            record.metadata[CHAIN_KEY] = self.chain.head
        self._writer.add_metadata(record.name, record.metadata)
        if name == names.SEGMENT_METADATA:
            self.starts.append(record.metadata)
            self.counts.clear()
            self.end_reason = ""
            self.last_sequence = 0
            self.lasted_ns = self._first_ns = 0
        elif name == names.END_METADATA:
            self.ends.append(record.metadata)

    def record_missing(self, gaps: Iterable[MissingMessages]) -> None:
        """Record the ranges of messages that were lost, each in a metadata record."""
        for gap in gaps:
            self.add_metadata(names.MISSING_METADATA, {"segment": gap.segment, "first": gap.first, "last": gap.last})

    def record_end(self, segment: int, **facts: object) -> None:
        """Record the end of a segment in a metadata record that has the head of the hash chain.

        Args:
            segment: the segment's number.
            **facts: how it ended, as ``summarize_segment`` returns it, and further facts.
        """
        self.add_metadata(names.END_METADATA, {"segment": segment} | facts, sealed=True)

    def summarize_segment(self) -> dict[str, object]:
        """Return a summary of the last copied segment, for the metadata of its end."""
        return {
            "reason": self.end_reason or CUT_OFF,
            "steps": self.counts[topics.STEP],
            "last_message": self.last_sequence,
            "planned": self.planned - self.skipped,
            "completed": len(self.completed),
            "lasted_ns": self.lasted_ns,
        }

    def _copy_attachment(self, record: Attachment) -> None:
        """Copy an attachment, unless an equal one has been copied."""
        if (record.name, record.data) in self._attachments:
            return
        self._attachments.add((record.name, record.data))
        self._flush()
        self._writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        self.chain.add_attachment(record)

    def _copy_message(self, message: LogMessage, schema: Schema | None) -> None:
        """Copy a message after its previews; a message with a plan also completes the start of its segment."""
        topic = message.channel.topic
        if topic in _PREVIEW_TOPICS:
            self._previews = None  # an earlier version's file has previews
        if self._head and topic in _PREVIEW_TOPICS:
            self._early_previews.append((message, schema))  # a log line about the next plan
            return
        if topic == topics.PLAN:
            self._write_start_with_copy(message, schema)
        self._write_segment_start()
        if topic in RECORD_TOPICS:
            self.last_sequence = message.sequence
            self._last = message
        if self._previews is not None:
            self._add_previews(self._previews.encode(topic, message.data), message)
        self._add_message(message, schema)
        if topic == topics.PLAN or (topic == topics.EPISODE_END and self._chunk_bytes > EPISODE_BYTES):
            self._flush()
        self._first_ns = self._first_ns or message.log_time
        self.lasted_ns = max(self.lasted_ns, message.log_time - self._first_ns)
        if topic in _SUMMARY_TOPICS:
            with suppress(Exception):  # foreign bytes; the message itself is kept
                self._count_event(decode_event(topic, message.data))

    def _count_event(self, event: Event | None) -> None:
        """Update the session's counts and the segment's end reason with an event."""
        match event:
            case SessionStarted(plan=plan):
                self.planned = len(plan.episodes)
            case EpisodesSkipped(count=count):
                self.skipped += count
            case EpisodeEnded(outcome=outcome, episode=episode) if outcome != "abandoned":
                self.completed.add(episode)
            case SessionEnded(reason=reason):
                self.end_reason = reason

    def _write_start_with_copy(self, message: LogMessage, schema: Schema | None) -> None:
        """Write the held-back start of a segment, with its second copy, before the message with the plan."""
        self._flush()
        if self._draw and names.SEGMENT_METADATA in self._head:
            self._previews = PreviewEncoder(int(self._head[names.SEGMENT_METADATA].metadata["started_unix_ns"]))
        number = self._register_channel(message.channel, schema)
        topic = message.channel.topic
        encoding = message.channel.message_encoding
        schemas = []
        channels = [Channel(number, topic, encoding, message.channel.metadata, schema_id=0)]
        if schema is not None:
            channels[0].schema_id = self._schemas[schema.name, schema.data]
            schemas.append(Schema(channels[0].schema_id, schema.data, schema.encoding, schema.name))
        plan = Message(number, message.log_time, message.data, message.publish_time, message.sequence)
        second_copy = integrity.pack_segment_head(self._head.values(), schemas, channels, plan)
        self._write_segment_start(second_copy, message.log_time)

    def _write_segment_start(self, second_copy: bytes = b"", log_time: int = 0) -> None:
        """Write the held-back start of a segment, if any: metadata, second copy, attachments and previews.

        Args:
            second_copy: the start's second copy; b"" for none.
            log_time: the log time of the second copy.
        """
        head = self._head
        self._head = {}
        early_attachments = self._early_attachments
        self._early_attachments = []
        previews = self._early_previews
        self._early_previews = []
        for record in head.values():
            self.add_metadata(record.name, record.metadata)
        if second_copy:
            self._writer.add_attachment(
                log_time, log_time, integrity.SEGMENT_HEAD_NAME, integrity.SEGMENT_HEAD_MEDIA_TYPE, second_copy
            )
        for attachment in early_attachments:
            self._copy_attachment(attachment)
        for message, schema in previews:
            self._add_message(message, schema)

    def _add_previews(self, encoded: Iterator[tuple[str, Protobuf]], message: LogMessage) -> None:
        """Write previews before the message that they belong to, with its times, so that no step lacks its previews.

        Args:
            encoded: the topic and the content of each preview.
            message: the message of the record.
        """
        previews: list[tuple[str, Protobuf]] = []
        with suppress(Exception):  # of foreign bytes; the message itself is kept
            previews += encoded
        for topic, preview in previews:
            name = preview.DESCRIPTOR.full_name
            data = preview.SerializeToString(deterministic=True)
            schema = Schema(id=0, data=topics.schema_bytes(type(preview)), encoding="protobuf", name=name)
            channel = Channel(id=0, topic=topic, message_encoding="protobuf", metadata={}, schema_id=0)
            self._add_message(LogMessage(channel, UNNUMBERED, message.log_time, message.publish_time, data), schema)

    def _add_message(self, message: LogMessage, schema: Schema | None) -> None:
        """Write a message, and add it to the hash chain and the counts."""
        self._writer.add_message(
            self._register_channel(message.channel, schema),
            log_time=message.log_time,
            data=message.data,
            publish_time=message.publish_time,
            sequence=message.sequence,
        )
        self.chain.add_message(message, schema)
        self.counts[message.channel.topic] += 1
        self.total[message.channel.topic] += 1
        self._chunk_bytes += 1 + len(message.data)

    def _flush(self) -> None:
        """End the present chunk, if it has a message."""
        if self._chunk_bytes:
            self._writer.flush()
            self._chunk_bytes = 0

    def _register_channel(self, channel: Channel, schema: Schema | None) -> int:
        """Return a channel's number in the copy, registering the channel and its schema if they are new."""
        schema_id = self._register_schema(schema)
        key = (channel.topic, schema_id)
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
        return self._channels[key]

    def _register_schema(self, schema: Schema | None) -> int:
        """Return a schema's number in the copy, registering the schema if it is new."""
        if schema is None:
            self._schemas["", b""] = 0  # 0 is MCAP's number for no schema, as another program's topic may have
            return 0
        key = (schema.name, schema.data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        return self._schemas[key]


def _format_fact(fact: object) -> str:
    if isinstance(fact, bool):
        return str(fact).lower()
    return str(fact)
