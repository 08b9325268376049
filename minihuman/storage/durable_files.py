"""Writes files durably and whole. All of minihuman's files are written in this way, on the disk of ``system``.

A file is durable when its bytes are (``write_durably``) and its name in its folder is (``sync_folder``). A file that
may have readers is never changed in place but replaced (``replace_durably``).
"""

import hashlib
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedWriter, RawIOBase
from pathlib import Path
from typing import Any, cast

from minihuman.errors import name_file_in_errors
from minihuman.operating_system import read_at
from minihuman.storage.system import FileSystem, current_system

UNFINISHED_SUFFIX = ".part"
_PIECE_BYTES = 1 << 20
_HIDDEN_SUFFIX = ".unfinished"
_ABANDONED_S = 3600.0  # the age at which nobody still writes a temporary file


def sync_folder(folder: Path) -> None:
    """Make a folder's entries durable.

    Raises:
        OSError: if that fails; the error names the folder.
    """
    with name_file_in_errors(folder):
        current_system().disk.sync_folder(folder)


class _RawFile(RawIOBase):
    """An open file on a disk, with the interface that Python's buffers require."""

    def __init__(self, fd: int, disk: FileSystem) -> None:
        self._fd = fd
        self._disk = disk

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._fd

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return os.lseek(self._fd, offset, whence)

    def write(self, data: Any) -> int:
        return self._disk.write(self._fd, memoryview(data))

    def close(self) -> None:
        if not self.closed:
            super().close()
            os.close(self._fd)


@contextmanager
def write_durably(path: Path, mode: int = 0o600, *, new: bool = False) -> Iterator[BufferedWriter]:
    """Create or overwrite a file, and make its content durable at the end of the context.

    The name of a new file is durable only after ``sync_folder``.

    Args:
        path: the file's path.
        mode: the permissions of a file that is created.
        new: whether to refuse to overwrite an existing file.

    Yields:
        The file, open for writing bytes.

    Raises:
        FileExistsError: if the file must be new but exists.
        OSError: if the file cannot be written; the error names it.
    """
    disk = current_system().disk
    flags = os.O_CREAT | os.O_WRONLY
    flags |= os.O_EXCL if new else os.O_TRUNC
    with name_file_in_errors(path):
        raw = _RawFile(disk.open(path, flags, mode), disk)
        with BufferedWriter(cast(Any, raw)) as file:
            yield file
            file.flush()
            disk.sync(raw.fileno())


def write_again(path: Path, *, begin: int = 0) -> None:
    """Rewrite a file's bytes from position ``begin`` onwards, unchanged, and make them durable.

    After a failed fsync the system may show bytes that the disk lacks, and later fsyncs skip them: only bytes that are
    written again reach the disk. The caller must hold the file's lock.

    Raises:
        OSError: if that fails; the error names the file.
    """
    disk = current_system().disk
    with name_file_in_errors(path):
        fd = disk.open(path, os.O_RDWR)
        try:
            position = os.lseek(fd, begin, os.SEEK_SET)
            while piece := read_at(fd, _PIECE_BYTES, position):
                position += disk.write(fd, piece)
            disk.sync(fd)
        finally:
            os.close(fd)


@contextmanager
def replace_durably(
    path: Path, unfinished: Path | None = None, *, mode: int = 0o600, new_folders: int = 0
) -> Iterator[BufferedWriter]:
    """Write a file under a temporary name and rename it once it is durable, so that no crash leaves half of it.

    Args:
        path: the file's path; its folder is created.
        unfinished: the temporary path; None for a hidden file in the same folder, with this process's id in its name.
        mode: the permissions of the file.
        new_folders: the number of folders above the file that an earlier call may have created without making them
            durable; they are made durable, too.

    A process that is killed leaves its hidden file; a later call for the same path removes it once it is an hour old.

    Yields:
        The file under its temporary name, open for writing bytes.

    Raises:
        OSError: if the file cannot be written; the error names ``path``, and nothing of the new content is left. If a
            folder cannot be made durable, the error names the folder, and ``path`` already has the new content.
    """
    disk = current_system().disk
    if unfinished is None:
        unfinished = path.with_name(f".{path.name}.{os.getpid()}{_HIDDEN_SUFFIX}")
        _remove_abandoned_files(path)
    missing_folders = sum(not folder.exists() for folder in path.parents)
    try:
        disk.make_folder(path.parent)
        with write_durably(unfinished, mode) as file:
            yield file
        disk.rename(unfinished, path)
    except BaseException as error:
        with suppress(OSError):
            disk.unlink(unfinished)
        if isinstance(error, OSError) and error.filename in (None, str(unfinished)):
            error.filename = str(path)
        raise
    for folder in path.parents[: max(missing_folders, new_folders) + 1]:  # a folder's name is in the one above it
        sync_folder(folder)


def _remove_abandoned_files(path: Path) -> None:
    """Remove the hidden files of killed processes that were replacing a file; those that cannot be removed stay."""
    name = re.compile(rf"\.{re.escape(path.name)}\.\d+{re.escape(_HIDDEN_SUFFIX)}")
    with suppress(OSError):  # no folder yet, or one that may be written but not listed
        for file in path.parent.iterdir():
            if name.fullmatch(file.name) and time.time() - file.stat().st_mtime > _ABANDONED_S:
                current_system().disk.unlink(file)


def write_atomically(text: str, path: Path) -> None:
    """Write a text file in UTF-8 durably, so that readers see either the whole old file or the whole new one.

    Raises:
        OSError: if the file cannot be written, as in ``replace_durably``.
    """
    with replace_durably(path, path.with_name(path.name + UNFINISHED_SUFFIX)) as file:
        file.write(text.encode())


def append_durably(path: Path, content: bytes) -> None:
    """Append bytes to a file and make them durable; create the file if it does not exist.

    The name of a new file is durable only after ``sync_folder``.

    Raises:
        OSError: if the bytes cannot be written; the error names the file.
    """
    disk = current_system().disk
    with name_file_in_errors(path):
        fd = disk.open(path, os.O_CREAT | os.O_APPEND | os.O_WRONLY)
        try:
            while content:
                content = content[disk.write(fd, content) :]
            disk.sync(fd)
        finally:
            os.close(fd)


def copy_durably(
    source: Path, target: Path, unfinished: Path | None = None, *, mode: int = 0o600, new_folders: int = 0
) -> None:
    """Copy a file so that the target has either its old content or all of the new one.

    Args:
        source: the file to copy.
        target: the path of the copy.
        unfinished: the temporary path, as in ``replace_durably``.
        mode: the permissions of the copy.
        new_folders: the number of folders above the target to make durable, as in ``replace_durably``.

    Raises:
        OSError: if the file cannot be copied.
    """
    with source.open("rb") as file, replace_durably(target, unfinished, mode=mode, new_folders=new_folders) as copy:
        shutil.copyfileobj(file, copy)


def hash_file(path: Path, algorithm: str = "sha256") -> str:
    """Return a file's digest in hexadecimal, computed with an algorithm that ``hashlib`` knows by this name.

    Raises:
        OSError: if the file cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, algorithm).hexdigest()
