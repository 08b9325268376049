"""Many files written and made durable by one thread, where nobody waits for a write: only what is durable counts.

What comes for a file within a moment is one write and one fsync: a press, its picture and its release. Files whose
moment is over about then have a round together. A thread a file would do the same, but each hands the interpreter over
and takes it back several times a write, which costs whoever has it more than the writes do. A slow disk takes a few
hundred fsyncs a second, and a hundred people who press two keys a second need as many: a round of many files is one
call that makes the whole file system durable.
"""

import ctypes
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

LOG = logging.getLogger("minihuman")
GATHER_S = 0.1  # so long a write waits for others of its file
TOGETHER_S = 0.02  # so much earlier it is done where another file's round is due
_ONE_BY_ONE = 12  # files that are fsynced by themselves; a disk that keeps up has seldom more in a round


class Waiting(Protocol):
    """A file with something to be written."""

    @property
    def fd(self) -> int:
        """Its descriptor."""

    def write_waiting(self) -> bool:
        """Write all that waits; whether there was any. What goes wrong is kept for whoever writes next."""

    def written_is(self, failed: Exception | None) -> None:
        """What was written is durable, or never will be."""


def syncfs(fd: int) -> None:
    """Make everything on the file system of an open file durable.

    Raises:
        OSError: if something could not be written; also where the system has no such call.
    """
    call = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
    if call is None:
        raise OSError("this system has no syncfs")
    if call(fd):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


class Rounds:
    """The one thread of a process's files. It begins with the first write, and ends with the process.

    Args:
        sync_one: makes one file durable.
        sync_all: makes all files on a file's file system durable, or fails.
    """

    def __init__(self, *, sync_one: Callable[[int], None] = os.fsync, sync_all: Callable[[int], None] = syncfs) -> None:
        self.rounds = 0  # done so far
        self._sync_one = sync_one
        self._sync_all = sync_all
        self._due: deque[tuple[float, Waiting]] = deque()  # the earliest first
        self._hurried: deque[Waiting] = deque()
        self._wake = threading.Event()
        self._idle = False  # nothing is due, so that it has to be woken
        self._beginning = threading.Lock()
        self._thread: threading.Thread | None = None

    def expect(self, file: Waiting, *, at_once: bool = False) -> None:
        """Have a file's turn come, in a moment or at once."""
        if at_once:
            self._hurried.append(file)
        else:
            self._due.append((time.monotonic() + GATHER_S, file))
        if at_once or self._idle:
            self._wake.set()
        if self._thread is None:
            self._begin()

    def _begin(self) -> None:
        with self._beginning:
            if self._thread is None:
                # A daemon, so that a crash of the program is not held up; what was written stays and is recovered.
                self._thread = threading.Thread(target=self._run, name="minihuman-log-rounds", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        while True:
            self._wait()
            self._round(self._next())

    def _wait(self) -> None:
        """Return when a file's turn has come."""
        while True:
            self._wake.clear()
            left_s = self._due[0][0] - time.monotonic() if self._due else None
            if self._hurried or (left_s is not None and left_s <= 0):
                return
            self._idle = left_s is None
            if not self._idle or not self._due:
                self._wake.wait(left_s)
            self._idle = False

    def _next(self) -> list[Waiting]:
        """Those whose turn it is, each once."""
        found: dict[Waiting, None] = {}
        while self._hurried:
            found[self._hurried.popleft()] = None
        until_s = time.monotonic() + TOGETHER_S
        while self._due and self._due[0][0] <= until_s:
            found[self._due.popleft()[1]] = None
        return list(found)

    def _round(self, files: Sequence[Waiting]) -> None:
        written = []
        for file in files:
            with _no_other_s_trouble():
                if file.write_waiting():
                    written.append(file)
        failed = self._failed([file.fd for file in written])
        self.rounds += 1
        for file in written:
            with _no_other_s_trouble():
                file.written_is(failed.get(file.fd))

    def _failed(self, fds: Sequence[int]) -> dict[int, OSError]:
        """Make files durable; which of them could not be, and why."""
        if len(fds) > _ONE_BY_ONE:
            try:
                for fd in {os.fstat(fd).st_dev: fd for fd in fds}.values():
                    self._sync_all(fd)
                return {}
            except OSError:  # somebody's file, perhaps none of these: each is asked by itself
                pass
        failed = {}
        for fd in fds:
            try:
                self._sync_one(fd)
            except OSError as error:
                failed[fd] = error
        return failed


@contextmanager
def _no_other_s_trouble() -> Iterator[None]:
    try:
        yield
    except Exception:  # a bug of ours, in one file's part
        LOG.exception("a round failed for a file")
