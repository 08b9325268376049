"""Finalizes a live log: copies its intact records, writes index and checksums, and renames it to the session's log.

This is done alike for a session that ended normally (``finish_log``), one that was cut off (``recover_log``) and a
damaged finished log (``repair_log``). The result contains every message of the live file and of the session's earlier
segments unchanged. Only then is the live file removed or, if it could not be read to its end, kept under another name.
"""

import itertools
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.writer import IndexType, Writer

from minihuman.errors import LogError, MinihumanError, NewerLogError
from minihuman.log import names, topics
from minihuman.log.codec import RECORD_TOPICS
from minihuman.log.model.session_log import CUT_OFF
from minihuman.log.paths import MAGIC, PART_SUFFIX, SegmentPath, is_companion_file, raise_as_log_error
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.record.file_lock import hold_leftover, is_being_recorded
from minihuman.log.record.live_log import LIBRARY_NAME
from minihuman.log.record.log_copier import LogCopier
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.storage.durable_files import sync_folder, write_durably
from minihuman.storage.outside_names import is_system_companion
from minihuman.storage.system import current_system

UNFINISHED_SUFFIX = ".finishing"  # the suffix of a log's name until it is complete


class NotPublishedError(MinihumanError, OSError):
    """A log could not be stored where every server has it, so it was not finished; the live file remains."""


CHUNK_BYTES = 64 * 1024  # the most that one damaged bit can destroy


@dataclass(frozen=True, slots=True)
class ExpectedContent:
    """What a recorder has written, to be compared with the content of the file."""

    messages: int
    crc: int  # of all its bytes
    late_writes: int  # number of writes that were not over when their picture was shown
    longest_wait_s: float  # the longest wait for a write


@dataclass(frozen=True, slots=True)
class FinalizedLog:
    """The outcome of finalizing a live file."""

    path: Path  # the session's log, or where an unreadable live file was put aside
    readable: bool  # False if it does not even have the session's plan
    steps: int  # of this segment
    episodes: int  # number of episodes started in this segment
    end_reason: str  # an EndReason, or "cut_off"
    damage: str  # where and why reading stopped before the live file's end; "" if it did not
    messages: int = 0  # of this segment's record
    damaged_copy_path: Path | None = None  # the unchanged copy of the live file, if it was damaged
    chain: str = ""  # the head of the log's hash chain
    was_finished: bool = False  # whether this is a repaired finished log, so that what it lacks has been lost

    @property
    def damaged(self) -> bool:
        """Return whether part of a readable log was damaged; a torn last write of a live file is not damage."""
        torn = self.damage.startswith("cut off") and not self.was_finished
        return bool(self.damage) and self.readable and not torn

    def describe(self) -> str:
        """Return a description of the outcome in one line."""
        if not self.readable:
            return f"{self.path}: kept nothing; {self.damage}"
        line = f"{self.path}: kept {self.steps} steps of {self.episodes} episodes; ended: {self.end_reason}"
        if not self.damage:
            return line
        copy_note = f"; an unchanged copy is {self.damaged_copy_path}" if self.damaged else ""
        return f"{line}; the file was {self.damage}{copy_note}"


def finish_log(
    segment_path: SegmentPath,
    *,
    clean: bool,
    promised: ExpectedContent | None = None,
    publish: Callable[[Path], None] = lambda _: None,
) -> FinalizedLog:
    """Turn a live file into the session's log, or merge it into that log. The caller must hold the file's lock.

    Args:
        segment_path: the paths of the live file and the log.
        clean: whether the session ended normally.
        promised: what the recorder wrote; a segment with less content is not clean.
        publish: stores the log where every server has it, before it gets its name here.

    Raises:
        NotPublishedError: if ``publish`` does; the live file remains.
        LogError: if the session's log is damaged or holds another run of this segment; the live file remains.
        OSError: if the disk is full; the live file remains.
    """
    starts = {} if _is_blank(segment_path.part) else read_segment_starts(segment_path.part, first=True)
    if not starts:  # nothing was recorded yet, or the file's start was lost
        return _put_unreadable_aside(segment_path.part)
    earlier = read_segment_starts(segment_path.log) if segment_path.log.exists() else {}
    has_new_segment = bool(starts.items() - earlier.items())
    if has_new_segment:
        _require_new_segment(segment_path, earlier)
    temporary = segment_path.log.with_name(f"{segment_path.log.name}{UNFINISHED_SUFFIX}")
    try:
        finalized = _write_finished_log(segment_path, temporary, with_log=bool(earlier), clean=clean, promised=promised)
        if has_new_segment:  # otherwise an earlier call was killed before it removed the live file
            publish(temporary)
            _rename(temporary, segment_path.log)
    finally:
        _remove(temporary)
    if not has_new_segment and not finalized.damage:
        finalized = _compare_with_log(segment_path, finalized)
    if finalized.damage:  # keep it, since the unread bytes may still be of use
        return replace(finalized, damaged_copy_path=put_aside(segment_path.part, "as-found"))
    current_system().disk.unlink(segment_path.part)
    sync_folder(segment_path.part.parent)
    return finalized


def _put_unreadable_aside(part: Path) -> FinalizedLog:
    """Rename a live file that holds no plan, and return this outcome."""
    new_path = put_aside(part, "unreadable")
    return FinalizedLog(
        path=new_path,
        readable=False,
        steps=0,
        episodes=0,
        end_reason=CUT_OFF,
        damage="it holds no session plan",
        damaged_copy_path=new_path,
    )


def _require_new_segment(segment_path: SegmentPath, earlier: Mapping[int, str]) -> None:
    """Require that the session's log has no other segment with the live file's number.

    Args:
        segment_path: the paths of the live file and the log.
        earlier: the start times of the log's segments, by segment number.

    Raises:
        LogError: if it has one.
    """
    if segment_path.segment in earlier:
        raise LogError(
            f"{segment_path.log} already has a different segment {segment_path.segment}; move that log away, then "
            "recover again"
        )


def _compare_with_log(segment_path: SegmentPath, finalized: FinalizedLog) -> FinalizedLog:
    """Return the outcome, stated as damaged if the live file has messages that the log lacks, as after a resume.

    Args:
        segment_path: the paths of the live file and of the log that has its segment already.
        finalized: the outcome of reading the live file.
    """
    # ``in`` continues after the message that was found last, since it consumes the iterator: the order is checked, too
    logged = _read_record(segment_path.log)
    topics_in_log = [message[0] for message in _read_record(segment_path.part) if message in logged]
    if len(topics_in_log) >= finalized.messages:
        return finalized
    return replace(
        finalized,
        damage="longer than its segment in the log",
        steps=topics_in_log.count(topics.STEP),
        messages=len(topics_in_log),
    )


def _read_record(path: Path) -> Iterator[tuple[str, int, int, int, bytes]]:
    """Yield the messages of a file's record, in file order and without previews, as tuples that can be compared.

    A tuple has the topic, the sequence number, the log time, the publish time and the data.
    """
    return (
        (record.channel.topic, *record[1:])
        for record in LogScanner(path)
        if isinstance(record, LogMessage) and record.channel.topic in RECORD_TOPICS
    )


def _is_blank(part: Path) -> bool:
    """Return whether a file is empty or begins with zeros, as after a power cut that preserves only its size."""
    with part.open("rb") as file:
        return not file.read(len(MAGIC)).strip(b"\0")


def recover_log(part: Path, publish: Callable[[Path], None] = lambda _: None) -> FinalizedLog:
    """Finish a cut-off log and mark it as not clean.

    Args:
        part: the live file.
        publish: stores the log where every server has it, as in ``finish_log``.

    Raises:
        NotPublishedError: if ``publish`` does; the live file remains.
        LogError: if a running session is still writing the file, it does not exist, its session's log is damaged, or
            the disk is full; the live file remains.
    """
    segment_path = SegmentPath.of_part(part)
    with hold_leftover(part):
        try:
            with raise_as_log_error(part, "recovered"):
                return finish_log(segment_path, clean=False, publish=publish)
        except NotPublishedError:
            raise
        except OSError as error:
            raise LogError(f"{part} could not be recovered and is unchanged: {error.strerror}") from error


def repair_log(log: Path) -> FinalizedLog:
    """Rewrite a damaged finished log with all that is intact in it; the damaged file is kept beside it.

    Raises:
        LogError: if the log cannot be opened, is not a session log, has a newer version, holds no plan, is intact, or
            the disk is full; it then remains as it was.
    """
    try:
        with raise_as_log_error(log):
            read_segment_starts(log)
    except NewerLogError:
        if is_whole_log(log):  # otherwise the version may be damaged, too
            raise
    except LogError:
        pass
    else:
        raise LogError(f"{log} is intact; there is nothing to recover")
    with raise_as_log_error(log, "recovered"):
        return _rewrite_damaged(log)


def is_whole_log(log: Path) -> bool:
    """Return whether a finished log can be read from start to end, with every checksum correct."""
    scan = LogScanner(log)
    try:
        for _ in scan.records():
            pass
    except LogError:
        return False
    return not scan.unfinished_reason


def _rewrite_damaged(log: Path) -> FinalizedLog:
    """Replace a damaged log by a new one with all that is intact in it, as ``repair_log`` does."""
    temporary = log.with_name(f"{log.name}{UNFINISHED_SUFFIX}")
    try:
        scan = LogScanner(log)
        with _open_finished_log(temporary) as copy:
            copy.copy_file(scan)
            numbers = {int(facts["segment"]) for facts in copy.starts}
            if not numbers:
                raise LogError(
                    f"{log} is {scan.unfinished_reason} and has no session plan left, so it cannot be repaired; move "
                    "it out of the study"
                )
            damage = scan.unfinished_reason
            copy.record_missing(gap for gap in scan.missing if gap not in scan.declared)
            last = int(copy.starts[-1]["segment"])
            for segment in sorted(numbers - {int(facts["segment"]) for facts in copy.ends if "segment" in facts}):
                facts = copy.summarize_segment() if segment == last else {"reason": CUT_OFF}
                copy.record_end(segment, **facts, clean=False, stopped=f"{names.FINISHED_LOG_WAS}{damage}")
            copy.add_metadata(names.REPAIRED_METADATA, {"damage": damage})
        kept_path = put_aside(log, "as-found", linked=True)
        _rename(temporary, log)
    except OSError as error:
        raise LogError(f"{log} could not be repaired and is unchanged: {error.strerror}") from error
    finally:
        _remove(temporary)
    steps = copy.total[topics.STEP]
    episodes = copy.total[topics.EPISODE_START]
    end_reason = copy.end_reason or CUT_OFF
    # True: the log is readable, since it has a plan
    return FinalizedLog(log, True, steps, episodes, end_reason, damage, damaged_copy_path=kept_path, was_finished=True)


def archive_log(log: Path, folder: Path) -> Path:
    """Copy an intact log into a folder without its message index, which makes it nearly a third smaller.

    The copy verifies as the log itself does.

    Returns:
        The path of the copy.

    Raises:
        LogError: if the log cannot be opened, is not a session log or is damaged, or its copy exists already.
        OSError: if the disk is full.
    """
    target = folder / log.name
    if target.exists():
        raise LogError(f"{target} already exists; choose another folder, or move that file away")
    with raise_as_log_error(log, "copied"):
        read_segment_starts(log)
        temporary = target.with_name(f"{target.name}{UNFINISHED_SUFFIX}")
        with _open_finished_log(temporary, IndexType.ALL ^ IndexType.MESSAGE) as copy:
            copy.copy_file(LogScanner(log))
    _rename(temporary, target)
    return target


def find_leftovers(folder: Path) -> list[Path]:
    """Return the cut-off logs anywhere below a folder, without those still being written and other programs' files."""
    unfinished = []
    for part in sorted(folder.rglob(f"*{PART_SUFFIX}")):
        is_foreign = is_companion_file(part) or is_system_companion(part.name)
        if not is_foreign and not is_being_recorded(part):
            unfinished.append(part)
    return unfinished


def _write_finished_log(
    segment_path: SegmentPath, target: Path, *, with_log: bool, clean: bool, promised: ExpectedContent | None
) -> FinalizedLog:
    """Write a new finished log from a live file, and return the outcome.

    Args:
        segment_path: the paths of the live file and the session's log.
        target: the path of the new log.
        with_log: whether to copy the session's log into it first.
        clean: whether the session ended normally.
        promised: what the recorder wrote; None if that is unknown.
    """
    with _open_finished_log(target) as copy:
        if with_log:
            copy.copy_file(LogScanner(segment_path.log))
        part = LogScanner(segment_path.part)
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
        copy.record_missing(part.missing)
        copy.record_end(segment_path.segment, **facts)
    return FinalizedLog(
        path=segment_path.log,
        readable=True,
        steps=copy.counts[topics.STEP],
        episodes=copy.counts[topics.EPISODE_START],
        end_reason=copy.end_reason or CUT_OFF,
        damage=damage,
        messages=messages,
        chain=copy.chain.head,
    )


@contextmanager
def _open_finished_log(target: Path, indexes: IndexType = IndexType.ALL) -> Iterator[LogCopier]:
    """Open a new finished log for writing, with these kinds of index; it is durable when the context exits."""
    with write_durably(target) as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True, index_types=indexes)
        writer.start(profile=names.PROFILE, library=LIBRARY_NAME)
        yield LogCopier(writer)
        writer.finish()


def _rename(temporary: Path, log: Path) -> None:
    """Rename a finished log durably to its final name."""
    current_system().disk.rename(temporary, log)
    sync_folder(log.parent)


def _remove(temporary: Path) -> None:
    with suppress(FileNotFoundError):
        current_system().disk.unlink(temporary)


def put_aside(file: Path, why: str, *, linked: bool = False) -> Path:
    """Rename a file to an unused name and return the new path.

    Args:
        file: the file, a live file or a finished log.
        why: the reason, which becomes part of the new name.
        linked: whether to keep the file under its own name, too.
    """
    for number in itertools.count(1):
        new_path = file.with_name(f"{file.name}.{why}-{number}")
        if not new_path.exists():
            break
    if linked:
        os.link(file, new_path)
    else:
        current_system().disk.rename(file, new_path)
    sync_folder(file.parent)
    return new_path
