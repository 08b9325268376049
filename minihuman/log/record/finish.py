"""A live log made into the session's log: read as far as it is whole, rewritten with index and checksums, renamed.

The same for a session that ended well (``finish``) and for one that was cut off (``recover``). Every message of the
live file, and of the session's earlier segments, is in the result unchanged; only then is the live file removed, or,
if it could not be read to its end, put aside.
"""

import itertools
import os
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from google.protobuf.message import Message
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import Writer

from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.decode import decode
from minihuman.log.encode import for_viewers
from minihuman.log.paths import PART_SUFFIX, SegmentPath, is_guest
from minihuman.log.read.chunk import LogMessage
from minihuman.log.read.file import segment_starts
from minihuman.log.read.scan import Scan
from minihuman.log.record.claim import is_live, sync_folder, taken
from minihuman.log.record.live_file import LIBRARY
from minihuman.log.topics import schema_bytes
from minihuman.recorded.episode import CUT_OFF
from minihuman.study.events import EpisodeEnded, SessionEnded, SessionStarted

_TOLD = frozenset({topics.PLAN, topics.EPISODE_END, topics.SESSION_END})  # what the end's metadata says comes of these
CHUNK_BYTES = 1024 * 1024
NOT_COUNTED = 0  # the sequence of a message that only repeats another for viewers
_FOR_VIEWERS = frozenset(topic.name for topic in topics.TOPICS if topic.for_viewers)


@dataclass(frozen=True, slots=True)
class Promised:
    """What a recorder has written, so that it can be told from what is found."""

    messages: int
    steps: int
    late_writes: int  # that the disk did not take before their picture was shown
    longest_wait_s: float  # of a write


@dataclass(frozen=True, slots=True)
class Finished:
    """What became of a live file."""

    path: Path  # the session's log, or where an unreadable live file was put aside
    readable: bool  # False: not even the session's plan was in it
    steps: int  # of this segment
    episodes: int  # of this segment, started
    end_reason: str  # an EndReason, or "cut_off"
    stopped: str  # where and why reading stopped before the live file's end; "" if it did not
    messages: int = 0  # of this segment that hold the truth
    aside: Path | None = None  # where the live file was kept as it was found, if it was not whole

    def line(self) -> str:
        """Say it in one line."""
        if not self.readable:
            return f"{self.path}: kept nothing; {self.stopped}"
        told = f"{self.path}: kept {self.steps} steps of {self.episodes} episodes; ended: {self.end_reason}"
        return f"{told}; the file was {self.stopped}" if self.stopped else told


def finish(where: SegmentPath, *, clean: bool, promised: Promised | None = None) -> Finished:
    """Turn a live file into the session's log, or merge it into it. The caller holds the file's lock.

    ``promised`` is what its recorder wrote; a segment that holds less is not clean.

    Raises:
        LogError: if the session's log is damaged or holds another run of this segment; the live file stays.
        OSError: if the disk is full; the live file stays.
    """
    starts = segment_starts(where.part)
    if not starts:  # nothing was played yet, or the file's start is gone
        aside = _put_aside(where.part, "unreadable")
        return Finished(aside, False, 0, 0, CUT_OFF, "it holds no session plan", aside=aside)
    earlier = segment_starts(where.log) if where.log.exists() else {}
    new = starts.items() - earlier.items()
    if new and where.segment in earlier:
        raise LogError(f"{where.log} already holds another segment {where.segment}; move it away, then recover again")
    temporary = where.log.with_name(f"{where.log.name}.finishing")
    try:
        result = _rewrite(where, temporary, with_log=bool(earlier), clean=clean, promised=promised)
        if new:  # else a finish that was cut off before it removed the live file
            os.replace(temporary, where.log)
            sync_folder(where.log.parent)
    finally:
        temporary.unlink(missing_ok=True)
    if result.stopped or (promised is not None and result.messages < promised.messages):
        # what could not be read may yet be of use to somebody
        return replace(result, aside=_put_aside(where.part, "as-found"))
    where.part.unlink()
    sync_folder(where.part.parent)
    return result


def recover(part: Path) -> Finished:
    """Finish a cut-off log; it is marked as not clean.

    Raises:
        LogError: if a running session still writes it, it is gone, its session's log is damaged, or the disk is full;
            the live file stays.
    """
    where = SegmentPath.of_part(part)
    with taken(part):
        try:
            return finish(where, clean=False)
        except OSError as error:
            raise LogError(f"{part} could not be finished and stays as it is: {error.strerror}") from error


def leftovers(folder: Path) -> list[Path]:
    """List the cut-off logs anywhere below a folder, those still being written and other programs' files left out."""
    return [part for part in sorted(folder.rglob(f"*{PART_SUFFIX}")) if not is_guest(part) and not is_live(part)]


def _rewrite(where: SegmentPath, target: Path, *, with_log: bool, clean: bool, promised: Promised | None) -> Finished:
    with target.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile=topics.PROFILE, library=LIBRARY)
        copy = _Copy(writer)
        if with_log:
            copy.all_of(Scan(where.log))
        part = Scan(where.part)
        copy.all_of(part, draw=True)
        end_reason = copy.end_reason or CUT_OFF
        messages = sum(copy.counts[topic.name] for topic in topics.TOPICS if not topic.for_viewers)
        clean = clean and (promised is None or promised.messages == messages)
        facts = {"segment": where.segment, "reason": end_reason, "clean": clean, "steps": copy.counts[topics.STEP]}
        facts |= {"stopped": part.stopped, "planned": copy.planned, "completed": len(copy.completed)}
        facts |= {"lasted_ns": copy.lasted_ns}
        if promised is not None:
            facts |= {
                "messages_written": promised.messages,
                "late_writes": promised.late_writes,
                "longest_wait_ms": round(1e3 * promised.longest_wait_s),
            }
        writer.flush()
        writer.add_metadata(topics.END_METADATA, {name: str(value).lower() for name, value in facts.items()})
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return Finished(
        path=where.log,
        readable=True,
        steps=copy.counts[topics.STEP],
        episodes=copy.counts[topics.EPISODE_START],
        end_reason=end_reason,
        stopped=part.stopped,
        messages=messages,
    )


class _Copy:
    """Copies whole files into one writer, giving schemas and channels that recur one number."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._channels: dict[tuple[str, int], int] = {}
        self._attachments: set[tuple[str, bytes]] = set()
        self.counts: Counter[str] = Counter()  # messages a topic
        self.end_reason = ""  # of the last file copied; "" if it holds none
        self.planned = 0  # episodes of the session
        self.completed: set[int] = set()  # of them, in all files copied: with an outcome other than abandoned
        self.lasted_ns = 0  # from the last file's first message to its last
        self._first_ns = 0
        self._started_ns: int | None = None  # None: nothing is to be added for viewers

    def all_of(self, scan: Scan, *, draw: bool = False) -> None:
        """Copy every record that the scan finds; add what viewers draw, unless the file has it already."""
        self.counts.clear()
        self.end_reason = ""
        self.lasted_ns = self._first_ns = 0
        self._started_ns = None
        for record in scan:
            match record:
                case LogMessage():
                    self._message(record, scan)
                case Metadata():
                    if draw and record.name == topics.SEGMENT_METADATA:
                        self._started_ns = int(record.metadata["started_unix_ns"])
                    self._writer.flush()  # else it would come before the messages that it follows
                    self._writer.add_metadata(record.name, record.metadata)
                case Attachment() if (record.name, record.data) not in self._attachments:
                    self._attachments.add((record.name, record.data))
                    self._writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )

    def _message(self, message: LogMessage, scan: Scan) -> None:
        topic = message.channel.topic
        if topic in _FOR_VIEWERS:
            self._started_ns = None  # a file of an earlier version
        self._for_viewers(message)
        self._writer.add_message(
            self._channel(message.channel, scan.schemas.get(message.channel.schema_id)),
            log_time=message.log_time,
            data=message.data,
            publish_time=message.publish_time,
            sequence=message.sequence,
        )
        self.counts[topic] += 1
        self._first_ns = self._first_ns or message.log_time
        self.lasted_ns = max(self.lasted_ns, message.log_time - self._first_ns)
        if topic == topics.PLAN:
            self._writer.flush()  # a chunk of its own: without it nothing else can be read
        match decode(topic, message.data) if topic in _TOLD else None:
            case SessionStarted(plan=plan):
                self.planned = len(plan.episodes)
            case EpisodeEnded(outcome=outcome, episode=episode) if outcome != "abandoned":
                self.completed.add(episode)
            case SessionEnded(reason=reason):
                self.end_reason = reason

    def _for_viewers(self, message: LogMessage) -> None:
        """Add what viewers draw of a message, before it: a step whose own message is there is whole."""
        if self._started_ns is None:
            return
        drawings: list[tuple[str, Message]] = []
        with suppress(Exception):  # of bytes that a foreign hand wrote; the message itself is kept all the same
            drawings += for_viewers(message.channel.topic, message.data, started_ns=self._started_ns)
        for topic, drawn in drawings:
            name = drawn.DESCRIPTOR.full_name
            schema = Schema(id=0, data=schema_bytes(type(drawn)), encoding="protobuf", name=name)
            self._writer.add_message(
                self._channel(Channel(0, topic, "protobuf", {}, 0), schema),
                log_time=message.log_time,
                data=drawn.SerializeToString(deterministic=True),
                publish_time=message.publish_time,
                sequence=NOT_COUNTED,
            )
            self.counts[topic] += 1

    def _channel(self, channel: Channel, schema: Schema | None) -> int:
        known = ("", b"") if schema is None else (schema.name, schema.data)
        if schema is None:
            self._schemas[known] = 0  # as MCAP says that there is none; another program's topic may have none
        elif known not in self._schemas:
            self._schemas[known] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        key = (channel.topic, self._schemas[known])
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                channel.topic, channel.message_encoding, self._schemas[known], channel.metadata
            )
        return self._channels[key]


def _put_aside(part: Path, why: str) -> Path:
    """Keep a live file as it is, under a name that nothing else has."""
    for number in itertools.count(1):
        aside = part.with_name(f"{part.name}.{why}-{number}")
        if not aside.exists():
            break
    part.rename(aside)
    sync_folder(part.parent)
    return aside
