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
        path: the file's path; the file and its folder are created when the journal is first locked.
        decode: decodes a line, or returns None to skip it.
        mode: the permissions of the file.
        chained: whether each line has a checksum and the head of the chain before it; no line may then be removed.
        declaration: a line that is written before the first added line unless the journal has it; None for none.
    """

    _durable_bytes: int

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
        """Return all lines, or none if there is no file; a line that another process is still writing is skipped."""
        try:
            with name_file_in_errors(self._path), self._path.open("rb") as file:
                return self._read_new_lines(file.fileno())
        except FileNotFoundError:
            return ()

    @contextmanager
    def hold(self) -> Iterator[LockedJournal[Line]]:
        """Lock the file while the context lasts, and yield the locked journal; the lock also ends with the process."""
        current_system().disk.make_folder(self._path.parent)
        with name_file_in_errors(self._path):
            fd = self._open_locked()
            try:
                lines = self._read_new_lines(fd)
                chain = self._chain.copy() if self._chained else None
                journal = _LockedFile(
                    fd, self._path, lines, self._declaration, chain, durable_bytes=self._durable_bytes
                )
                try:
                    yield journal
                finally:
                    self._durable_bytes = journal.durable_bytes
            finally:
                os.close(fd)

    def _open_locked(self) -> int:
        """Open the file, which is created if necessary, and lock it; return its descriptor."""
        while True:
            fd = current_system().disk.open(self._path, os.O_CREAT | os.O_RDWR | os.O_APPEND, self._mode)
            try:
                lock_file(fd, self._path)
                is_current = is_file_at(fd, self._path)
            except BaseException:
                os.close(fd)
                raise
            if is_current:
                return fd
            os.close(fd)  # while this process waited, another one removed a participant and replaced the file

    def keep(self, is_kept: Callable[[bytes], bool]) -> None:
        """Replace the file durably by one with only the lines that are kept; do nothing if there is no file.

        Args:
            is_kept: is called with the bytes of each line, without the line feed, and returns whether the line stays.
        """
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
        self._n_lines_read = 0  # including skipped ones
        self._n_bytes_read = 0
        self._last_bytes = b""  # the last bytes read
        self._file_id = (-1, -1)  # device and inode
        self._durable_bytes = 0  # size of the file when this process last made it durable
        self._size_and_mtime_ns = (-1, -1)  # of the file, at the last read
        self._chain: LineChain = LineChain(str(self._path))

    def _read_new_lines(self, fd: int) -> Sequence[Line]:
        """Read the lines added since the last call, or the whole file if it was replaced or changed; return all lines.

        A last line without a line feed is returned if it can be decoded, but is read again by the next call.
        """
        with self._guard:
            self._forget_if_changed(fd)
            content = b""
            while piece := read_at(fd, _READ_BYTES, self._n_bytes_read + len(content)):
                content += piece
            *new_lines, unfinished = content.split(b"\n")
            finished = content.removesuffix(unfinished)
            chain = self._chain.copy()
            decoded_lines = [
                self._decode_line(chain, line, number) for number, line in enumerate(new_lines, self._n_lines_read + 1)
            ]
            incomplete = None
            if unfinished:
                incomplete = self._decode_line(chain.copy(), unfinished, self._n_lines_read + len(new_lines) + 1)
            self._chain = chain
            self._lines += [line for line in decoded_lines if line is not None]
            self._n_lines_read += len(new_lines)
            self._n_bytes_read += len(finished)
            self._last_bytes = (self._last_bytes + finished)[-_REMEMBERED_BYTES:]
            if incomplete is None:
                return LinesRead(self._lines)
            return (*self._lines, incomplete)

    def _forget_if_changed(self, fd: int) -> None:
        """Forget the lines read so far if the file was replaced, or changed other than by adding to it."""
        status = os.fstat(fd)
        size, mtime_ns = self._size_and_mtime_ns
        is_rewritten = status.st_size == size and status.st_mtime_ns != mtime_ns
        is_replaced = (status.st_dev, status.st_ino) != self._file_id
        last_begin = self._n_bytes_read - len(self._last_bytes)
        if is_rewritten or is_replaced or read_at(fd, len(self._last_bytes), last_begin) != self._last_bytes:
            self._forget()
            self._file_id = (status.st_dev, status.st_ino)
        self._size_and_mtime_ns = (status.st_size, status.st_mtime_ns)

    def _decode_line(self, chain: LineChain, line: bytes, number: int) -> Line | None:
        """Add a line to the chain, if the journal is chained, and decode it.

        Returns:
            The decoded line; None if a crash cut the line off or the decoder skips it.
        """
        content = line
        if self._chained:
            content = chain.open(line, number)
            if not content:
                return None
        return self._decode(content, number)


_REMEMBERED_BYTES = 256  # of the last bytes read; if the file has others in their place, it was changed
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
        durable_bytes: int,
    ) -> None:
        super().__init__(lines, declaration)
        self.durable_bytes = durable_bytes  # size of the file when it was last made durable; -1 after a failed write
        self._fd = fd
        self._path = path
        self._chain = chain

    def _write(self, lines: tuple[Line, ...]) -> None:
        """Append lines durably, after ending a line that a crash cut off; after an error, remove what was appended."""
        size = os.fstat(self._fd).st_size
        tail_begin = max(0, size - _MAX_LINE_BYTES)
        unfinished = read_at(self._fd, _MAX_LINE_BYTES, tail_begin).rpartition(b"\n")[2]
        line_end = self._end_unfinished_line(unfinished)
        encoded = [msgspec.json.encode(line) for line in lines]
        if self._chain is not None:
            encoded = [self._chain.seal(line) for line in encoded]
        content = line_end + b"".join(line + b"\n" for line in encoded)
        disk = current_system().disk
        try:
            if size != self.durable_bytes:  # another process wrote here, and may have ended because an fsync failed
                write_again(self._path, begin=tail_begin)
            while content:
                content = content[disk.write(self._fd, content) :]
            disk.sync(self._fd)
            self.durable_bytes = os.fstat(self._fd).st_size
        except OSError:
            self.durable_bytes = -1
            with suppress(OSError):
                disk.truncate(self._fd, size)
            raise

    def _end_unfinished_line(self, unfinished: bytes) -> bytes:
        """Add a line that a crash cut off to the chain, and return the bytes that end it.

        Args:
            unfinished: the bytes after the file's last line feed; b"" if no line was cut off.

        Returns:
            The bytes to append to the file; b"" if no line was cut off.
        """
        if not unfinished:
            return b""
        line_end = b"\n"
        if self._chain is not None:
            if unfinished.endswith(b"}") and TAIL.search(unfinished) is None:
                line_end = b" \n"  # without the space, it would look like a whole line of an earlier version
            self._chain.add_unchecked(unfinished + line_end.removesuffix(b"\n"))
        return line_end


_MAX_LINE_BYTES = 1 << 20
