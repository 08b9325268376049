"""Journals: durable, append-only lines that many processes write in turn. The port, one in a file, and where to find
them.

A study's journals are files in its folder, or tables of a database that ``register.url`` in the data folder names. A
study that began in files stays in files: the database lacks its earlier lines, withdrawals among them. A reader who
asks again gets only the added lines.
"""

import abc
import hashlib
import os
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

import msgspec

from minihuman.errors import LogError, name_file_in_errors
from minihuman.operating_system import read_at
from minihuman.storage.locks import is_file_at, lock_file
from minihuman.storage.system import current_system, sync_folder, write_again, write_durably

Line = TypeVar("Line")
State = TypeVar("State")
LineDecoder = Callable[[bytes, int], Line | None]  # a line's bytes and its number; None for one that is passed over

_TAIL = re.compile(rb',"previous":"([0-9a-f]{32})","digest":"([0-9a-f]{32})"')
_TAIL_NAMES = (b'"previous":"', b'"digest":"')
_CHAIN_START = "0" * 32


class LineChain:
    """The hash chain of a journal's lines, as far as lines were taken in.

    A chained line ends with ``"previous"``, the head of the chain over all lines before it, and ``"digest"``, the
    checksum of the line up to there. Lines that earlier versions wrote have neither: they are read as they are, counted
    as ``unchained``, and covered by the next chained line.
    """

    def __init__(self, journal: str) -> None:
        self.head = _CHAIN_START
        self.unchained = 0
        self._journal = journal  # its name in errors

    def copy(self) -> "LineChain":
        """The chain as it is now."""
        made = LineChain(self._journal)
        made.head, made.unchained = self.head, self.unchained
        return made

    def seal(self, encoded: bytes) -> bytes:
        """Add checksum and chain to a JSON object, and take the line in."""
        body = encoded[:-1] + b',"previous":"' + self.head.encode() + b'"'
        line = body + b',"digest":"' + _digest(body).encode() + b'"}'
        self.pass_over(line)
        return line

    def pass_over(self, line: bytes) -> None:
        """Take a line in as it is."""
        self.head = _digest(self.head.encode() + line)

    def open(self, line: bytes, number: int) -> bytes:
        """Take a line in; return the JSON object in it, b"" for a line that a crash cut off.

        Raises:
            LogError: if the line was changed, or one before it was changed, added or removed.
        """
        head = self.head
        self.pass_over(line)
        found = _TAIL.search(line)
        if found is None or found.end() == len(line):
            if line.endswith(b"}") and any(name in line for name in _TAIL_NAMES):
                raise self._damaged(number, "it was changed")
            if not line.strip(b"\0 ") or (line.startswith(b"{") and not line.endswith(b"}")):
                return b""  # a power cut may leave a line's size alone
            self.unchained += 1
            return line
        body = line[: found.end(1) + 1]
        if line[found.end() :] != b"}" or found[2].decode() != _digest(body):
            raise self._damaged(number, "it was changed")
        if found[1].decode() != head:
            raise self._damaged(number, "a line before it was changed, added or removed")
        return line[: found.start()] + b"}"

    def _damaged(self, number: int, what: str) -> LogError:
        return LogError(f"{self._journal}:{number}: cannot be believed: {what}; restore the file from a copy")


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


class LinesRead(Sequence[Line]):
    """The lines of a list that only grows, as far as it goes now; no copy, which a long study pays at each join."""

    def __init__(self, lines: list[Line]) -> None:
        self._lines, self._count = lines, len(lines)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, slice):
            return self._lines[slice(*at.indices(self._count))]
        return self._lines[range(self._count)[at]]

    def __iter__(self) -> Iterator[Line]:
        return islice(self._lines, self._count)


class LockedJournal(abc.ABC, Generic[Line]):
    """A journal while no other process can write to it."""

    def __init__(self, lines: Sequence[Line], declaration: Line | None = None) -> None:
        self._before, self._added = lines, list[Line]()
        self._declaration = declaration

    @property
    def lines(self) -> Sequence[Line]:
        """All lines, with those that were added here."""
        return (*self._before, *self._added) if self._added else self._before

    def append(self, *lines: Line) -> None:
        """Add lines, all or none; they last when the journal is let go of, at the latest.

        Raises:
            OSError: if they cannot be written.
        """
        if self._declaration is not None and self._declaration not in self.lines:
            lines = (self._declaration, *lines)
        self._write(lines)
        self._added += lines

    @abc.abstractmethod
    def _write(self, lines: tuple[Line, ...]) -> None:
        """Write lines behind the others."""


class Journal(abc.ABC, Generic[Line]):
    """Lines in the order in which they were added."""

    @property
    @abc.abstractmethod
    def begun(self) -> bool:
        """Whether there ever was a line."""

    @abc.abstractmethod
    def read(self) -> Sequence[Line]:
        """All lines.

        Raises:
            OSError: if they cannot be read.
        """

    @abc.abstractmethod
    def hold(self) -> AbstractContextManager[LockedJournal[Line]]:
        """Keep every other process out for a while.

        Raises:
            OSError: if that cannot be.
        """

    @property
    @abc.abstractmethod
    def unchained(self) -> int:
        """How many of the lines that were read have no checksum: earlier versions wrote them."""

    @abc.abstractmethod
    def keep(self, wanted: Callable[[bytes], bool]) -> None:
        """Take out for ever what is not wanted.

        Raises:
            OSError: if that cannot be.
        """


class JournalState(Generic[Line, State]):
    """What a journal's lines amount to, kept from one time to the next: only lines that were added are taken in.

    Args:
        make: makes a state without lines.
        take: takes a line into it.
    """

    def __init__(self, make: Callable[[], State], take: Callable[[State, Line], object]) -> None:
        self._make, self._take = make, take
        self._guard = threading.Lock()
        self._state, self._count, self._last = make(), 0, cast(Line, None)

    def after(self, lines: Sequence[Line]) -> State:
        """The state after all lines of the journal, which its next call changes."""
        with self._guard:
            if self._count > len(lines) or (self._count and lines[self._count - 1] is not self._last):  # read anew
                self._state, self._count = self._make(), 0
            for line in lines[self._count :]:
                self._take(self._state, line)
            self._count = len(lines)
            self._last = lines[-1] if lines else self._last
            return self._state


class FileJournal(Journal[Line]):
    """Lines of JSON in a file under an exclusive lock, each fsynced.

    Args:
        path: the file; it and its folder are made when first written to.
        decode: reads a line.
        mode: who may read it.
        chained: each line carries a checksum and the head of the chain before it; nothing is ever taken out.
        declaration: written once, before the first line that is added; None: there is none.
    """

    _durable: int

    def __init__(
        self,
        path: Path,
        decode: LineDecoder[Line],
        *,
        mode: int = 0o644,
        chained: bool = False,
        declaration: Line | None = None,
    ) -> None:
        self._path, self._decode, self._mode, self._chained = path, decode, mode, chained
        self._declaration = declaration
        self._guard = threading.Lock()
        self._forget()

    @property
    def begun(self) -> bool:
        """Whether the file is there."""
        return self._path.exists()

    @property
    def unchained(self) -> int:
        """How many lines that were read have no checksum."""
        return self._chain.unchained

    def read(self) -> Sequence[Line]:
        """All lines; of one that is being written, nothing."""
        try:
            with name_file_in_errors(self._path), self._path.open("rb") as file:
                return self._read_on(file.fileno())
        except FileNotFoundError:
            return ()

    @contextmanager
    def hold(self) -> Iterator[LockedJournal[Line]]:
        """Keep others out by a lock, which ends with the process."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        disk = current_system().disk
        while True:
            with name_file_in_errors(self._path):
                fd = disk.open(self._path, os.O_CREAT | os.O_RDWR | os.O_APPEND, self._mode)
                try:
                    lock_file(fd, self._path)
                    if is_file_at(
                        fd, self._path
                    ):  # else a participant was removed from it meanwhile, which writes it anew
                        lines = self._read_on(fd)
                        chain = self._chain.copy() if self._chained else None
                        held = _LockedFile(fd, self._path, lines, self._declaration, chain, durable=self._durable)
                        try:
                            yield held
                        finally:
                            self._durable = held.durable
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
            with write_durably(beside, self._mode) as file:
                file.write(b"".join(line + b"\n" for line in kept))
            current_system().disk.rename(beside, self._path)
            sync_folder(self._path.parent)

    def _forget(self) -> None:
        self._lines: list[Line] = []
        self._count = 0  # lines, those that were passed over too
        self._at = 0  # bytes that were read
        self._last = b""  # the end of them
        self._which = (-1, -1)
        self._durable = 0  # bytes that this process made durable
        self._seen = (-1, -1)  # size and time of last change
        self._chain: LineChain = LineChain(str(self._path))

    def _read_on(self, fd: int) -> Sequence[Line]:
        """What is there, of an open file; another file, or one that was changed, is read from its start."""
        with self._guard:
            now = os.fstat(fd)
            size, mtime_ns = self._seen
            rewritten = now.st_size == size and now.st_mtime_ns != mtime_ns
            another = (now.st_dev, now.st_ino) != self._which
            if rewritten or another or read_at(fd, len(self._last), self._seen_from) != self._last:
                self._forget()
                self._which = now.st_dev, now.st_ino
            self._seen = now.st_size, now.st_mtime_ns
            data = b""
            while piece := read_at(fd, 1 << 20, self._at + len(data)):
                data += piece
            whole, _, rest = data.rpartition(b"\n") if b"\n" in data else (b"", b"", data)
            found = whole.split(b"\n") if b"\n" in data else []
            chain = self._chain.copy()
            lines = [self._open(chain, line, self._count + number) for number, line in enumerate(found, 1)]
            half = self._open(chain.copy(), rest, self._count + len(found) + 1) if rest else None
            self._chain = chain
            self._lines += [line for line in lines if line is not None]
            self._count += len(found)
            self._at += len(data) - len(rest)
            self._last = (self._last + data[: len(data) - len(rest)])[-_REMEMBERED:]
            return LinesRead(self._lines) if half is None else (*self._lines, half)

    def _open(self, chain: LineChain, line: bytes, number: int) -> Line | None:
        if self._chained and not (line := chain.open(line, number)):
            return None
        return self._decode(line, number)

    @property
    def _seen_from(self) -> int:
        return self._at - len(self._last)


_REMEMBERED = 256  # bytes by which a file that was changed is known


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
        self._fd, self._path, self._chain = fd, path, chain

    def _write(self, lines: tuple[Line, ...]) -> None:
        """Write them; a line that a crash cut off is finished first."""
        size = os.fstat(self._fd).st_size
        tail = max(0, size - _LONGEST)
        start = read_at(self._fd, _LONGEST, tail).rpartition(b"\n")[2]
        end = b"" if not start else b"\n"
        if start and self._chain is not None:
            end = (
                b" \n" if start.endswith(b"}") and _TAIL.search(start) is None else b"\n"
            )  # else it would read as whole
            self._chain.pass_over(start + end[:-1])
        encoded = [msgspec.json.encode(line) for line in lines]
        if self._chain is not None:
            encoded = [self._chain.seal(line) for line in encoded]
        data = end + b"".join(line + b"\n" for line in encoded)
        disk = current_system().disk
        try:
            if size != self.durable:  # another process wrote here, and may have ended because an fsync failed
                write_again(self._path, begin=tail)
            while data:
                data = data[disk.write(self._fd, data) :]
            disk.sync(self._fd)
            self.durable = os.fstat(self._fd).st_size
        except OSError:
            self.durable = -1
            with suppress(OSError):
                disk.truncate(self._fd, size)
            raise


_LONGEST = 1 << 20  # bytes of a line


URL_FILE_NAME = "register.url"
ENROLMENT_FILE_NAME = "register.jsonl"  # who took which slot, and who left it
ARRIVALS_FILE_NAME = "arrivals.jsonl"  # who came by which link


def open_journal(
    study_dir: Path,
    name: str,
    decode: LineDecoder[Line],
    *,
    mode: int = 0o644,
    chained: bool = False,
    declaration: Line | None = None,
) -> Journal[Line]:
    """A study's journal of that name; the same object for every caller in this process."""
    study_dir = study_dir.absolute()
    url = find_database_url(study_dir)
    made: Any = (
        _in_database(url, f"{study_dir.name}/{name}", decode, chained, declaration)
        if url
        else _in_file(study_dir / name, decode, mode, chained, declaration)
    )
    return made  # type: ignore[no-any-return]


def find_database_url(study_dir: Path) -> str:
    """The address of the database that holds a study's journals; "" where they are files."""
    study_dir = study_dir.absolute()
    path = study_dir.parent / URL_FILE_NAME
    if not path.is_file() or any((study_dir / name).exists() for name in (ENROLMENT_FILE_NAME, ARRIVALS_FILE_NAME)):
        return ""
    return path.read_text(encoding="utf-8").strip()


@cache
def _in_file(path: Path, decode: Callable[..., Any], mode: int, chained: bool, declaration: Any) -> Journal[Any]:
    return FileJournal(path, decode, mode=mode, chained=chained, declaration=declaration)


@cache
def _in_database(url: str, name: str, decode: Callable[..., Any], chained: bool, declaration: Any) -> Journal[Any]:
    if (open_journal := current_system().open_database_journal) is not None:
        return open_journal(url, name, decode, chained=chained, declaration=declaration)  # type: ignore[no-any-return]
    from minihuman.storage.postgres_journal import PostgresJournal

    return PostgresJournal(url, name, decode, chained=chained, declaration=declaration)
