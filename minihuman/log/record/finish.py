"""A live log made into the session's log: read as far as it is whole, rewritten with index and checksums, renamed.

The same for a session that ended well (``finish``) and for one that was cut off (``recover``). Every message of the
live file, and of the session's earlier segments, is in the result unchanged; only then is the live file removed, or,
if it could not be read to its end, put aside.
"""

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.writer import Writer

from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.kinds import TRUTHS
from minihuman.log.paths import PART_SUFFIX, SegmentPath, is_guest
from minihuman.log.read.file import segment_starts
from minihuman.log.read.guard import guarded
from minihuman.log.read.scan import Scan
from minihuman.log.record.claim import is_live, sync_folder, taken
from minihuman.log.record.copy import Copy
from minihuman.log.record.live_file import LIBRARY
from minihuman.recorded.episode import CUT_OFF

CHUNK_BYTES = 64 * 1024  # what a damaged bit can cost


@dataclass(frozen=True, slots=True)
class Promised:
    """What a recorder has written, so that it can be told from what is found."""

    messages: int
    crc: int  # of all bytes
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
    chain: str = ""  # the head of the log's hash chain
    was_finished: bool = False  # a finished log, made again: what it lacks was there once

    @property
    def damaged(self) -> bool:
        """Whether something in it was harmed; a live file's last write that a cut tore is not."""
        torn = self.stopped.startswith("cut off") and not self.was_finished
        return bool(self.stopped) and self.readable and not torn

    def line(self) -> str:
        """Say it in one line."""
        if not self.readable:
            return f"{self.path}: kept nothing; {self.stopped}"
        told = f"{self.path}: kept {self.steps} steps of {self.episodes} episodes; ended: {self.end_reason}"
        kept = f"; it is kept as it was found: {self.aside}" if self.damaged else ""
        return f"{told}; the file was {self.stopped}{kept}" if self.stopped else told


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
    if result.stopped:  # what could not be read may yet be of use to somebody
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
            with guarded(part, "recovered"):
                return finish(where, clean=False)
        except OSError as error:
            raise LogError(f"{part} could not be finished and stays as it is: {error.strerror}") from error


def repair(log: Path) -> Finished:
    """Rewrite a damaged finished log with all that is whole in it; the damaged file is kept beside it.

    Raises:
        LogError: if it cannot be opened, is no session log, holds no plan, is whole, or the disk is full; it stays.
    """
    try:
        with guarded(log):
            segment_starts(log)
    except LogError:
        pass
    else:
        raise LogError(f"{log} is whole: there is nothing to recover in it")
    with guarded(log, "recovered"):
        return _repaired(log)


def _repaired(log: Path) -> Finished:
    temporary = log.with_name(f"{log.name}.finishing")
    try:
        scan = Scan(log)
        with _written(temporary) as copy:
            copy.all_of(scan)
            segments = {int(facts["segment"]) for facts in copy.starts}
            if not segments:
                raise LogError(f"{log} is {scan.unfinished}: no session plan is left in it; move it out of its study")
            lacks = scan.unfinished
            copy.missing(gap for gap in scan.missing if gap not in scan.declared)
            last = int(copy.starts[-1]["segment"])
            for segment in sorted(segments - {int(facts["segment"]) for facts in copy.ends if "segment" in facts}):
                told = copy.told() if segment == last else {"reason": CUT_OFF}
                copy.end(segment, **told, clean=False, stopped=f"{topics.FINISHED_LOG_WAS}{lacks}")
            copy.metadata(topics.REPAIRED_METADATA, {"damage": lacks})
        aside = _put_aside(log, "as-found", linked=True)
        os.replace(temporary, log)
        sync_folder(log.parent)
    except OSError as error:
        raise LogError(f"{log} could not be rewritten and stays as it is: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)
    steps, episodes = copy.total[topics.STEP], copy.total[topics.EPISODE_START]
    ended = copy.end_reason or CUT_OFF
    return Finished(log, True, steps, episodes, ended, lacks, aside=aside, was_finished=True)


def leftovers(folder: Path) -> list[Path]:
    """List the cut-off logs anywhere below a folder, those still being written and other programs' files left out."""
    return [part for part in sorted(folder.rglob(f"*{PART_SUFFIX}")) if not is_guest(part) and not is_live(part)]


def _rewrite(where: SegmentPath, target: Path, *, with_log: bool, clean: bool, promised: Promised | None) -> Finished:
    with _written(target) as copy:
        if with_log:
            copy.all_of(Scan(where.log))
        part = Scan(where.part)
        copy.all_of(part, draw=True)
        messages = sum(count for topic, count in copy.counts.items() if topic in TRUTHS)
        damage = part.damage
        if promised is not None and not damage and (messages, part.crc) != (promised.messages, promised.crc):
            damage = "not what was written"
        facts = copy.told() | {"clean": clean and not damage, "stopped": damage}
        if promised is not None:
            facts |= {
                "last_message": promised.messages,
                "late_writes": promised.late_writes,
                "longest_wait_ms": round(1e3 * promised.longest_wait_s),
            }
        copy.missing(part.missing)
        copy.end(where.segment, **facts)
    return Finished(
        path=where.log,
        readable=True,
        steps=copy.counts[topics.STEP],
        episodes=copy.counts[topics.EPISODE_START],
        end_reason=copy.end_reason or CUT_OFF,
        stopped=damage,
        messages=messages,
        chain=copy.chain.head,
    )


@contextmanager
def _written(target: Path) -> Iterator[Copy]:
    """A new finished log, durable when this is over."""
    with target.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile=topics.PROFILE, library=LIBRARY)
        yield Copy(writer)
        writer.finish()
        file.flush()
        os.fsync(file.fileno())


def _put_aside(part: Path, why: str, *, linked: bool = False) -> Path:
    """Keep a file as it is, under a name that nothing else has; ``linked``: under its own, too."""
    for number in itertools.count(1):
        aside = part.with_name(f"{part.name}.{why}-{number}")
        if not aside.exists():
            break
    if linked:
        os.link(part, aside)
    else:
        part.rename(aside)
    sync_folder(part.parent)
    return aside
