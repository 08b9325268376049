"""What a program asks of its machine to record a study: the disk that it writes, clocks, a database.

``use_system`` puts others in place for a block of code and all that it awaits, so that a test can let each of them
fail. Files are read directly: a ``FileSystem`` has only what changes them or makes a change last.
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
    """Changes files on the machine's disk; each method raises ``OSError`` where it cannot.

    A subclass may be another disk: one that fails, or one that loses power.
    """

    def open(self, path: Path, flags: int, mode: int = 0o600) -> int:
        """Open a file or a folder, as ``os.open`` does, and return its descriptor, which ``os.close`` closes."""
        return operating_system.open_file(path, flags, mode)

    def write(self, fd: int, data: bytes | memoryview) -> int:
        """Write bytes at the file's position, or append them; return how many were taken, which may be fewer."""
        return os.write(fd, data)

    def sync(self, fd: int) -> None:
        """Make a file's bytes durable."""
        operating_system.sync_file(fd)

    def truncate(self, fd: int, size_bytes: int) -> None:
        """Cut a file's end off."""
        os.ftruncate(fd, size_bytes)

    def rename(self, source: Path, target: Path) -> None:
        """Give a file another name in its folder, whole or not at all; a file of that name is replaced."""
        operating_system.replace_file(source, target)

    def unlink(self, path: Path) -> None:
        """Remove a file."""
        operating_system.remove_file(path)

    def link(self, source: Path, target: Path) -> None:
        """Give a file a second name; FileExistsError where there is a file of that name."""
        os.link(source, target)

    def make_folder(self, folder: Path, mode: int = operating_system.OWNER_ONLY_FOLDER) -> None:
        """Make a folder, and those above that are not there, for their owner alone; one that is there stays."""
        operating_system.make_private_folder(folder, mode)

    def remove_folder(self, folder: Path) -> None:
        """Remove an empty folder."""
        folder.rmdir()

    def sync_folder(self, folder: Path) -> None:
        """Make a folder's entries durable, where the system can: a new or renamed file is safe only when they are."""
        operating_system.sync_folder(folder)


class SystemClock:
    """Both of a machine's clocks; a subclass may let the wall clock jump."""

    def wall_ns(self) -> int:
        """Read the wall clock, ns since 1970; it is set now and then."""
        return time.time_ns()

    def monotonic_ns(self) -> int:
        """Read a clock that never goes back, from an arbitrary zero."""
        return time.perf_counter_ns()


@dataclass(frozen=True, slots=True)
class System:
    """The machine as a program has it.

    Args:
        disk: what it writes to.
        clock: its clocks.
        open_database_journal: opens a journal of the database at a URL; None: in PostgreSQL.
    """

    disk: FileSystem = field(default_factory=FileSystem)
    clock: SystemClock = field(default_factory=SystemClock)
    open_database_journal: Callable[..., Any] | None = None


_SYSTEM: ContextVar[System] = ContextVar("system", default=System())  # noqa: B039  (frozen)


def current_system() -> System:
    """Return the machine's system, or what ``use_system`` put in its place."""
    return _SYSTEM.get()


@contextmanager
def use_system(system: System) -> Iterator[None]:
    """Put another system in place for a while."""
    before = _SYSTEM.set(system)
    try:
        yield
    finally:
        _SYSTEM.reset(before)


def wall_time() -> datetime:
    """Return the wall clock's time, UTC."""
    return datetime.fromtimestamp(current_system().clock.wall_ns() / 1e9, UTC)


def monotonic_s() -> float:
    """Read the monotonic clock, in seconds."""
    return current_system().clock.monotonic_ns() / 1e9


def now_text() -> str:
    """Return the time for an entry: ISO 8601, UTC, whole seconds."""
    return wall_time().isoformat(timespec="seconds").replace("+00:00", "Z")
