"""A log while it is live, as bytes to be appended: readable up to the last event whenever it stops."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from typing import IO, cast

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, IndexType, Writer

import minihuman
from minihuman.log import segment_head
from minihuman.log.encode import caused_ns, truth
from minihuman.log.kinds import known, topics_of
from minihuman.log.record.live_chunk import LiveChunk
from minihuman.log.topics import (
    FACTS_METADATA,
    PROFILE,
    SCHEMA_VERSION,
    SEGMENT_METADATA,
    TOPICS,
    Topic,
    schema_bytes,
)
from minihuman.study.again import RULES
from minihuman.study.events import EpisodeStarted, Event, SessionStarted, Stepped
from minihuman.study.plan import EpisodePlan, SessionPlan

_NAME = re.compile(r"[A-Za-z0-9._-]+")  # a requirement starts with it
_SEPARATORS = re.compile(r"[-_.]+")
LIBRARY = f"minihuman/{minihuman.__version__} {LIBRARY_IDENTIFIER}"


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes to be appended in one go, and the episode that there must be room for before they are."""

    data: bytes
    room_for: EpisodePlan | None = None


class LiveLog:
    """Turns events into a live file's bytes: plain chunks without an index, one or more a call.

    Only what holds the truth is written while a session runs; what repeats it for viewers is made at its finish.
    """

    def __init__(self, *, started_ns: int) -> None:
        self._started_ns = started_ns
        self.messages = 0  # encoded so far; the last one's sequence
        self.steps = 0  # among them
        self._bytes = _Taken()
        self._chunk = LiveChunk()
        self._writer = Writer(
            cast(IO[bytes], self._bytes),
            compression=CompressionType.NONE,  # a step's chunk is too small to gain from it
            index_types=IndexType.NONE,
            use_statistics=False,
        )
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, Schema] = {}

    @classmethod
    def going_on(cls, plan: SessionPlan, *, started_ns: int, messages: int, steps: int) -> "LiveLog":
        """For a file that a killed program left: what is encoded is to be appended to it.

        ``messages`` and ``steps`` are how many it holds.
        """
        live = cls(started_ns=started_ns)
        live._writer.start(profile=PROFILE, library=LIBRARY)
        live._number(plan)
        live._bytes.take()  # the file has its beginning
        live.messages, live.steps = messages, steps
        return live

    @property
    def channels(self) -> dict[str, int]:
        """The number of each topic's channel; none before the first event."""
        return dict(self._channels)

    def encode(self, events: Sequence[Event]) -> list[Piece]:
        """Give the bytes of some events; a piece of its own for every episode's start and what follows it."""
        pieces: list[Piece] = []
        room_for: EpisodePlan | None = None
        for event in events:
            if not self._channels:
                assert isinstance(event, SessionStarted), f"a log starts with SessionStarted, not {event!r}"
                pieces.append(Piece(self._start(event)))
                continue
            if isinstance(event, EpisodeStarted):
                pieces.append(Piece(self._flushed(), room_for))
                room_for = event.plan
            self._add(event)
        pieces.append(Piece(self._flushed(), room_for))
        return [piece for piece in pieces if piece.data]

    def _flushed(self) -> bytes:
        self._writer.flush()
        self._bytes.write(self._chunk.take())
        return self._bytes.take()

    def _start(self, event: SessionStarted) -> bytes:
        """The bytes of a segment's start: the plan has a chunk of its own, and a copy before it."""
        writer, started_ns = self._writer, self._started_ns
        writer.start(profile=PROFILE, library=LIBRARY)
        head = [
            Metadata(SEGMENT_METADATA, segment_facts(event.plan, started_ns)),
            Metadata(FACTS_METADATA, event.facts),
        ]
        for record in head:
            writer.add_metadata(record.name, record.metadata)
        begin = self._flushed()
        for name, media_type, content in attachments(event.plan):
            writer.add_attachment(started_ns, started_ns, name, media_type, content)
        channels = self._number(event.plan)
        plan = self._add_plan(event)
        rest = self._flushed()
        builder = RecordBuilder()
        copied = segment_head.packed(head, list(self._schemas.values()), channels, plan)
        Attachment(started_ns, started_ns, segment_head.NAME, segment_head.MEDIA_TYPE, copied).write(builder)
        return begin + bytes(builder.end()) + rest

    def _number(self, plan: SessionPlan) -> list[Channel]:
        """Number the topics' types and channels, always in the same order."""
        topics = (*TOPICS, *topics_of(part.kind for part in plan.parts))
        return [self._channel(topic) for topic in topics if not topic.for_viewers]

    def _channel(self, topic: Topic) -> Channel:
        kind, data = topic.message.DESCRIPTOR.full_name, schema_bytes(topic.message)
        if kind not in self._schemas:
            number = self._writer.register_schema(kind, "protobuf", data)
            self._schemas[kind] = Schema(number, data, "protobuf", kind)
        schema = self._schemas[kind].id
        self._channels[topic.name] = self._writer.register_channel(topic.name, "protobuf", schema)
        return Channel(self._channels[topic.name], topic.name, "protobuf", {}, schema)

    def _add(self, event: Event) -> None:
        topic, message = truth(event)
        new = topic not in self._channels
        if new:  # of a kind of activity that the plan has no part of
            found = known(topic)
            assert found is not None
            self._bytes.write(self._chunk.take())
            self._channel(found)
        self.messages += 1
        self.steps += isinstance(event, Stepped)
        data = message.SerializeToString(deterministic=True)
        log_ns, caused = self._started_ns + event.t_ns, self._started_ns + caused_ns(event)
        if new:  # the library writes the channel into the same chunk
            self._writer.add_message(self._channels[topic], log_ns, data, caused, self.messages)
            self._writer.flush()
        else:
            self._chunk.add(self._channels[topic], self.messages, log_ns, caused, data)

    def _add_plan(self, event: SessionStarted) -> Message:
        topic, message = truth(event)
        self.messages += 1
        added = Message(
            channel_id=self._channels[topic],
            log_time=self._started_ns + event.t_ns,
            data=message.SerializeToString(deterministic=True),
            publish_time=self._started_ns + caused_ns(event),
            sequence=self.messages,
        )
        self._writer.add_message(added.channel_id, added.log_time, added.data, added.publish_time, added.sequence)
        return added


class _Taken:
    """The stream that a ``Writer`` wants, over bytes that are taken away as they come."""

    def __init__(self) -> None:
        self._held = bytearray()
        self._at = 0

    def write(self, data: bytes) -> int:
        self._held += data
        self._at += len(data)
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        """Nothing goes anywhere before it is taken."""

    def take(self) -> bytes:
        taken, self._held = bytes(self._held), bytearray()
        return taken


def segment_facts(plan: SessionPlan, started_ns: int) -> dict[str, str]:
    """What a segment's metadata says of it; ``started_ns`` is the wall clock at its time 0."""
    started = datetime.fromtimestamp(started_ns // 1_000_000_000, UTC)
    return {
        "schema_version": str(SCHEMA_VERSION),
        "session_rules": str(RULES),
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


def attachments(plan: SessionPlan) -> tuple[tuple[str, str, bytes], ...]:
    """Name, media type and content of what is attached to a log."""
    key_maps = {episode.episode: episode.key_map for episode in plan.episodes}
    return (
        ("protocol.toml", "application/toml", plan.protocol_toml),
        ("key_maps.json", "application/json", msgspec.json.encode(key_maps)),
        ("packages.txt", "text/plain", _package_list()),
    )


@cache
def _package_list() -> bytes:
    """What minihuman needs, extras that are there included, one ``name==version`` a line; nothing else of a machine."""
    found: dict[str, str] = {}
    needed = ["minihuman"]
    while needed:
        name = needed.pop()
        key = _SEPARATORS.sub("-", name).lower()
        if key in found:
            continue
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue
        found[key] = f"{package.name}=={package.version}"
        needed += (match[0] for line in package.requires or () if (match := _NAME.match(line)))
    return "".join(f"{found[key]}\n" for key in sorted(found)).encode()
