"""Many files made durable together, where the disk is too slow to do it one by one.

A slow disk takes a few hundred fsyncs a second, whoever asks, and a hundred people who press two keys a second need as
many. A few files at once are fsynced each by itself, which most file systems join by themselves; whoever comes while
those are still at it waits for one call that makes the whole file system durable.
"""

import ctypes
import os
import threading
from collections.abc import Callable

_AT_ONCE = 8  # files that are fsynced by themselves; a disk that keeps up has seldom more than one or two


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


class GroupSync:
    """Stands in for ``os.fsync`` in the recorders of one process.

    Args:
        sync_one: makes one file durable.
        sync_all: makes all files on a file's file system durable, or fails.
    """

    def __init__(self, *, sync_one: Callable[[int], None] = os.fsync, sync_all: Callable[[int], None] = syncfs) -> None:
        self.rounds = 0  # done so far
        self._sync_one = sync_one
        self._sync_all = sync_all
        self._turn = threading.Condition()
        self._waiting: set[int] = set()  # file descriptors, for the next round
        self._failed: dict[tuple[int, int], OSError] = {}  # by round and file descriptor
        self._alone = 0
        self._next = 1
        self._running = False

    def __call__(self, fd: int) -> None:
        """Return when what was written to a file before is durable.

        Raises:
            OSError: if it could not be made so.
        """
        with self._turn:
            alone = self._alone < _AT_ONCE
            self._alone += alone
        if not alone:
            self._with_others(fd)
            return
        try:
            self._sync_one(fd)
        finally:
            with self._turn:
                self._alone -= 1

    def _with_others(self, fd: int) -> None:
        with self._turn:
            mine = self._next
            self._waiting.add(fd)
            self._turn.wait_for(lambda: self.rounds >= mine or not self._running)
            if self.rounds < mine:
                self._running = True
                self._next += 1
                fds, self._waiting = self._waiting, set()
        if self.rounds < mine:  # nobody else can be running: this thread does the round
            failed = self._sync(fds)
            with self._turn:
                self._failed |= {(mine, fd): error for fd, error in failed.items()}
                self.rounds, self._running = mine, False
                self._turn.notify_all()
        with self._turn:
            error = self._failed.pop((mine, fd), None)
        if error is not None:
            raise error

    def _sync(self, fds: set[int]) -> dict[int, OSError]:
        """Make files durable; which of them could not be, and why."""
        try:
            for fd in {os.fstat(fd).st_dev: fd for fd in fds}.values():
                self._sync_all(fd)
            return {}
        except OSError:  # somebody's file, perhaps none of these: each is asked by itself
            failed = {}
        for fd in fds:
            try:
                self._sync_one(fd)
            except OSError as error:
                failed[fd] = error
        return failed
