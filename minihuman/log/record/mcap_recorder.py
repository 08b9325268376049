"""The recorder on disk: every event in an MCAP file, every step fsynced, the frame loop never waiting.

``write`` only queues. A thread of its own encodes what is queued, writes it as one chunk, and fsyncs: a fsync takes
4 ms at the median and 25 ms at worst, so it has no place between a key and its picture.
"""

import os
import queue
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.paths import SegmentPath
from minihuman.log.record.claim import create
from minihuman.log.record.finish import finish
from minihuman.log.record.live_file import LiveLog
from minihuman.log.record.recorder import Recorder
from minihuman.study.events import Event, SessionEnded
from minihuman.study.plan import SessionPlan

BACKLOG = 65_536  # queued writes; at a hundred a second a disk may stall for ten minutes

_CLOSE: tuple[Event, ...] = ()  # no write ever queues nothing


class McapRecorder(Recorder):
    """Writes one segment of one session. The first event must be its ``SessionStarted``.

    Args:
        data: the data folder; file names below it follow from the plan.
        plan: what is about to be played.
        started_ns: the wall clock at the session's time 0, ns since 1970.
        sync: makes a file descriptor's writes durable.
        backlog: how many writes may wait for the disk before the recorder gives up.

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
        backlog: int = BACKLOG,
    ) -> None:
        self.where = SegmentPath.of_plan(data, plan)
        self._fd = create(self.where)
        self._live = LiveLog(self._fd, self.where.part.parent, started_ns=started_ns, sync=sync)
        self._queue: queue.Queue[tuple[Event, ...]] = queue.Queue(backlog)
        self._failure: Exception | None = None
        self._ended = False
        self._closed = False
        # A daemon, so that a crash of the program is not held up; what was written stays and is recovered.
        self._thread = threading.Thread(target=self._run, name="minihuman-log", daemon=True)
        self._thread.start()

    def write(self, events: Sequence[Event]) -> None:
        """Queue the events of one input; returns at once.

        Raises:
            LogError: if an earlier write failed, the disk is a whole backlog behind, or the recorder is closed.
        """
        if self._failure is not None:
            raise self._error() from self._failure
        if self._closed:
            raise LogError(f"{self.where.part} is closed; a new segment needs a new recorder")
        if not events:
            return
        self._ended = self._ended or any(isinstance(event, SessionEnded) for event in events)
        try:
            self._queue.put_nowait(tuple(events))
        except queue.Full as full:
            self._failure = TimeoutError(f"the disk is {self._queue.maxsize} writes behind")
            raise self._error() from full

    @property
    def durable_steps(self) -> int:
        """How many steps of this segment are fsynced."""
        return self._live.durable_steps

    def drain(self) -> None:
        """Wait until all that was written is durable: for players that have no frame loop to keep.

        Raises:
            LogError: if writing failed.
        """
        self._queue.join()
        if self._failure is not None:
            raise self._error() from self._failure

    def close(self) -> Path | None:
        """Write what is queued, finish the log and return it. A second call only says where it is.

        Raises:
            LogError: if something could not be written; what could is kept, and the message says where.
        """
        if self._closed:
            return self.where.log if self.where.log.exists() else None
        self._closed = True
        self._queue.put(_CLOSE)
        self._thread.join()
        try:
            if self._failure is not None:
                raise self._error() from self._failure
            return finish(self.where, clean=self._ended).path
        except OSError as error:
            self._failure = error
            raise self._error() from error
        finally:
            os.close(self._fd)

    def _run(self) -> None:
        closing = broken = False
        while not closing:
            batches = [self._queue.get()]
            while not self._queue.empty():
                batches.append(self._queue.get())
            closing = batches[-1] is _CLOSE
            if not broken:
                try:
                    self._live.append([event for batch in batches for event in batch])
                except Exception as error:  # handed to the session at its next write
                    broken, self._failure = True, error
            for _ in batches:
                self._queue.task_done()

    def _error(self) -> LogError:
        reason = (isinstance(self._failure, OSError) and self._failure.strerror) or str(self._failure)
        return LogError(
            f"recording stopped: {reason}; {self.durable_steps} steps are safe in {self.where.part}; "
            f"put that right, then run: minihuman recover {self.where.part}"
        )
