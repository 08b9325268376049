"""The disk of a session whose pictures wait: a write is with the operating system before its picture is shown.

Two threads stand between a session and its file. One writes: what it has written survives the process, however that
ends. One fsyncs behind it: what it has done survives the power. Neither can hold a picture up for longer than a bound:
a write that the disk does not take by then goes on by itself, and until it is done nobody waits for the next ones.
"""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from minihuman.log.record.appended_file import AppendedFile
from minihuman.log.record.disk import BACKLOG, Disk, Job
from minihuman.log.record.live_file import Piece

WRITE_BOUND_S = 0.1  # the longest that a write holds a picture up


@dataclass(slots=True)
class _Waited(Job):
    done: threading.Lock = field(default_factory=threading.Lock)  # held until it is written or given up
    over: bool = False  # it was written, or given up


class WaitedDisk(Disk):
    """Two threads for one file.

    Args:
        bound_s: how long ``settle`` waits.
    """

    def __init__(
        self,
        file: AppendedFile,
        *,
        bound_s: float = WRITE_BOUND_S,
        backlog: int = BACKLOG,
        at_sync: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(file, backlog=backlog, at_sync=at_sync)
        self._bound_s = bound_s
        self._last: _Waited | None = None  # begun and not waited for
        self._stuck: _Waited | None = None  # the last that was waited for in vain
        self._jobs: queue.SimpleQueue[_Waited | None] = queue.SimpleQueue()
        self._unsynced: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        # Daemons, so that a crash of the program is not held up; what was written stays and is recovered.
        self._threads = [
            threading.Thread(target=run, name=f"minihuman-log-{name}", daemon=True)
            for name, run in (("write", self._write_all), ("sync", self._sync_all))
        ]
        for thread in self._threads:
            thread.start()

    def _take(self, pieces: Sequence[Piece], steps: int) -> None:
        job = _Waited(pieces, steps)
        job.done.acquire()
        self._last = job
        self._jobs.put(job)

    def settle(self) -> None:
        """Wait for what was begun: it is written then, has had ``bound_s`` to be, or ``failure`` says why not."""
        job, self._last = self._last, None
        if job is None:
            return
        if self._stuck is not None and not self._stuck.over:  # a picture has waited for the disk already
            self.late += 1
            return
        began_s = time.monotonic()
        self._stuck = None if job.done.acquire(timeout=self._bound_s) else job
        self.late += self._stuck is not None
        self.longest_wait_s = max(self.longest_wait_s, time.monotonic() - began_s)

    def close(self) -> None:
        """Write and fsync what is left, and end both threads."""
        self._jobs.put(None)
        for thread in self._threads:
            thread.join()

    def _write_all(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._write([job])
            job.over = True
            job.done.release()
            self._unsynced.put(job)
        self._unsynced.put(None)

    def _sync_all(self) -> None:
        closing = False
        while not closing:
            written, closing = _waiting(self._unsynced)
            self._make_durable(written, sync=self.file.sync, closing=closing)


def _waiting(jobs: "queue.SimpleQueue[Job | None]") -> tuple[list[Job], bool]:
    """All jobs that wait, one at least, and whether there will be no more."""
    found = [jobs.get()]
    while not jobs.empty():
        found.append(jobs.get())
    return [job for job in found if job is not None], found[-1] is None
