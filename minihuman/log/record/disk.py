"""Bytes on their way to the disk: with the operating system when ``settle`` returns, on the disk soon after.

Two threads stand between a session and a file. One writes: what it has written survives the process, however that
ends. One fsyncs behind it: what it has done survives the power. Neither can hold a picture up for longer than a bound:
a write that the disk does not take by then goes on by itself, and until it is done nobody waits for the next ones.
Where nobody waits for a write at all, since only what is durable counts, one thread does both for all files (`Rounds`).
"""

import fcntl
import logging
import os
import queue
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.record.claim import is_at, sync_folder
from minihuman.log.record.live_file import Piece
from minihuman.log.record.rounds import Rounds
from minihuman.log.record.space import require_space

LOG = logging.getLogger("minihuman")
WRITE_BOUND_S = 0.1  # the longest that a write holds a picture up
BACKLOG = 65_536  # writes that may wait; at a hundred a second a disk may stall for ten minutes


@dataclass(slots=True)
class _Job:
    pieces: Sequence[Piece]
    steps: int  # of the segment, with these
    done: threading.Lock = field(default_factory=threading.Lock)  # held until it is written or given up
    over: bool = False  # it was written, or given up
    whole: bool = False  # it was written to its last byte


class Disk:
    """A live file that is appended to. Its owner has made and locked it, and hands its descriptor over.

    Args:
        sync: makes a file descriptor's writes durable.
        put: writes to a file descriptor, and says how many bytes it took.
        bound_s: how long ``settle`` waits.
        rounds: writes instead of threads of this one's own, and ``settle`` waits for nothing: whoever writes tells
            nobody before it is durable. What is synced by it is not by ``sync``.
        backlog: how many writes may wait before it gives up.
        crc: of what the file holds already.
        at_sync: called, by a thread of this, whenever more has become durable.
    """

    def __init__(
        self,
        fd: int,
        part: Path,
        *,
        sync: Callable[[int], None] = os.fsync,
        put: Callable[[int, memoryview], int] = os.write,
        bound_s: float = WRITE_BOUND_S,
        rounds: Rounds | None = None,
        backlog: int = BACKLOG,
        crc: int = 0,
        at_sync: Callable[[], None] = lambda: None,
    ) -> None:
        self.failure: Exception | None = None
        self.crc = crc  # of all that was written
        self.durable_steps = 0  # how many are fsynced
        self.durable_writes = 0  # likewise
        self.late = 0  # writes that a picture did not wait for to their end
        self.longest_wait_s = 0.0
        self.rescued = 0  # how often the file was gone and was written again
        self._fd = fd
        self._part = part
        self._sync = sync
        self._put = put
        self._bound_s = bound_s
        self._at_sync = at_sync
        self._backlog = backlog
        self._last: _Job | None = None  # begun and not waited for
        self._stuck: _Job | None = None  # the last that was waited for in vain
        self._given = 0  # jobs
        self._written = 0
        self._settled = 0  # jobs that are durable, or never will be
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._unsynced: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._file = threading.Lock()  # held while the file is written, or written again
        self._rest = threading.Condition()
        self._broken = False  # it cannot be fsynced
        self._rounds = rounds
        self._waiting: deque[_Job] = deque()  # for a round
        self._in_round: list[_Job] = []
        self._expected = False  # its round will come
        self._threads: list[threading.Thread] = []
        if rounds is None:
            # Daemons, so that a crash of the program is not held up; what was written stays and is recovered.
            self._threads = [
                threading.Thread(target=run, name=f"minihuman-log-{name}", daemon=True)
                for name, run in (("write", self._write_all), ("sync", self._sync_all))
            ]
        for thread in self._threads:
            thread.start()

    def begin(self, pieces: Sequence[Piece], *, steps: int) -> None:
        """Have pieces appended, behind all that were begun before; ``failure`` may say why they are not.

        ``steps`` is how many the file holds with these.
        """
        behind = self._given - self._written
        if behind >= self._backlog:
            self.failure = self.failure or TimeoutError(f"the disk is {behind} writes behind")
            return
        job = _Job(pieces, steps)
        self._given += 1
        if self._rounds is not None:
            self._waiting.append(job)
            if not self._expected:
                self._expected = True
                self._rounds.expect(self)
            return
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

    def drain(self) -> None:
        """Wait until all that was written is durable, or never will be."""
        if self._rounds is not None and self._settled < self._given:
            self._rounds.expect(self, at_once=True)
        with self._rest:
            self._rest.wait_for(lambda: self._settled >= self._given)

    def close(self) -> None:
        """Write and fsync what is left, and end both threads. The descriptor stays its owner's."""
        if self._rounds is not None:
            self.drain()
            return
        self._jobs.put(None)
        for thread in self._threads:
            thread.join()

    def _write_all(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._write(job)
            self._unsynced.put(job)
        self._unsynced.put(None)

    def _sync_all(self) -> None:
        closing = False
        while not closing:
            written, closing = _waiting(self._unsynced)
            self._make_durable(written, sync=self._sync, closing=closing)

    # As a file that rounds write

    @property
    def fd(self) -> int:
        """The descriptor."""
        return self._fd

    def write_waiting(self) -> bool:
        """Write all that waits; whether there was any."""
        self._expected = False  # what comes from here on has another round
        while self._waiting:
            self._in_round.append(self._waiting.popleft())
        self._write(*self._in_round)
        return bool(self._in_round)

    def written_is(self, failed: Exception | None) -> None:
        """What was written is durable, or never will be."""
        jobs, self._in_round = self._in_round, []

        def outcome(_fd: int) -> None:
            if failed is not None:
                raise failed

        self._make_durable(jobs, sync=outcome)

    def _write(self, *jobs: _Job) -> None:
        if self.failure is None or isinstance(self.failure, TimeoutError):
            try:
                for piece in _joined(piece for job in jobs for piece in job.pieces):
                    self._append(piece)
                for job in jobs:
                    job.whole = True
            except Exception as error:  # handed to the session at this write or the next
                self.failure = error
        self._written += len(jobs)
        for job in jobs:
            job.over = True
            if self._rounds is None:
                job.done.release()

    def _append(self, piece: Piece) -> None:
        if piece.room_for is not None:
            require_space(self._part.parent, piece.room_for)
        rest = memoryview(piece.data)
        with self._file:
            while rest:
                taken = self._put(self._fd, rest)
                rest = rest[taken:]
            self.crc = zlib.crc32(piece.data, self.crc)

    def _make_durable(self, written: Sequence[_Job], *, sync: Callable[[int], None], closing: bool = False) -> None:
        if not self._broken and (written or closing):
            try:
                sync(self._fd)
                self._stay_there()
                self.durable_steps = max([self.durable_steps, *(job.steps for job in written if job.whole)])
                if all(job.whole for job in written):
                    self.durable_writes += len(written)
            except Exception as error:
                self._broken, self.failure = True, self.failure or error
        if written:
            self._at_sync()
        with self._rest:
            self._settled += len(written)
            self._rest.notify_all()

    def _stay_there(self) -> None:
        """Where somebody took the file away or moved it, write it again from the open handle."""
        if is_at(self._fd, self._part):
            return
        try:
            with self._file:
                self._part.parent.mkdir(parents=True, exist_ok=True)
                again = os.open(self._part, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_APPEND | os.O_CLOEXEC, 0o644)
                try:
                    copied = self._copy_to(again)
                    os.dup2(again, self._fd, inheritable=False)
                finally:
                    os.close(again)
        except OSError as error:
            self.durable_steps = 0
            raise LogError(f"{self._part} was taken away and cannot be put back ({error.strerror})") from error
        self.rescued += 1
        LOG.warning("%s was taken away while it was being written; it is back, with all %d bytes", self._part, copied)

    def _copy_to(self, again: int) -> int:
        """Copy all that was written, and make it last."""
        fcntl.flock(again, fcntl.LOCK_EX)
        copied = 0
        while found := os.pread(self._fd, 1 << 20, copied):
            copied += os.write(again, found)
        self._sync(again)
        for folder in self._part.parents[:4]:
            sync_folder(folder)
        return copied


def _waiting(jobs: "queue.SimpleQueue[_Job | None]") -> tuple[list[_Job], bool]:
    """All jobs that wait, one at least, and whether there will be no more."""
    found = [jobs.get()]
    while not jobs.empty():
        found.append(jobs.get())
    return [job for job in found if job is not None], found[-1] is None


def _joined(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """The same bytes in as few writes as can be."""
    held: list[bytes] = []
    for piece in pieces:
        if piece.room_for is not None and held:
            yield Piece(b"".join(held))
            held = []
        if piece.room_for is not None:
            yield piece
        else:
            held.append(piece.data)
    if held:
        yield Piece(b"".join(held))
