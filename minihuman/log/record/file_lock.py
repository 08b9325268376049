"""Exclusive ownership of a live log, which is locked while its writer lives and never taken from a live process.

The lock is the kernel's: it ends with the process, however the process ends, and needs no clean-up.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.paths import SegmentPath
from minihuman.storage.durable_files import sync_folder
from minihuman.storage.locks import is_file_at, lock_file
from minihuman.storage.system import current_system


def create_live_file(segment_path: SegmentPath) -> int:
    """Create a segment's live file, locked, and return its file descriptor.

    Raises:
        LogError: if the live file or a finished log with this segment exists, or the folder cannot be written.
    """
    disk = current_system().disk
    while True:
        try:
            disk.make_folder(segment_path.part.parent)
            fd = disk.open(segment_path.part, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_APPEND)
        except FileExistsError:
            raise _running_error(segment_path) from None
        except OSError as error:
            raise LogError(
                f"{segment_path.part} cannot be created: {error.strerror}; choose another folder with --data"
            ) from error
        try:
            lock_file(fd, segment_path.part)
        except LogError:
            with contextlib.suppress(FileNotFoundError):
                disk.unlink(segment_path.part)
            os.close(fd)
            raise
        if is_file_at(fd, segment_path.part):
            break
        os.close(fd)  # a recovery moved the empty file between open and lock
    refusal = _find_recorded_error(segment_path)
    if refusal is not None:
        disk.unlink(segment_path.part)
        os.close(fd)
        raise refusal
    for folder in segment_path.part.parents[:4]:  # session, participant, study and data folder, any of which may be new
        sync_folder(folder)
    return fd


def require_unclaimed(segment_path: SegmentPath) -> None:
    """Refuse a segment that is recorded already or is being recorded, without creating a file.

    Raises:
        LogError: if the segment is recorded already or is being recorded.
    """
    refusal = _running_error(segment_path) if segment_path.part.exists() else _find_recorded_error(segment_path)
    if refusal is not None:
        raise refusal


def _running_error(segment_path: SegmentPath) -> LogError:
    return LogError(
        f"{segment_path.part} already exists: the session is running elsewhere or was cut off; "
        f"end it, or run: minihuman recover {segment_path.part}"
    )


def _find_recorded_error(segment_path: SegmentPath) -> LogError | None:
    """Return the error for a segment that a finished log contains already; None if none does."""
    from minihuman.log.read.reader import read_segment_starts

    if not segment_path.log.exists() or segment_path.segment not in (1, *read_segment_starts(segment_path.log)):
        return None
    return LogError(
        f"{segment_path.log} already exists and has segment {segment_path.segment}; choose another number with "
        "--session, or move the log"
    )


def open_leftover(part: Path, flags: int = os.O_RDONLY) -> int:
    """Open a leftover live file with the flags of ``os.open``, lock it, and return its file descriptor.

    Raises:
        LogError: if a live process is still writing it, it does not exist, or it cannot be opened.
    """
    try:
        fd = current_system().disk.open(part, flags)
    except FileNotFoundError:
        raise LogError(f"{part} does not exist; it may have been recovered already") from None
    except OSError as error:
        raise LogError(f"{part} cannot be opened: {error.strerror}") from error
    try:
        try:
            lock_file(fd, part, wait=False)
        except BlockingIOError:
            raise LogError(f"{part} is still being written by a running session; end that session first") from None
        if not is_file_at(fd, part):
            raise LogError(f"{part} has just been recovered by another process; read the session's log instead")
    except BaseException:
        os.close(fd)
        raise
    return fd


@contextlib.contextmanager
def hold_leftover(part: Path) -> Iterator[None]:
    """Hold the lock of a leftover live file while the context lasts.

    Raises:
        LogError: as ``open_leftover`` does.
    """
    fd = open_leftover(part)
    try:
        yield
    finally:
        os.close(fd)


def is_being_recorded(part: Path) -> bool:
    """Return whether a running process holds the lock of a live file."""
    try:
        with hold_leftover(part):
            return False
    except LogError:
        return part.exists()
