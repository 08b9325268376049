"""A journal in a file: lines of JSON under an exclusive lock, each fsynced."""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from minihuman.errors import name_file_in_errors
from minihuman.operating_system import read_at
from minihuman.storage.durable_files import replace_durably, write_again
from minihuman.storage.journal import TAIL, Journal, Line, LineChain, LineDecoder, LinesRead, LockedJournal
from minihuman.storage.locks import is_file_at, lock_file
from minihuman.storage.system import current_system


class FileJournal(Journal[Line]):
    """A journal of JSON lines in a file, each of which is written under an exclusive lock and fsynced.

    Args:
        path: the file's path; the file and its folder are created by the first write.
        decode: decodes a line.
        mode: the permissions of the file.
        chained: whether each line has a checksum and the head of the chain before it; no line may then be removed.
        declaration: a line that is written once, before the first added line; None for none.
    """

    _durable: int

    def __init__(
        self,
        path: Path,
        decode: LineDecoder[Line],
        *,
        mode: int = 0o600,
        chained: bool = False,
        declaration: Line | None = None,
    ) -> None:
        self._path = path
        self._decode = decode
        self._mode = mode
        self._chained = chained
        self._declaration = declaration
        self._guard = threading.Lock()
        self._forget()

    @property
    def begun(self) -> bool:
        """Whether the file exists."""
        return self._path.exists()

    @property
    def unchained(self) -> int:
        """The number of lines read that have no checksum."""
        return self._chain.unchained

    def read(self) -> Sequence[Line]:
        """Return all lines, without a line that another process is just writing; none if there is no file."""
        try:
            with name_file_in_errors(self._path), self._path.open("rb") as file:
                return self._read_on(file.fileno())
        except FileNotFoundError:
            return ()

    @contextmanager
    def hold(self) -> Iterator[LockedJournal[Line]]:
        """Lock the journal for this process; the lock ends with the process."""
        disk = current_system().disk
        disk.make_folder(self._path.parent)
        while True:
            with name_file_in_errors(self._path):
                fd = disk.open(self._path, os.O_CREAT | os.O_RDWR | os.O_APPEND, self._mode)
                try:
                    lock_file(fd, self._path)
                    if not is_file_at(fd, self._path):
                        continue  # while this process waited, another one removed a participant and replaced the file
                    lines = self._read_on(fd)
                    chain = self._chain.copy() if self._chained else None
                    journal = _LockedFile(fd, self._path, lines, self._declaration, chain, durable=self._durable)
                    try:
                        yield journal
                    finally:
                        self._durable = journal.durable
                    return
                finally:
                    os.close(fd)

    def keep(self, is_kept: Callable[[bytes], bool]) -> None:
        """Replace the file durably by a file that has only the kept lines."""
        if not self.begun:
            return
        with self.hold():
            lines = [line for line in self._path.read_bytes().splitlines() if is_kept(line)]
            unfinished = self._path.with_name(f"{self._path.name}.new")
            with replace_durably(self._path, unfinished, mode=self._mode) as file:
                file.write(b"".join(line + b"\n" for line in lines))

    def _forget(self) -> None:
        """Discard everything that was read, so that the next read begins at the file's start."""
        self._lines: list[Line] = []
        self._count = 0  # lines read, including skipped ones
        self._at = 0  # bytes read
        self._last = b""  # the last bytes read
        self._file_id = (-1, -1)
        self._durable = 0  # size of the file when this process last made it durable, in bytes
        self._size_and_mtime_ns = (-1, -1)  # of the file, at the last read
        self._chain: LineChain = LineChain(str(self._path))

    def _read_on(self, fd: int) -> Sequence[Line]:
        """Read new lines of an open file; a file that was replaced or changed is read from its start."""
        with self._guard:
            self._forget_if_changed(fd)
            content = b""
            while piece := read_at(fd, _READ_BYTES, self._at + len(content)):
                content += piece
            *new_lines, unfinished = content.split(b"\n")
            finished = content.removesuffix(unfinished)
            chain = self._chain.copy()
            lines = [self._open(chain, line, self._count + number) for number, line in enumerate(new_lines, 1)]
            incomplete = None
            if unfinished:
                incomplete = self._open(chain.copy(), unfinished, self._count + len(new_lines) + 1)
            self._chain = chain
            self._lines += [line for line in lines if line is not None]
            self._count += len(new_lines)
            self._at += len(finished)
            self._last = (self._last + finished)[-_REMEMBERED:]
            if incomplete is None:
                return LinesRead(self._lines)
            return (*self._lines, incomplete)

    def _forget_if_changed(self, fd: int) -> None:
        """Forget the lines read so far if the file was replaced, or changed other than by adding to it."""
        status = os.fstat(fd)
        size, mtime_ns = self._size_and_mtime_ns
        is_rewritten = status.st_size == size and status.st_mtime_ns != mtime_ns
        is_another = (status.st_dev, status.st_ino) != self._file_id
        if is_rewritten or is_another or read_at(fd, len(self._last), self._last_begin) != self._last:
            self._forget()
            self._file_id = (status.st_dev, status.st_ino)
        self._size_and_mtime_ns = (status.st_size, status.st_mtime_ns)

    def _open(self, chain: LineChain, line: bytes, number: int) -> Line | None:
        """Check and decode a line; return None for a line of a chained journal that a crash cut off."""
        content = line
        if self._chained:
            content = chain.open(line, number)
            if not content:
                return None
        return self._decode(content, number)

    @property
    def _last_begin(self) -> int:
        return self._at - len(self._last)


_REMEMBERED = 256  # last bytes read; if the file has others in their place, it was changed
_READ_BYTES = 1 << 20  # per system call


class _LockedFile(LockedJournal[Line]):
    def __init__(
        self,
        fd: int,
        path: Path,
        lines: Sequence[Line],
        declaration: Line | None,
        chain: LineChain | None,
        *,
        durable: int,
    ) -> None:
        super().__init__(lines, declaration)
        self.durable = durable
        self._fd = fd
        self._path = path
        self._chain = chain

    def _write(self, lines: tuple[Line, ...]) -> None:
        """Write lines, after completing a line that a crash cut off."""
        size = os.fstat(self._fd).st_size
        tail = max(0, size - _MAX_LINE_BYTES)
        start = read_at(self._fd, _MAX_LINE_BYTES, tail).rpartition(b"\n")[2]
        end = self._complete_line(start)
        encoded = [msgspec.json.encode(line) for line in lines]
        if self._chain is not None:
            encoded = [self._chain.seal(line) for line in encoded]
        content = end + b"".join(line + b"\n" for line in encoded)
        disk = current_system().disk
        try:
            if size != self.durable:  # another process wrote here, and may have ended because an fsync failed
                write_again(self._path, begin=tail)
            while content:
                content = content[disk.write(self._fd, content) :]
            disk.sync(self._fd)
            self.durable = os.fstat(self._fd).st_size
        except OSError:
            self.durable = -1
            with suppress(OSError):
                disk.truncate(self._fd, size)
            raise

    def _complete_line(self, start: bytes) -> bytes:
        """Return the bytes that complete a line of which a crash left the start; b"" if the file ends with a line."""
        if not start:
            return b""
        end = b"\n"
        if self._chain is not None:
            if start.endswith(b"}") and TAIL.search(start) is None:
                end = b" \n"  # without the space, it would look like a whole line of an earlier version
            self._chain.pass_over(start + end.removesuffix(b"\n"))
        return end


_MAX_LINE_BYTES = 1 << 20
