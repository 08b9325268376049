"""Journals: durable, append-only lines that many processes write in turn, with their hash chain.

Repeated reads parse only the added lines. ``file_journal`` and ``postgres_journal`` have the two implementations, and
``study_journals`` selects one for a study.
"""

import abc
import hashlib
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from itertools import islice
from typing import Any, Generic, TypeVar, cast

from minihuman.errors import LogError

Line = TypeVar("Line")
State = TypeVar("State")
LineDecoder = Callable[[bytes, int], Line | None]  # a line's bytes and its number; None for one that is passed over

TAIL = re.compile(rb',"previous":"([0-9a-f]{32})","digest":"([0-9a-f]{32})"')
_TAIL_NAMES = (b'"previous":"', b'"digest":"')
_CHAIN_START = "0" * 32


class LineChain:
    """The hash chain over the lines of a journal that have been processed so far.

    A chained line ends with ``"previous"``, the head of the chain over all lines before it, and ``"digest"``, the
    checksum of the line up to there. Lines that earlier versions wrote have neither: they are accepted as they are,
    counted as ``unchained``, and covered by the next chained line.
    """

    def __init__(self, journal: str) -> None:
        self.head = _CHAIN_START
        self.unchained = 0
        self._journal = journal  # its name in errors

    def copy(self) -> "LineChain":
        """Return a copy of the chain."""
        chain = LineChain(self._journal)
        chain.head = self.head
        chain.unchained = self.unchained
        return chain

    def seal(self, encoded: bytes) -> bytes:
        """Return the chained line for an encoded JSON object, and add it to the chain."""
        body = encoded[:-1] + b',"previous":"' + self.head.encode() + b'"'
        line = body + b',"digest":"' + _digest(body).encode() + b'"}'
        self.add_unchecked(line)
        return line

    def add_unchecked(self, line: bytes) -> None:
        """Add a line to the chain without checking it."""
        self.head = _digest(self.head.encode() + line)

    def open(self, line: bytes, number: int) -> bytes:
        """Check a line, add it to the chain, and return the JSON object that was sealed.

        Args:
            line: the bytes of the line, without the line feed.
            number: the line's number, for errors.

        Returns:
            The encoded object without the head and the checksum; b"" if a crash cut the line off.

        Raises:
            LogError: if the line was changed, or a line before it was changed, added or removed.
        """
        head = self.head
        self.add_unchecked(line)
        tail = TAIL.search(line)
        if tail is None or tail.end() == len(line):
            return self._open_unchained(line, number)
        previous = tail[1].decode()
        digest = tail[2].decode()
        body = line[: tail.end(1) + 1]  # up to the quote after the head of the chain
        if line[tail.end() :] != b"}" or digest != _digest(body):
            raise self._make_damage_error(number, "it was changed")
        if previous != head:
            raise self._make_damage_error(number, "a line before it was changed, added or removed")
        return line[: tail.start()] + b"}"

    def _open_unchained(self, line: bytes, number: int) -> bytes:
        """Check a line that does not end as ``seal`` ends it; return and count it, or return b"" if a crash cut it off.

        Raises:
            LogError: if the line is complete and has a part of what ``seal`` adds, so that it was changed.
        """
        if line.endswith(b"}") and any(name in line for name in _TAIL_NAMES):
            raise self._make_damage_error(number, "it was changed")
        is_blank = not line.strip(b"\0 ")  # after a power cut, zeros may be in place of the line's bytes
        is_half = line.startswith(b"{") and not line.endswith(b"}")
        if is_blank or is_half:
            return b""
        self.unchained += 1
        return line

    def _make_damage_error(self, number: int, reason: str) -> LogError:
        return LogError(f"{self._journal}:{number}: cannot be believed: {reason}; restore the file from a copy")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


class LinesRead(Sequence[Line]):
    """A view of a growing list that has only the list's present lines; a copy would be slow in long studies."""

    def __init__(self, lines: list[Line]) -> None:
        self._lines = lines
        self._count = len(lines)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return self._lines[slice(*index.indices(self._count))]
        return self._lines[range(self._count)[index]]  # the range raises IndexError, and converts negative indices

    def __iter__(self) -> Iterator[Line]:
        return islice(self._lines, self._count)


class LockedJournal(abc.ABC, Generic[Line]):
    """A journal that this process has locked, so that no other process can write to it."""

    def __init__(self, lines: Sequence[Line], declaration: Line | None = None) -> None:
        self._earlier = lines
        self._added: list[Line] = []
        self._declaration = declaration

    @property
    def lines(self) -> Sequence[Line]:
        """All lines, including those added under this lock."""
        if self._added:
            return (*self._earlier, *self._added)
        return self._earlier

    def append(self, *lines: Line) -> None:
        """Add all lines or none, after the declaration if the journal lacks it.

        They are durable by the time that the journal is unlocked.

        Raises:
            OSError: if they cannot be written.
        """
        if self._declaration is not None and self._declaration not in self.lines:
            lines = (self._declaration, *lines)
        self._write(lines)
        self._added += lines

    @abc.abstractmethod
    def _write(self, lines: tuple[Line, ...]) -> None:
        """Write lines after all existing ones."""


class Journal(abc.ABC, Generic[Line]):
    """Durable lines in the order in which they were added."""

    @property
    @abc.abstractmethod
    def begun(self) -> bool:
        """Whether the journal has a line or, for a journal in a file, whether the file exists."""

    @abc.abstractmethod
    def read(self) -> Sequence[Line]:
        """Return all lines.

        Raises:
            OSError: if they cannot be read.
        """

    @abc.abstractmethod
    def hold(self) -> AbstractContextManager[LockedJournal[Line]]:
        """Lock the journal against all other processes while the context lasts, and yield the locked journal.

        Raises:
            OSError: if it cannot be locked.
        """

    @property
    @abc.abstractmethod
    def unchained(self) -> int:
        """The number of lines read that have no checksum, because an earlier version wrote them."""

    @abc.abstractmethod
    def keep(self, is_kept: Callable[[bytes], bool]) -> None:
        """Remove permanently the lines that are not kept.

        Args:
            is_kept: is called with the bytes of each line, without a line feed, and returns whether the line stays.

        Raises:
            OSError: if they cannot be removed.
        """


class JournalState(Generic[Line, State]):
    """Keeps the state that results from a journal's lines, so that only added lines are processed.

    Args:
        make: returns the state of an empty journal.
        take: updates a state in place with a line.
    """

    def __init__(self, make: Callable[[], State], take: Callable[[State, Line], object]) -> None:
        self._make = make
        self._take = take
        self._guard = threading.Lock()
        self._state = make()
        self._count = 0
        self._last = cast(Line, None)

    def after(self, lines: Sequence[Line]) -> State:
        """Return the state that results from all lines of the journal; the next call may change the returned object.

        Args:
            lines: all lines, as ``Journal.read`` returns them, not only the added ones.
        """
        with self._guard:
            if not self._continues(lines):
                self._state = self._make()
                self._count = 0
            for line in lines[self._count :]:
                self._take(self._state, line)
                self._last = line
            self._count = len(lines)
            return self._state

    def _continues(self, lines: Sequence[Line]) -> bool:
        """Return whether the lines begin with those already processed; if not, the journal was read from its start."""
        if self._count == 0:
            return True
        return self._count <= len(lines) and lines[self._count - 1] is self._last
