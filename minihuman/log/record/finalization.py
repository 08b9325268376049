"""Finalize a live log: copy its whole records, write index and checksums, and rename it to the session's log.

The same for a session that ended normally (``finish_log``), one that was cut off (``recover_log``) and a damaged
finished log (``repair_log``). Every message of the live file and of the session's earlier segments is in the result
unchanged; only then is the live file removed or, if it could not be read to its end, kept under another name.
"""

import itertools
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from google.protobuf.message import Message as Protobuf
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import IndexType, Writer

from minihuman.errors import LogError, MinihumanError, NewerLogError
from minihuman.experiment.machine.events import EpisodeEnded, EpisodesSkipped, Event, SessionEnded, SessionStarted
from minihuman.log import integrity, names, topics
from minihuman.log.codec import RECORD_TOPICS, decode_event
from minihuman.log.integrity import HashChain
from minihuman.log.model.session_log import CUT_OFF
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import PART_SUFFIX, SegmentPath, is_companion_file, raise_as_log_error
from minihuman.log.preview import PreviewEncoder
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.record.file_lock import hold_leftover, is_being_recorded
from minihuman.log.record.live_log import LIBRARY_NAME
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner, MissingMessages
from minihuman.storage.durable_files import sync_folder, write_durably
from minihuman.storage.outside_names import is_system_companion
from minihuman.storage.system import current_system

UNNUMBERED = 0  # the sequence of a preview
UNFINISHED_SUFFIX = ".finishing"  # of a log until it has its name
EPISODE_BYTES = 16 * 1024  # an episode with fewer shares its chunk with the next
_PREVIEW_TOPICS = frozenset(topic.name for topic in topics.TOPICS if topic.is_preview)
_SUMMARY_TOPICS = frozenset({topics.SKIP, topics.PLAN, topics.EPISODE_END, topics.SESSION_END})  # for a segment's end
_HEAD = (names.SEGMENT_METADATA, names.FACTS_METADATA)


class NotPublishedError(MinihumanError, OSError):
    """A log could not be kept where every server has it, so it was not finished; the live file stays."""


class LogCopier:
    """Copies whole files into one writer, giving schemas and channels that recur one number."""

    def __init__(self, writer: Writer) -> None:
        self.chain = HashChain()
        self.starts: list[dict[str, str]] = []  # the segments' metadata
        self.ends: list[dict[str, str]] = []
        self.counts: Counter[str] = Counter()  # messages per topic, of the last segment copied
        self.total: Counter[str] = Counter()  # of all segments
        self.end_reason = ""  # of the last segment copied; "" if it holds none
        self.last_sequence = 0  # of the last segment copied
        self.planned = 0  # episodes of the session
        self.skipped = 0  # of them, in all segments copied: a criterion was met, or the time was up
        self.completed: set[int] = set()  # of them, in all segments copied: with an outcome other than abandoned
        self.lasted_ns = 0  # from the last segment's first message to its last
        self._first_ns = 0
        self._writer = writer
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._channels: dict[tuple[str, int], int] = {}
        self._attachments: set[tuple[str, bytes]] = set()
        self._head: dict[str, Metadata] = {}  # of the segment whose plan is next
        self._attached: list[Attachment] = []  # to it
        self._held: list[tuple[LogMessage, Schema | None]] = []  # previews, before that plan
        self._draw = False
        self._previews: PreviewEncoder | None = None  # None: none are added
        self._last: LogMessage | None = None  # of the record
        self._chunk_bytes = 0

    def copy_file(self, scan: LogScanner, *, draw: bool = False) -> None:
        """Copy every record that the scan finds; add previews, unless the file has them."""
        self._previews = None
        self._draw = draw
        for record in scan:
            match record:
                case LogMessage():
                    self._message(record, scan.schemas.get(record.channel.schema_id))
                case Metadata() if record.name in _HEAD:
                    self._head[record.name] = record
                case Metadata():
                    self.metadata(record.name, record.metadata)
                case Attachment() if record.name != integrity.SEGMENT_HEAD_NAME and self._head:
                    self._attached.append(record)
                case Attachment() if record.name != integrity.SEGMENT_HEAD_NAME:
                    self._attachment(record)
        self._write_head()
        if self._previews is not None and self._last is not None:
            self._add_previews(self._previews.finish(), self._last)

    def metadata(self, name: str, facts: Mapping[str, object], *, sealed: bool = False) -> None:
        """Add a metadata record; ``sealed``: with the head of the chain, itself included."""
        record = Metadata(
            name, {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in facts.items()}
        )
        self._flush()  # else it would come before the messages that it follows
        self.chain.metadata(record)
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

    def missing(self, gaps: Iterable[MissingMessages]) -> None:
        """Record which messages were lost."""
        for gap in gaps:
            self.metadata(names.MISSING_METADATA, {"segment": gap.segment, "first": gap.first, "last": gap.last})

    def end(self, segment: int, **facts: object) -> None:
        """Record how a segment ended, with the head of the hash chain."""
        self.metadata(names.END_METADATA, {"segment": segment} | facts, sealed=True)

    def summarize_segment(self) -> dict[str, object]:
        """Summarize the last segment copied, for the metadata of its end."""
        return {
            "reason": self.end_reason or CUT_OFF,
            "steps": self.counts[topics.STEP],
            "last_message": self.last_sequence,
            "planned": self.planned - self.skipped,
            "completed": len(self.completed),
            "lasted_ns": self.lasted_ns,
        }

    def _attachment(self, record: Attachment) -> None:
        if (record.name, record.data) in self._attachments:
            return
        self._attachments.add((record.name, record.data))
        self._flush()
        self._writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        self.chain.attachment(record)

    def _message(self, message: LogMessage, schema: Schema | None) -> None:
        topic = message.channel.topic
        if topic in _PREVIEW_TOPICS:
            self._previews = None  # a file of an earlier version
        if self._head and topic in _PREVIEW_TOPICS:
            self._held.append((message, schema))  # a line about the plan that comes next
            return
        if topic == topics.PLAN:
            self._start(message, schema)
        self._write_head()
        if topic in RECORD_TOPICS:
            self.last_sequence = message.sequence
            self._last = message
        if self._previews is not None:
            self._add_previews(self._previews.encode(topic, message.data), message)
        self._add(message, schema)
        if topic == topics.PLAN or (topic == topics.EPISODE_END and self._chunk_bytes > EPISODE_BYTES):
            self._flush()
        self._first_ns = self._first_ns or message.log_time
        self.lasted_ns = max(self.lasted_ns, message.log_time - self._first_ns)
        if topic in _SUMMARY_TOPICS:
            with suppress(Exception):  # as in _add_previews
                self._count_event(decode_event(topic, message.data))

    def _count_event(self, event: Event | None) -> None:
        match event:
            case SessionStarted(plan=plan):
                self.planned = len(plan.episodes)
            case EpisodesSkipped(count=count):
                self.skipped += count
            case EpisodeEnded(outcome=outcome, episode=episode) if outcome != "abandoned":
                self.completed.add(episode)
            case SessionEnded(reason=reason):
                self.end_reason = reason

    def _start(self, message: LogMessage, schema: Schema | None) -> None:
        """Put the second copy of a segment's start behind its metadata."""
        self._flush()
        if self._draw and names.SEGMENT_METADATA in self._head:
            self._previews = PreviewEncoder(int(self._head[names.SEGMENT_METADATA].metadata["started_unix_ns"]))
        number = self._channel(message.channel, schema)
        topic = message.channel.topic
        encoding = message.channel.message_encoding
        schemas = []
        channels = [Channel(number, topic, encoding, message.channel.metadata, schema_id=0)]
        if schema is not None:
            channels[0].schema_id = self._schemas[schema.name, schema.data]
            schemas.append(Schema(channels[0].schema_id, schema.data, schema.encoding, schema.name))
        plan = Message(number, message.log_time, message.data, message.publish_time, message.sequence)
        copied = integrity.pack_segment_head(self._head.values(), schemas, channels, plan)
        self._write_head(copied, message.log_time)

    def _write_head(self, copied: bytes = b"", log_time: int = 0) -> None:
        head = self._head
        self._head = {}
        attached = self._attached
        self._attached = []
        held = self._held
        self._held = []
        for record in head.values():
            self.metadata(record.name, record.metadata)
        if copied:
            self._writer.add_attachment(
                log_time, log_time, integrity.SEGMENT_HEAD_NAME, integrity.SEGMENT_HEAD_MEDIA_TYPE, copied
            )
        for attachment in attached:
            self._attachment(attachment)
        for message, schema in held:
            self._add(message, schema)

    def _add_previews(self, previews: Iterator[tuple[str, Protobuf]], message: LogMessage) -> None:
        """Add previews with a message's times, before it: a step whose own message is there is whole."""
        drawings: list[tuple[str, Protobuf]] = []
        with suppress(Exception):  # of foreign bytes; the message itself is kept
            drawings += previews
        for topic, drawn in drawings:
            name = drawn.DESCRIPTOR.full_name
            data = drawn.SerializeToString(deterministic=True)
            schema = Schema(id=0, data=topics.schema_bytes(type(drawn)), encoding="protobuf", name=name)
            channel = Channel(id=0, topic=topic, message_encoding="protobuf", metadata={}, schema_id=0)
            self._add(LogMessage(channel, UNNUMBERED, message.log_time, message.publish_time, data), schema)

    def _add(self, message: LogMessage, schema: Schema | None) -> None:
        self._writer.add_message(
            self._channel(message.channel, schema),
            log_time=message.log_time,
            data=message.data,
            publish_time=message.publish_time,
            sequence=message.sequence,
        )
        self.chain.message(message, schema)
        self.counts[message.channel.topic] += 1
        self.total[message.channel.topic] += 1
        self._chunk_bytes += 1 + len(message.data)

    def _flush(self) -> None:
        """End the chunk, if there is a message in it."""
        if self._chunk_bytes:
            self._writer.flush()
            self._chunk_bytes = 0

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


CHUNK_BYTES = 64 * 1024  # what a damaged bit can cost


@dataclass(frozen=True, slots=True)
class ExpectedContent:
    """What a recorder has written, to compare with what is found."""

    messages: int
    crc: int  # of all bytes
    late_writes: int  # that the disk did not take before their picture was shown
    longest_wait_s: float  # of a write


@dataclass(frozen=True, slots=True)
class FinalizedLog:
    """What became of a live file."""

    path: Path  # the session's log, or where an unreadable live file was put aside
    readable: bool  # False: not even the session's plan was in it
    steps: int  # of this segment
    episodes: int  # of this segment, started
    end_reason: str  # an EndReason, or "cut_off"
    damage: str  # where and why reading stopped before the live file's end; "" if it did not
    messages: int = 0  # of this segment's record
    damaged_copy_path: Path | None = None  # where the live file was kept as it was found, if it was not whole
    chain: str = ""  # the head of the log's hash chain
    was_finished: bool = False  # a finished log, made again: what it lacks was there once

    @property
    def damaged(self) -> bool:
        """Whether something in it was damaged; a torn last write of a live file is not damage."""
        torn = self.damage.startswith("cut off") and not self.was_finished
        return bool(self.damage) and self.readable and not torn

    def describe(self) -> str:
        """Describe it in one line."""
        if not self.readable:
            return f"{self.path}: kept nothing; {self.damage}"
        line = f"{self.path}: kept {self.steps} steps of {self.episodes} episodes; ended: {self.end_reason}"
        if self.damaged:
            kept = f"; an unchanged copy is {self.damaged_copy_path}"
        else:
            kept = ""
        if self.damage:
            return f"{line}; the file was {self.damage}{kept}"
        return line


def finish_log(
    where: SegmentPath,
    *,
    clean: bool,
    promised: ExpectedContent | None = None,
    publish: Callable[[Path], None] = lambda _: None,
) -> FinalizedLog:
    """Turn a live file into the session's log, or merge it into it. The caller holds the file's lock.

    Args:
        where: the live file, and the log.
        clean: whether the session ended normally.
        promised: what its recorder wrote; a segment that holds less is not clean.
        publish: keeps the log where every server has it, before the log has its name here.

    Raises:
        NotPublishedError: if ``publish`` does; the live file stays.
        LogError: if the session's log is damaged or holds another run of this segment; the live file stays.
        OSError: if the disk is full; the live file stays.
    """
    if _is_blank(where.part):
        starts = {}
    else:
        starts = read_segment_starts(where.part, first=True)
    if not starts:  # nothing was played yet, or the file's start is gone
        aside = put_aside(where.part, "unreadable")
        return FinalizedLog(aside, False, 0, 0, CUT_OFF, "it holds no session plan", damaged_copy_path=aside)
    earlier = read_segment_starts(where.log) if where.log.exists() else {}
    new = starts.items() - earlier.items()
    if new and where.segment in earlier:
        raise LogError(
            f"{where.log} already holds a different segment {where.segment}; move that log away, then recover again"
        )
    temporary = where.log.with_name(f"{where.log.name}{UNFINISHED_SUFFIX}")
    try:
        result = _rewrite(where, temporary, with_log=bool(earlier), clean=clean, promised=promised)
        if new:  # else a finish that was cut off before it removed the live file
            publish(temporary)
            current_system().disk.rename(temporary, where.log)
            sync_folder(where.log.parent)
    finally:
        _remove(temporary)
    if not new and not result.damage:  # all of it has to be in the log: it may have been resumed since
        logged = _read_record(where.log)
        held = [message[0] for message in _read_record(where.part) if message in logged]
        if len(held) < result.messages:
            result = replace(
                result,
                damage="longer than its segment in the log",
                steps=held.count(topics.STEP),
                messages=len(held),
            )
    if result.damage:  # what could not be read may still be of use
        return replace(result, damaged_copy_path=put_aside(where.part, "as-found"))
    current_system().disk.unlink(where.part)
    sync_folder(where.part.parent)
    return result


def _read_record(path: Path) -> Iterator[tuple[str, int, int, int, bytes]]:
    """Read what a file's messages say, in its order and without previews."""
    return (
        (record.channel.topic, *record[1:])
        for record in LogScanner(path)
        if isinstance(record, LogMessage) and record.channel.topic in RECORD_TOPICS
    )


def _is_blank(part: Path) -> bool:
    """Whether a power cut left a file's size and nothing of its start."""
    with part.open("rb") as file:
        return not file.read(8).strip(b"\0")


def recover_log(part: Path, publish: Callable[[Path], None] = lambda _: None) -> FinalizedLog:
    """Finish a cut-off log; it is marked as not clean.

    Args:
        part: the live file.
        publish: as in ``finish_log``.

    Raises:
        NotPublishedError: if ``publish`` does; the live file stays.
        LogError: if a running session still writes it, it is gone, its session's log is damaged, or the disk is full;
            the live file stays.
    """
    where = SegmentPath.of_part(part)
    with hold_leftover(part):
        try:
            with raise_as_log_error(part, "recovered"):
                return finish_log(where, clean=False, publish=publish)
        except NotPublishedError:
            raise
        except OSError as error:
            raise LogError(f"{part} could not be recovered and is unchanged: {error.strerror}") from error


def repair_log(log: Path) -> FinalizedLog:
    """Rewrite a damaged finished log with all that is whole in it; the damaged file is kept beside it.

    Raises:
        LogError: if it cannot be opened, is no session log, of a newer version, holds no plan, is whole, or the disk is
            full; it stays.
    """
    try:
        with raise_as_log_error(log):
            read_segment_starts(log)
    except NewerLogError:
        if is_whole_log(log):  # else the version, too, may be damaged
            raise
    except LogError:
        pass
    else:
        raise LogError(f"{log} is intact; there is nothing to recover")
    with raise_as_log_error(log, "recovered"):
        return _repaired(log)


def is_whole_log(log: Path) -> bool:
    """Say whether a finished log can be read from its start to its end, with every checksum right."""
    scan = LogScanner(log)
    try:
        for _ in scan.records():
            pass
    except LogError:
        return False
    return not scan.unfinished_reason


def _repaired(log: Path) -> FinalizedLog:
    temporary = log.with_name(f"{log.name}{UNFINISHED_SUFFIX}")
    try:
        scan = LogScanner(log)
        with _written(temporary) as copy:
            copy.copy_file(scan)
            segments = {int(facts["segment"]) for facts in copy.starts}
            if not segments:
                raise LogError(
                    f"{log} is {scan.unfinished_reason} and has no session plan left, so it cannot be repaired; move "
                    "it out of the study"
                )
            lacks = scan.unfinished_reason
            copy.missing(gap for gap in scan.missing if gap not in scan.declared)
            last = int(copy.starts[-1]["segment"])
            for segment in sorted(segments - {int(facts["segment"]) for facts in copy.ends if "segment" in facts}):
                if segment == last:
                    facts = copy.summarize_segment()
                else:
                    facts = {"reason": CUT_OFF}
                copy.end(segment, **facts, clean=False, stopped=f"{names.FINISHED_LOG_WAS}{lacks}")
            copy.metadata(names.REPAIRED_METADATA, {"damage": lacks})
        aside = put_aside(log, "as-found", linked=True)
        current_system().disk.rename(temporary, log)
        sync_folder(log.parent)
    except OSError as error:
        raise LogError(f"{log} could not be repaired and is unchanged: {error.strerror}") from error
    finally:
        _remove(temporary)
    steps = copy.total[topics.STEP]
    episodes = copy.total[topics.EPISODE_START]
    ended = copy.end_reason or CUT_OFF
    return FinalizedLog(log, True, steps, episodes, ended, lacks, damaged_copy_path=aside, was_finished=True)


def archive_log(log: Path, folder: Path) -> Path:
    """Copy a whole log into a folder, without its index of messages: nearly a third smaller. It proves as the log does.

    Raises:
        LogError: if it cannot be opened, is no session log, is damaged, or its copy is there already.
        OSError: if the disk is full.
    """
    target = folder / log.name
    if target.exists():
        raise LogError(f"{target} already exists; choose another folder, or move that file away")
    with raise_as_log_error(log, "copied"):
        read_segment_starts(log)
        temporary = target.with_name(f"{target.name}{UNFINISHED_SUFFIX}")
        with _written(temporary, IndexType.ALL ^ IndexType.MESSAGE) as copy:
            copy.copy_file(LogScanner(log))
    current_system().disk.rename(temporary, target)
    sync_folder(folder)
    return target


def find_leftovers(folder: Path) -> list[Path]:
    """List the cut-off logs anywhere below a folder, those still being written and other programs' files left out."""
    return [
        part
        for part in sorted(folder.rglob(f"*{PART_SUFFIX}"))
        if not is_companion_file(part) and not is_system_companion(part.name) and not is_being_recorded(part)
    ]


def _rewrite(
    where: SegmentPath, target: Path, *, with_log: bool, clean: bool, promised: ExpectedContent | None
) -> FinalizedLog:
    with _written(target) as copy:
        if with_log:
            copy.copy_file(LogScanner(where.log))
        part = LogScanner(where.part)
        copy.copy_file(part, draw=True)
        messages = sum(count for topic, count in copy.counts.items() if topic in RECORD_TOPICS)
        damage = part.damage
        if promised is not None and not damage and (messages, part.crc) != (promised.messages, promised.crc):
            damage = "not what was written"
        facts = copy.summarize_segment() | {"clean": clean and not damage, "stopped": damage}
        if promised is not None:
            facts |= {
                "last_message": promised.messages,
                "late_writes": promised.late_writes,
                "longest_wait_ms": round(1e3 * promised.longest_wait_s),
            }
        copy.missing(part.missing)
        copy.end(where.segment, **facts)
    return FinalizedLog(
        path=where.log,
        readable=True,
        steps=copy.counts[topics.STEP],
        episodes=copy.counts[topics.EPISODE_START],
        end_reason=copy.end_reason or CUT_OFF,
        damage=damage,
        messages=messages,
        chain=copy.chain.head,
    )


@contextmanager
def _written(target: Path, indexes: IndexType = IndexType.ALL) -> Iterator[LogCopier]:
    """Write a new finished log; it is durable on exit."""
    with write_durably(target) as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True, index_types=indexes)
        writer.start(profile=names.PROFILE, library=LIBRARY_NAME)
        yield LogCopier(writer)
        writer.finish()


def _remove(temporary: Path) -> None:
    with suppress(FileNotFoundError):
        current_system().disk.unlink(temporary)


def put_aside(part: Path, why: str, *, linked: bool = False) -> Path:
    """Keep a file as it is under an unused name; ``linked``: under its own name, too."""
    for number in itertools.count(1):
        aside = part.with_name(f"{part.name}.{why}-{number}")
        if not aside.exists():
            break
    if linked:
        os.link(part, aside)
    else:
        current_system().disk.rename(part, aside)
    sync_folder(part.parent)
    return aside
