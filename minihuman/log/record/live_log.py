"""Encodes a live log as bytes to append; it is readable up to its last event whenever writing stops. Opens no file.

Messages are packed into MCAP chunks directly, since the library would make ten calls per message.
"""

import re
import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from typing import IO, cast

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, IndexType, Writer

import minihuman
from minihuman.experiment.machine.events import EpisodeStarted, Event, SessionStarted, Stepped
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.replay import MACHINE_VERSION
from minihuman.log import integrity
from minihuman.log.codec import encode_event, event_cause_ns, find_topic, list_activity_topics
from minihuman.log.names import FACTS_METADATA, PROFILE, SEGMENT_METADATA
from minihuman.log.segment_schema import find_schema_version
from minihuman.log.topics import TOPICS, Topic, schema_bytes
from minihuman.plugins import DISTRIBUTION

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, bytes that follow, channel, sequence, log time, publish time
_MESSAGE_HEAD_BYTES = 22  # of those bytes, before its data
_CHUNK = struct.Struct("<BQQQQIIQ")  # opcode, bytes that follow, first time, last, bytes, CRC, no compression, bytes
_CHUNK_HEAD_BYTES = 40


class ChunkBuilder:
    """Collects messages and packs them into an MCAP chunk."""

    def __init__(self) -> None:
        self._records: list[bytes] = []
        self._times_ns: list[int] = []

    def add(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Add a message to the chunk.

        Args:
            channel: the number of the message's channel.
            sequence: the message's sequence number.
            log_ns: the log time in nanoseconds since 1970.
            publish_ns: the publish time in nanoseconds since 1970.
            data: the encoded message.
        """
        head = _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_HEAD_BYTES + len(data), channel, sequence, log_ns, publish_ns)
        self._records += (head, data)
        self._times_ns.append(log_ns)

    def take(self) -> bytes:
        """Return the chunk's bytes, b"" if it is empty, and begin the next one."""
        if not self._records:
            return b""
        records = b"".join(self._records)
        times_ns = self._times_ns
        self._records = []
        self._times_ns = []
        size = len(records)
        crc = zlib.crc32(records)
        return (
            _CHUNK.pack(Opcode.CHUNK, _CHUNK_HEAD_BYTES + size, min(times_ns), max(times_ns), size, crc, 0, size)
            + records
        )


_NAME = re.compile(r"[A-Za-z0-9._-]+")  # a requirement starts with it
_SEPARATORS = re.compile(r"[-_.]+")
LIBRARY_NAME = f"minihuman/{minihuman.__version__} {LIBRARY_IDENTIFIER}"


@dataclass(frozen=True, slots=True)
class AppendBlock:
    """Bytes to append in one write, and the episode for which the disk must have room first."""

    data: bytes
    room_for: EpisodePlan | None = None


class LiveLogEncoder:
    """Encodes events as a live file's bytes: plain chunks without an index, one or more per call.

    Only the record is written while a session runs; previews are added when the log is finalized.
    """

    def __init__(self, *, started_ns: int) -> None:
        self._started_ns = started_ns
        self.messages = 0  # encoded so far; the last one's sequence
        self.steps = 0  # among them
        self._bytes = _DrainedStream()
        self._chunk = ChunkBuilder()
        self._writer = Writer(
            cast(IO[bytes], self._bytes),
            compression=CompressionType.NONE,  # a step's chunk is too small to gain from it
            index_types=IndexType.NONE,
            use_statistics=False,
        )
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, Schema] = {}

    @classmethod
    def resume(
        cls, plan: SessionPlan, *, started_ns: int, messages: int, steps: int, rare: Iterable[str] = ()
    ) -> "LiveLogEncoder":
        """Return an encoder that continues the file of a killed program.

        Args:
            plan: the session's plan.
            started_ns: the wall clock at the segment's time 0, in nanoseconds since 1970.
            messages: the number of messages in the file.
            steps: the number of steps in the file.
            rare: the topics, in order, whose channels the file has besides those of every log.
        """
        live = cls(started_ns=started_ns)
        live._writer.start(profile=PROFILE, library=LIBRARY_NAME)
        live._register_channels(plan)
        for topic in filter(None, map(find_topic, rare)):
            live._register_channel(topic)
        live._bytes.take()  # the file has its beginning
        live.messages = messages
        live.steps = steps
        return live

    @property
    def channels(self) -> dict[str, int]:
        """Return the number of each topic's channel; empty before the first event."""
        return dict(self._channels)

    def encode(self, events: Sequence[Event]) -> list[AppendBlock]:
        """Encode events as blocks to append; the start of a segment or an episode begins a new block."""
        pieces: list[AppendBlock] = []
        room_for: EpisodePlan | None = None
        for event in events:
            if not self._channels:
                assert isinstance(event, SessionStarted), f"a log starts with SessionStarted, not {event!r}"
                pieces.append(AppendBlock(self._encode_start(event)))
                continue
            if isinstance(event, EpisodeStarted):
                pieces.append(AppendBlock(self._take_encoded(), room_for))
                room_for = event.plan
            self._add_event(event)
        pieces.append(AppendBlock(self._take_encoded(), room_for))
        return [piece for piece in pieces if piece.data]

    def _take_encoded(self) -> bytes:
        """Return all bytes that have been encoded and not taken yet, and end the present chunk."""
        self._writer.flush()
        self._bytes.write(self._chunk.take())
        return self._bytes.take()

    def _encode_start(self, event: SessionStarted) -> bytes:
        """Encode a segment's start: the plan in a separate chunk, preceded by its second copy.

        The copy follows the attachments. If a write is torn, a plan that can be read thus has everything that belongs
        to it.
        """
        writer = self._writer
        started_ns = self._started_ns
        writer.start(profile=PROFILE, library=LIBRARY_NAME)
        head = [
            Metadata(SEGMENT_METADATA, build_segment_metadata(event, started_ns)),
            Metadata(FACTS_METADATA, event.facts),
        ]
        for record in head:
            writer.add_metadata(record.name, record.metadata)
        begin = self._take_encoded()
        for name, media_type, content in build_attachments(event.plan):
            writer.add_attachment(started_ns, started_ns, name, media_type, content)
        begin += self._take_encoded()
        channels = self._register_channels(event.plan)
        plan = self._add_plan(event)
        plan_chunk = self._take_encoded()
        builder = RecordBuilder()
        copied = integrity.pack_segment_head(head, list(self._schemas.values()), channels, plan)
        Attachment(
            started_ns, started_ns, integrity.SEGMENT_HEAD_NAME, integrity.SEGMENT_HEAD_MEDIA_TYPE, copied
        ).write(builder)
        return begin + bytes(builder.end()) + plan_chunk

    def _register_channels(self, plan: SessionPlan) -> list[Channel]:
        """Register the schemas and channels of a plan's topics, always in the same order; return the channels."""
        topics = (*TOPICS, *list_activity_topics(part.kind for part in plan.parts))
        return [self._register_channel(topic) for topic in topics if not topic.is_preview]

    def _register_channel(self, topic: Topic) -> Channel:
        """Register a topic's schema and channel; return the channel."""
        kind = topic.message.DESCRIPTOR.full_name
        data = schema_bytes(topic.message)
        if kind not in self._schemas:
            number = self._writer.register_schema(kind, "protobuf", data)
            self._schemas[kind] = Schema(number, data, "protobuf", kind)
        schema = self._schemas[kind].id
        self._channels[topic.name] = self._writer.register_channel(topic.name, "protobuf", schema)
        return Channel(self._channels[topic.name], topic.name, "protobuf", {}, schema)

    def _add_event(self, event: Event) -> None:
        """Add an event to the chunk, after registering its topic if it is new."""
        topic, message = encode_event(event)
        is_new = topic not in self._channels
        if is_new:  # of a kind of activity that the plan has no part of
            new_topic = find_topic(topic)
            assert new_topic is not None
            self._bytes.write(self._chunk.take())
            self._register_channel(new_topic)
        self.messages += 1
        self.steps += isinstance(event, Stepped)
        data = message.SerializeToString(deterministic=True)
        log_ns = self._started_ns + event.t_ns
        publish_ns = self._started_ns + event_cause_ns(event)
        if is_new:  # the library writes the channel into the same chunk
            self._writer.add_message(self._channels[topic], log_ns, data, publish_ns, self.messages)
            self._writer.flush()
        else:
            self._chunk.add(self._channels[topic], self.messages, log_ns, publish_ns, data)

    def _add_plan(self, event: SessionStarted) -> Message:
        """Add the message with the segment's plan, and return it."""
        topic, message = encode_event(event)
        self.messages += 1
        plan_message = Message(
            channel_id=self._channels[topic],
            log_time=self._started_ns + event.t_ns,
            data=message.SerializeToString(deterministic=True),
            publish_time=self._started_ns + event_cause_ns(event),
            sequence=self.messages,
        )
        self._writer.add_message(
            plan_message.channel_id,
            plan_message.log_time,
            plan_message.data,
            plan_message.publish_time,
            plan_message.sequence,
        )
        return plan_message


class _DrainedStream:
    """The output stream that a ``Writer`` needs, whose bytes are taken as they arrive."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._at = 0

    def write(self, data: bytes) -> int:
        self._buffer += data
        self._at += len(data)
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        """Do nothing, since the bytes stay until they are taken."""

    def take(self) -> bytes:
        content = bytes(self._buffer)
        self._buffer = bytearray()
        return content


def build_segment_metadata(event: SessionStarted, started_ns: int) -> dict[str, str]:
    """Return the metadata of a segment.

    Args:
        event: the event that begins the segment, with its plan.
        started_ns: the wall clock at the segment's time 0, in nanoseconds since 1970.
    """
    plan = event.plan
    started = datetime.fromtimestamp(started_ns // 1_000_000_000, UTC)
    return {
        "schema_version": str(find_schema_version(plan, event.facts)),
        "session_rules": str(MACHINE_VERSION),
        "segment": str(plan.segment),
        "started_at": f"{started:%Y-%m-%dT%H:%M:%S}.{started_ns % 1_000_000_000:09d}Z",
        "started_unix_ns": str(started_ns),  # the wall clock when the session's monotonic clock was 0
        "study": plan.study,
        "study_version": plan.study_version,
        "study_seed": str(plan.study_seed),
        "protocol_sha256": plan.protocol_sha256,
        "participant": plan.participant.id,
        "group": plan.participant.group,
        "session": str(plan.session),
        "minihuman": minihuman.__version__,
    }


def build_attachments(plan: SessionPlan) -> tuple[tuple[str, str, bytes], ...]:
    """Return the name, media type and content of each of a log's attachments."""
    key_maps = {episode.episode: episode.key_map for episode in plan.episodes}
    return (
        ("protocol.toml", "application/toml", plan.protocol_toml),
        ("key_maps.json", "application/json", msgspec.json.encode(key_maps)),
        ("packages.txt", "text/plain", _list_packages()),
    )


@cache
def _list_packages() -> bytes:
    """Return the installed packages that minihuman requires, directly or not, as text: ``name==version`` on each line.

    Optional requirements are included if they are installed.
    """
    requirements: dict[str, str] = {}  # by normalised name
    pending_names = [DISTRIBUTION]
    while pending_names:
        name = pending_names.pop()
        key = _SEPARATORS.sub("-", name).lower()
        if key in requirements:
            continue
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue
        requirements[key] = f"{package.name}=={package.version}"
        matches = (_NAME.match(requirement) for requirement in package.requires or ())
        pending_names += (match[0] for match in matches if match)
    return "".join(f"{requirements[key]}\n" for key in sorted(requirements)).encode()
