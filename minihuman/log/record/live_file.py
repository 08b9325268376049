"""A log while it is live: events appended, made durable at once, readable up to the last one whenever it stops."""

import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import distributions
from pathlib import Path
from typing import IO, cast

import msgspec
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, IndexType, Writer

import minihuman
from minihuman.log.encode import caused_ns, for_viewers, truth
from minihuman.log.record.space import require_space
from minihuman.log.topics import (
    BY_NAME,
    FACTS_METADATA,
    PROFILE,
    SCHEMA_VERSION,
    SEGMENT_METADATA,
    TOPICS,
    schema_bytes,
)
from minihuman.study.events import EpisodeStarted, Event, SessionStarted, Stepped
from minihuman.study.plan import SessionPlan

LIBRARY = f"minihuman/{minihuman.__version__} {LIBRARY_IDENTIFIER}"


class LiveLog:
    """Appends events to a file: plain chunks without an index, one a call, each fsynced."""

    def __init__(self, fd: int, folder: Path, *, started_ns: int, sync: Callable[[int], None]) -> None:
        self._fd = fd
        self._folder = folder
        self._started_ns = started_ns
        self._sync = sync
        self._sequence = 0
        self._steps = 0
        self.durable_steps = 0
        self._writer = Writer(
            cast(IO[bytes], _Unbuffered(fd)),
            compression=CompressionType.NONE,  # a step's chunk is too small to gain from it
            index_types=IndexType.NONE,
            use_statistics=False,
        )
        self._channels: dict[str, int] = {}

    def append(self, events: Sequence[Event]) -> None:
        """Write events and return when they are durable.

        Raises:
            LogError: if there is no room for another episode; the events before its start stay.
            OSError: if the disk is full or gone; what earlier calls wrote stays.
        """
        for event in events:
            if not self._channels:
                assert isinstance(event, SessionStarted), f"a log starts with SessionStarted, not {event!r}"
                self._start(event)
            if isinstance(event, EpisodeStarted):
                self._make_durable()
                require_space(self._folder, event.plan)
            self._add(event)
        self._make_durable()

    def _make_durable(self) -> None:
        self._writer.flush()
        self._sync(self._fd)
        self.durable_steps = self._steps

    def _start(self, event: SessionStarted) -> None:
        writer, started_ns = self._writer, self._started_ns
        writer.start(profile=PROFILE, library=LIBRARY)
        writer.add_metadata(SEGMENT_METADATA, _segment_facts(event.plan, started_ns))
        writer.add_metadata(FACTS_METADATA, event.facts)
        for name, media_type, content in _attachments(event.plan):
            writer.add_attachment(started_ns, started_ns, name, media_type, content)
        schemas: dict[str, int] = {}
        for topic in TOPICS:
            kind = topic.message.DESCRIPTOR.full_name
            if kind not in schemas:
                schemas[kind] = writer.register_schema(kind, "protobuf", schema_bytes(topic.message))
            self._channels[topic.name] = writer.register_channel(topic.name, "protobuf", schemas[kind])

    def _add(self, event: Event) -> None:
        log_time = self._started_ns + event.t_ns
        publish_time = self._started_ns + caused_ns(event)
        # the truth comes last, so that a whole step is one whose /step message is there
        for topic, message in (*for_viewers(event, started_ns=self._started_ns), truth(event)):
            assert isinstance(message, BY_NAME[topic].message)
            self._sequence += 1
            self._writer.add_message(
                self._channels[topic],
                log_time=log_time,
                data=message.SerializeToString(deterministic=True),
                publish_time=publish_time,
                sequence=self._sequence,
            )
        self._steps += isinstance(event, Stepped)


class _Unbuffered:
    """A file descriptor as the stream a ``Writer`` wants: a write is done or raises, and nothing lingers."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._at = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._fd, rest) :]
        self._at += len(data)
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        """Nothing is held back."""


def _segment_facts(plan: SessionPlan, started_ns: int) -> dict[str, str]:
    started = datetime.fromtimestamp(started_ns // 1_000_000_000, UTC)
    return {
        "schema_version": str(SCHEMA_VERSION),
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


def _attachments(plan: SessionPlan) -> tuple[tuple[str, str, bytes], ...]:
    key_maps = {episode.episode: episode.key_map for episode in plan.episodes}
    return (
        ("protocol.toml", "application/toml", plan.protocol_toml),
        ("key_maps.json", "application/json", msgspec.json.encode(key_maps)),
        ("packages.txt", "text/plain", _package_list()),
    )


@cache
def _package_list() -> bytes:
    """What is installed, one ``name==version`` a line; looked up once a process, as it takes a while."""
    found = {f"{package.name}=={package.version}" for package in distributions()}
    return "".join(f"{line}\n" for line in sorted(found, key=str.lower)).encode()
