"""The machine as a program sees it while recording a study: the disk that it writes, clocks, a database.

``use_system`` replaces them for a block of code and everything that it awaits, so that a test can make each of them
fail. Files are read directly: a ``FileSystem`` has only the operations that change files or make a change durable.
"""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from minihuman import operating_system


class FileSystem:
    """Changes files on the machine's disk; every method raises ``OSError`` if it fails.

    A subclass may be another disk, such as one that fails or one that loses power.
    """

    def open(self, path: Path, flags: int, mode: int = 0o600) -> int:
        """Open a file or a folder as ``os.open`` does, and return its descriptor, to be closed with ``os.close``."""
        return operating_system.open_file(path, flags, mode)

    def write(self, fd: int, data: bytes | memoryview) -> int:
        """Write bytes at a file's position, or at its end if it was opened for appending; return how many were written.

        They may be fewer than those given.
        """
        return os.write(fd, data)

    def sync(self, fd: int) -> None:
        """Make a file's bytes durable."""
        operating_system.sync_file(fd)

    def truncate(self, fd: int, size_bytes: int) -> None:
        """Truncate a file to a size."""
        os.ftruncate(fd, size_bytes)

    def rename(self, source: Path, target: Path) -> None:
        """Rename a file atomically; an existing file of the new name is replaced."""
        operating_system.replace_file(source, target)

    def unlink(self, path: Path) -> None:
        """Remove a file."""
        operating_system.remove_file(path)

    def link(self, source: Path, target: Path) -> None:
        """Give a file a second name; raise FileExistsError if a file of that name exists."""
        os.link(source, target)

    def make_folder(self, folder: Path, mode: int = operating_system.OWNER_ONLY_FOLDER) -> None:
        """Create a folder and its missing parents with the permissions ``mode``; an existing one is not changed."""
        operating_system.make_private_folder(folder, mode)

    def remove_folder(self, folder: Path) -> None:
        """Remove an empty folder."""
        folder.rmdir()

    def sync_folder(self, folder: Path) -> None:
        """Make a folder's entries durable if the system can; a new or renamed file is safe only then."""
        operating_system.sync_folder(folder)


class SystemClock:
    """The machine's wall clock and monotonic clock; a subclass may let the wall clock jump."""

    def wall_ns(self) -> int:
        """Return the wall clock's time in nanoseconds since 1970; it may jump when the clock is adjusted."""
        return time.time_ns()

    def monotonic_ns(self) -> int:
        """Return the time in nanoseconds of a clock that never goes back; its zero is arbitrary."""
        return time.perf_counter_ns()


@dataclass(frozen=True, slots=True)
class System:
    """The parts of the machine that a program uses.

    Args:
        disk: the disk to which it writes.
        clock: its clocks.
        open_database_journal: opens a journal in the database at a URL; None to use PostgreSQL.
    """

    disk: FileSystem = field(default_factory=FileSystem)
    clock: SystemClock = field(default_factory=SystemClock)
    open_database_journal: Callable[..., Any] | None = None


_SYSTEM: ContextVar[System] = ContextVar("system", default=System())  # noqa: B039  (frozen)


def current_system() -> System:
    """Return the machine's disk, clocks and database, or their replacement by ``use_system``."""
    return _SYSTEM.get()


@contextmanager
def use_system(system: System) -> Iterator[None]:
    """Make ``current_system`` return a replacement while the context lasts."""
    token = _SYSTEM.set(system)
    try:
        yield
    finally:
        _SYSTEM.reset(token)


def wall_time() -> datetime:
    """Return the wall clock's time in UTC."""
    return datetime.fromtimestamp(current_system().clock.wall_ns() / 1e9, UTC)


def monotonic_s() -> float:
    """Return the monotonic clock's time in seconds."""
    return current_system().clock.monotonic_ns() / 1e9


def now_text() -> str:
    """Return the present time as text for a log line: ISO 8601, UTC, whole seconds."""
    return wall_time().isoformat(timespec="seconds").replace("+00:00", "Z")
