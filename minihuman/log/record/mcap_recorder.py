"""The recorder on disk: every event in an MCAP file before its picture is shown, every step fsynced soon after.

``write`` encodes and hands the bytes to the operating system: from then on a killed process cannot take them back.
``begin`` and ``settle`` are its two halves, so that the picture is drawn in between.
What makes them last through a power cut, fsync, takes 4 ms at the median and 25 ms at worst, so it has no place between
a key and its picture, and follows on a thread of its own.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from minihuman.errors import LogError, LossError
from minihuman.log.paths import SegmentPath
from minihuman.log.record.appended_file import AppendedFile
from minihuman.log.record.claim import create
from minihuman.log.record.disk import BACKLOG, Disk
from minihuman.log.record.finish import Finished, Promised, finish
from minihuman.log.record.left import Left
from minihuman.log.record.live_file import LiveLog
from minihuman.log.record.recorder import Recorder
from minihuman.log.record.rounds import Rounds
from minihuman.log.record.shared_disk import SharedDisk
from minihuman.log.record.waited_disk import WRITE_BOUND_S, WaitedDisk
from minihuman.study.events import Event, SessionEnded
from minihuman.study.plan import SessionPlan


class McapRecorder(Recorder):
    """Writes one segment of one session. The first event must be its ``SessionStarted``.

    Args:
        data: the data folder; file names below it follow from the plan.
        plan: what is about to be played.
        started_ns: the wall clock at the session's time 0, ns since 1970.
        sync: makes a file descriptor's writes durable.
        put: writes to a file descriptor, and says how many bytes it took.
        bound_s: how long a write that the disk does not take may hold its picture up.
        rounds: does the disk's work for many recorders, where no picture waits for a write.
        backlog: how many writes may wait for the disk before the recorder gives up.
        at_sync: called, by another thread, whenever more has become durable.
        left: a live file of this segment that a killed program left, to go on with; it was locked for this.

    Raises:
        LogError: if the session's log exists already or is being written, or the folder cannot be written.
    """

    def __init__(
        self,
        data: Path,
        plan: SessionPlan,
        *,
        started_ns: int,
        sync: Callable[[int], None] = os.fsync,
        put: Callable[[int, memoryview], int] = os.write,
        bound_s: float = WRITE_BOUND_S,
        rounds: Rounds | None = None,
        backlog: int = BACKLOG,
        at_sync: Callable[[], None] = lambda: None,
        left: Left | None = None,
    ) -> None:
        self.where = SegmentPath.of_plan(data, plan)
        if left is None:
            self._fd = create(self.where)
            self._live = LiveLog(started_ns=started_ns)
        else:
            self._fd = left.fd
            self._live = LiveLog.going_on(plan, started_ns=started_ns, messages=left.messages, steps=left.steps)
        file = AppendedFile(self._fd, self.where.part, sync=sync, put=put, crc=0 if left is None else left.crc)
        self._disk: Disk = (
            WaitedDisk(file, bound_s=bound_s, backlog=backlog, at_sync=at_sync)
            if rounds is None
            else SharedDisk(file, rounds, backlog=backlog, at_sync=at_sync)
        )
        self._ended = False
        self._closed = False

    def write(self, events: Sequence[Event]) -> None:
        """Write the events of one input; when this returns they outlive the process, unless the disk stalls.

        Raises:
            LogError: if this or an earlier write failed, the disk is a whole backlog behind, or the recorder is closed.
        """
        self.begin(events)
        self.settle()

    def begin(self, events: Sequence[Event]) -> None:
        """Hand over the events of one input to be written: whoever shows what came of them calls ``settle`` first.

        Raises:
            LogError: if an earlier write failed, the disk is a whole backlog behind, or the recorder is closed.
        """
        self._refuse_after_failure()
        if self._closed:
            raise LogError(f"{self.where.part} is closed; a new segment needs a new recorder")
        if not events:
            return
        self._ended = self._ended or any(isinstance(event, SessionEnded) for event in events)
        try:
            pieces = self._live.encode(events)
        except Exception as error:  # a bug of ours, or a world's: the log must not go on with a hole in it
            self._disk.failure = error
        else:
            self._disk.begin(pieces, steps=self._live.steps)
        self._refuse_after_failure()

    def settle(self) -> None:
        """Wait until what was begun outlives the process, or the disk stalls.

        Raises:
            LogError: if it could not be written.
        """
        self._disk.settle()
        self._refuse_after_failure()

    @property
    def durable_steps(self) -> int:
        """How many steps of this segment are fsynced."""
        return self._disk.durable_steps

    @property
    def durable_writes(self) -> int:
        """How many of this recorder's writes that had events are fsynced."""
        return self._disk.durable_writes

    @property
    def late_writes(self) -> int:
        """How many writes the disk did not take in time, so that their pictures were shown before them."""
        return self._disk.late

    def drain(self) -> None:
        """Wait until all that was written is durable: for players that have no frame loop to keep.

        Raises:
            LogError: if writing failed.
        """
        self._disk.drain()
        self._refuse_after_failure()

    def leave(self) -> None:
        """Make durable what was written, and let go of the live file as it is, for another program to go on with it.

        A second call, or one after ``close``, does nothing.
        """
        if not self._closed:
            self._closed = True
            self._disk.close()
            os.close(self._fd)

    def close(self) -> Path | None:
        """Write what is left, finish the log and return it. A second call only says where it is.

        Raises:
            LogError: if something could not be written; what could is kept, and the message says where.
            LossError: if the log holds less than was written, because the live file was damaged meanwhile.
        """
        if self._closed:
            return self.where.log if self.where.log.exists() else None
        self._closed = True
        self._disk.close()
        try:
            self._refuse_after_failure()
            promised = Promised(self._live.messages, self._disk.file.crc, self._disk.late, self._disk.longest_wait_s)
            return self._whole(finish(self.where, clean=self._ended, promised=promised)).path
        except OSError as error:
            self._disk.failure = error
            raise self._error() from error
        finally:
            os.close(self._fd)

    def _whole(self, finished: Finished) -> Finished:
        if not finished.stopped or not self._live.messages:  # nothing was written, so nothing is lost
            return finished
        raise LossError(
            f"{finished.path}: kept {finished.steps} of {self._live.steps} steps, {finished.messages} of "
            f"{self._live.messages} messages; somebody or something changed the live file while it was written "
            f"({finished.stopped}); it is kept as it was found: {finished.aside}"
        )

    def _refuse_after_failure(self) -> None:
        if self._disk.failure is not None:
            raise self._error() from self._disk.failure

    def _error(self) -> LogError:
        failure = self._disk.failure
        reason = (isinstance(failure, OSError) and failure.strerror) or str(failure)
        return LogError(
            f"recording stopped: {reason}; {self.durable_steps} steps are safe in {self.where.part}; "
            f"put that right, then run: minihuman recover {self.where.part}"
        )
