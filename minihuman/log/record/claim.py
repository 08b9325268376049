"""Sole ownership of a live log: made exclusively, locked while its writer lives, never taken from a living one.

The lock is the kernel's (``flock``): it ends with the process, however that ends, and needs no clean-up.
"""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from minihuman.errors import LogError, naming
from minihuman.log.paths import SegmentPath


def create(where: SegmentPath) -> int:
    """Make a segment's live file, locked, and return its file descriptor.

    Raises:
        LogError: if the live file or a finished log with this segment exists, or the folder cannot be written.
    """
    while True:
        try:
            where.part.parent.mkdir(parents=True, exist_ok=True)
            fd = os.open(where.part, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise _runs_elsewhere(where) from None
        except OSError as error:
            raise LogError(f"{where.part} cannot be made: {error.strerror}; choose another --data") from error
        try:
            lock(fd, where.part)
        except LogError:
            where.part.unlink(missing_ok=True)
            os.close(fd)
            raise
        if is_at(fd, where.part):
            break
        os.close(fd)  # a recovery took the empty file away between open and lock
    if (refusal := _is_there(where)) is not None:
        where.part.unlink()
        os.close(fd)
        raise refusal
    for folder in where.part.parents[:4]:  # session, participant, study and data folder: any of them may be new
        sync_folder(folder)
    return fd


def refuse_taken(where: SegmentPath) -> None:
    """Make sure that nobody has recorded a segment or does so now, without beginning to.

    Raises:
        LogError: if somebody has.
    """
    refusal = _runs_elsewhere(where) if where.part.exists() else _is_there(where)
    if refusal is not None:
        raise refusal


def _runs_elsewhere(where: SegmentPath) -> LogError:
    return LogError(
        f"{where.part} already exists: that session runs elsewhere or was cut off; "
        f"end it, or run: minihuman recover {where.part}"
    )


def _is_there(where: SegmentPath) -> LogError | None:
    from minihuman.log.read.file import segment_starts  # all that reads messages: whoever only locks does without

    if not where.log.exists() or where.segment not in (1, *segment_starts(where.log)):
        return None
    return LogError(
        f"{where.log} already exists and holds segment {where.segment}; choose another --session or move it"
    )


@contextlib.contextmanager
def taken(part: Path) -> Iterator[None]:
    """Hold a leftover live file's lock.

    Raises:
        LogError: if a living process still writes it, or it is gone.
    """
    try:
        fd = os.open(part, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        raise LogError(f"{part} does not exist; it may have been recovered already") from None
    try:
        try:
            lock(fd, part, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LogError(f"{part} is still being written by a running session; let it end first") from None
        if not is_at(fd, part):
            raise LogError(f"{part} has just been recovered by another process")
        yield
    finally:
        os.close(fd)


def is_live(part: Path) -> bool:
    """Say whether a running process holds a live file."""
    try:
        with taken(part):
            return False
    except LogError:
        return part.exists()


def lock(fd: int, path: Path, how: int = fcntl.LOCK_EX) -> None:
    """Lock an open file.

    Raises:
        BlockingIOError: if somebody has it, and ``how`` says not to wait.
        LogError: if its file system keeps no locks.
    """
    try:
        fcntl.flock(fd, how)
    except BlockingIOError:
        raise
    except OSError as error:
        raise LogError(
            f"{path} cannot be locked ({error.strerror}), so two stations could write it at once; "
            "choose a data folder on a file system that keeps locks, such as a local disk"
        ) from error


def sync_folder(folder: Path) -> None:
    """Make a folder's entries durable: a new or renamed file is safe only when its folder is.

    Raises:
        OSError: if it cannot be done; it names the folder.
    """
    with naming(folder):
        fd = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def is_at(fd: int, path: Path) -> bool:
    """Say whether an open file is the one at a path."""
    try:
        there = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return os.path.samestat(os.fstat(fd), there)
