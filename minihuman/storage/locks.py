"""Kernel locks of open files. They end with the process, however it ends, and need no clean-up."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from minihuman.errors import LogError
from minihuman.operating_system import lock_descriptor
from minihuman.storage.system import current_system


@contextmanager
def hold_lock(path: Path, mode: int = 0o600) -> Iterator[None]:
    """Wait for a file's lock, and hold it against every other process and thread; the file and its folder are created.

    Raises:
        OSError: if the file cannot be created.
        LogError: if its file system has no locks.
    """
    disk = current_system().disk
    disk.make_folder(path.parent)
    fd = disk.open(path, os.O_CREAT | os.O_RDWR, mode)
    try:
        lock_file(fd, path)
        yield
    finally:
        os.close(fd)


def lock_file(fd: int, path: Path, *, wait: bool = True) -> None:
    """Lock an open file until its descriptor is closed.

    Args:
        fd: the file's descriptor.
        path: the file's path, for errors.
        wait: whether to wait while another process holds the lock.

    Raises:
        BlockingIOError: if another process holds the lock, and ``wait`` is false.
        LogError: if its file system has no locks.
    """
    try:
        lock_descriptor(fd, wait=wait)
    except BlockingIOError:
        raise
    except OSError as error:
        raise LogError(
            f"{path} cannot be locked ({error.strerror}), so two machines could write to it at the same time; "
            "choose a data folder on a file system that supports locks, such as a local disk"
        ) from error


def is_file_at(fd: int, path: Path) -> bool:
    """Return whether an open file is the one at a path."""
    try:
        file_status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return os.path.samestat(os.fstat(fd), file_status)
