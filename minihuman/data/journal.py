"""Journals: lines that many processes append to, one after the other, and that last. The port, and one in a file.

What is read once is not read again: who asks a second time gets what was added since.
"""

import abc
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from minihuman.errors import naming
from minihuman.log.record.claim import is_at, lock, sync_folder

Line = TypeVar("Line")
Decode = Callable[[bytes, int], Line | None]  # a line's bytes and its number; None for one that is passed over


class Held(abc.ABC, Generic[Line]):
    """A journal while nobody else can write to it."""

    def __init__(self, lines: tuple[Line, ...]) -> None:
        self.lines = lines

    @abc.abstractmethod
    def append(self, *lines: Line) -> None:
        """Add lines; they last when the journal is let go of, at the latest.

        Raises:
            OSError: if they cannot be written.
        """


class Journal(abc.ABC, Generic[Line]):
    """Lines in the order in which they were added."""

    @property
    @abc.abstractmethod
    def begun(self) -> bool:
        """Whether there ever was a line."""

    @abc.abstractmethod
    def read(self) -> tuple[Line, ...]:
        """All lines.

        Raises:
            OSError: if they cannot be read.
        """

    @abc.abstractmethod
    def hold(self) -> AbstractContextManager[Held[Line]]:
        """Keep every other process out for a while.

        Raises:
            OSError: if that cannot be.
        """

    @abc.abstractmethod
    def keep(self, wanted: Callable[[bytes], bool]) -> None:
        """Take out for ever what is not wanted.

        Raises:
            OSError: if that cannot be.
        """


class FileJournal(Journal[Line]):
    """Lines of JSON in a file under an exclusive lock, each fsynced.

    Args:
        path: the file; it and its folder are made when first written to.
        decode: reads a line.
        mode: who may read it.
    """

    def __init__(self, path: Path, decode: Decode[Line], *, mode: int = 0o644) -> None:
        self._path, self._decode, self._mode = path, decode, mode
        self._guard = threading.Lock()
        self._forget()

    @property
    def begun(self) -> bool:
        """Whether the file is there."""
        return self._path.exists()

    def read(self) -> tuple[Line, ...]:
        """All lines; of one that is being written, nothing."""
        try:
            with naming(self._path), self._path.open("rb") as file:
                return self._read_on(file.fileno())
        except FileNotFoundError:
            return ()

    @contextmanager
    def hold(self) -> Iterator[Held[Line]]:
        """Keep others out by a lock, which ends with the process."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            with naming(self._path):
                fd = os.open(self._path, os.O_CREAT | os.O_RDWR | os.O_APPEND | os.O_CLOEXEC, self._mode)
                try:
                    lock(fd, self._path)
                    if is_at(fd, self._path):  # else somebody was taken out of it meanwhile, which writes it anew
                        yield _HeldFile(fd, self._read_on(fd))
                        return
                finally:
                    os.close(fd)

    def keep(self, wanted: Callable[[bytes], bool]) -> None:
        """Put a file without the others in this one's place, whole and durable."""
        if not self.begun:
            return
        with self.hold():
            kept = [line for line in self._path.read_bytes().splitlines() if wanted(line)]
            beside = self._path.with_name(f"{self._path.name}.new")
            fd = os.open(beside, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_CLOEXEC, self._mode)
            with os.fdopen(fd, "wb") as file:
                file.write(b"".join(line + b"\n" for line in kept))
                file.flush()
                os.fsync(file.fileno())
            beside.replace(self._path)
            sync_folder(self._path.parent)

    def _forget(self) -> None:
        self._lines: list[Line] = []
        self._count = 0  # lines, those that were passed over too
        self._at = 0  # bytes that were read
        self._last = b""  # the end of them
        self._which = (-1, -1)

    def _read_on(self, fd: int) -> tuple[Line, ...]:
        """What is there, of an open file; another file, or one that was changed, is read from its start."""
        with self._guard:
            now = os.fstat(fd)
            if (now.st_dev, now.st_ino) != self._which or os.pread(fd, len(self._last), self._seen_from) != self._last:
                self._forget()
                self._which = now.st_dev, now.st_ino
            data = b""
            while piece := os.pread(fd, 1 << 20, self._at + len(data)):
                data += piece
            whole, _, rest = data.rpartition(b"\n") if b"\n" in data else (b"", b"", data)
            found = whole.split(b"\n") if b"\n" in data else []
            lines = [self._decode(line, self._count + number) for number, line in enumerate(found, 1)]
            half = self._decode(rest, self._count + len(found) + 1) if rest else None
            self._lines += [line for line in lines if line is not None]
            self._count += len(found)
            self._at += len(data) - len(rest)
            self._last = (self._last + data[: len(data) - len(rest)])[-_REMEMBERED:]
            return (*self._lines, half) if half is not None else tuple(self._lines)

    @property
    def _seen_from(self) -> int:
        return self._at - len(self._last)


_REMEMBERED = 256  # bytes by which a file that was changed is known


class _HeldFile(Held[Line]):
    def __init__(self, fd: int, lines: tuple[Line, ...]) -> None:
        super().__init__(lines)
        self._fd = fd

    def append(self, *lines: Line) -> None:
        """Write them behind the others; a line that a crash cut off was never acknowledged, and stays alone."""
        size = os.fstat(self._fd).st_size
        cut_off = size > 0 and os.pread(self._fd, 1, size - 1) != b"\n"
        data = b"\n" * cut_off + b"".join(msgspec.json.encode(line) + b"\n" for line in lines)
        while data:
            data = data[os.write(self._fd, data) :]
        os.fsync(self._fd)
        self.lines += lines
