"""Bytes on their way to the disk: handed over in order, durable some time later, and nothing lost without a word.

Where a picture waits for its write, two threads stand between a session and its file (`WaitedDisk`). Where nobody waits
for a write, since only what is durable counts, one thread does the work for all files (`SharedDisk`).
"""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from minihuman.errors import LogError
from minihuman.log.record.appended_file import AppendedFile
from minihuman.log.record.live_file import Piece

BACKLOG = 65_536  # writes that may wait; at a hundred a second a disk may stall for ten minutes


@dataclass(slots=True)
class Job:
    """One write."""

    pieces: Sequence[Piece]
    steps: int  # of the segment, with these
    whole: bool = False  # it was written to its last byte


class Disk(ABC):
    """Has a file written by another thread.

    Args:
        backlog: how many writes may wait before it gives up.
        at_sync: called, by the thread that made it so, whenever more has become durable.
    """

    def __init__(self, file: AppendedFile, *, backlog: int = BACKLOG, at_sync: Callable[[], None] = lambda: None):
        self.file = file
        self.failure: Exception | None = None
        self.durable_steps = 0  # how many are fsynced
        self.durable_writes = 0  # likewise
        self.late = 0  # writes that a picture did not wait for to their end
        self.longest_wait_s = 0.0
        self._backlog = backlog
        self._at_sync = at_sync
        self._given = 0  # jobs
        self._written = 0
        self._settled = 0  # jobs that are durable, or never will be
        self._rest = threading.Condition()
        self._broken = False  # the file cannot be made durable

    def begin(self, pieces: Sequence[Piece], *, steps: int) -> None:
        """Have pieces appended, behind all that were begun before; ``failure`` may say why they are not.

        ``steps`` is how many the file holds with these.
        """
        behind = self._given - self._written
        if behind >= self._backlog:
            self.failure = self.failure or TimeoutError(f"the disk is {behind} writes behind")
            return
        self._given += 1
        self._take(pieces, steps)

    @abstractmethod
    def _take(self, pieces: Sequence[Piece], steps: int) -> None:
        """Have another thread `_write` them and `_make_durable`."""

    @abstractmethod
    def settle(self) -> None:
        """Return when whoever shows what came of the pieces may: ``failure`` says why not."""

    def drain(self) -> None:
        """Wait until all that was begun is durable, or never will be."""
        with self._rest:
            self._rest.wait_for(lambda: self._settled >= self._given)

    @abstractmethod
    def close(self) -> None:
        """Make durable what is left, and be done with the file, which stays open."""

    def _write(self, jobs: Sequence[Job]) -> None:
        if self.failure is None or isinstance(self.failure, TimeoutError):
            try:
                self.file.append(piece for job in jobs for piece in job.pieces)
                for job in jobs:
                    job.whole = True
            except Exception as error:  # handed to the session at this write or the next
                self.failure = error
        self._written += len(jobs)

    def _make_durable(self, written: Sequence[Job], *, sync: Callable[[], None], closing: bool = False) -> None:
        if not self._broken and (written or closing):
            try:
                sync()
                self.file.stay()
                self.durable_steps = max([self.durable_steps, *(job.steps for job in written if job.whole)])
                if all(job.whole for job in written):
                    self.durable_writes += len(written)
            except Exception as error:
                self._broken, self.failure = True, self.failure or error
                if isinstance(error, LogError):  # the file is gone
                    self.durable_steps = 0
        if written:
            self._at_sync()
        with self._rest:
            self._settled += len(written)
            self._rest.notify_all()
