"""Errors that a user can correct. Bugs remain assertions and tracebacks."""

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike, fspath, strerror

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})  # disk full, quota exceeded, file too large


@contextmanager
def name_file_in_errors(path: PathLike[str]) -> Iterator[None]:
    """Add the file name ``path`` to an OSError of the enclosed code that names no file, as for calls on open files.

    Raises:
        OSError: the original error, with the file's name.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = fspath(path)
        raise


@contextmanager
def name_output_when_full(out: PathLike[str]) -> Iterator[None]:
    """Raise an error about a full disk again with the name of the output.

    The libraries that write the output raise the error without a file name, or with that of the file they copy from.

    Raises:
        OSError: the error with the output's name if there was no room for the file; otherwise the original error.
    """
    try:
        yield
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise OSError(error.errno, strerror(error.errno), fspath(out)) from error
        raise


def escape_control_characters(text: str) -> str:
    """Return a text with the control characters, which could alter a terminal's display, in Python's notation.

    Line breaks and tabs stay as they are.
    """
    if text.isprintable():  # most lines of a long list
        return text
    return "".join(letter if letter.isprintable() or letter in "\n\t" else ascii(letter)[1:-1] for letter in text)


def escape_line(text: str) -> str:
    """Return a text as one line for a terminal, with control characters and line breaks in Python's notation."""
    return escape_control_characters(text).replace("\n", "\\n")


class MinihumanError(Exception):
    """The base of all errors that name the thing, its value and a remedy.

    The command line prints such an error in one line.
    """

    exit_code = 2  # the exit status of the command line: bad input


class WorldError(MinihumanError, ValueError):
    """A world cannot do what was requested: an unknown id, a bad option, or an action out of range."""


class ProtocolError(MinihumanError, ValueError):
    """A protocol file is not valid; the message holds the file, the path in it and a remedy."""

    mistakes: tuple[str, ...] = ()  # one line each; empty if only the first mistake was looked for

    @classmethod
    def of(cls, mistakes: Sequence[str], source: str) -> "ProtocolError":
        """Create the error for one or more mistakes; its message states the first one and where to find the others.

        Args:
            mistakes: one line for each mistake, at least one.
            source: the protocol's file, for the command that lists all mistakes.
        """
        more = f" (and {len(mistakes) - 1} more: minihuman check {source} says all)" if len(mistakes) > 1 else ""
        error = cls(mistakes[0] + more)
        error.mistakes = tuple(mistakes)
        return error


class AllocationError(MinihumanError, ValueError):
    """A participant's allocation slot in the study cannot be taken."""


class SimulationError(MinihumanError, ValueError):
    """A simulated player does not exist, has no such parameter, or cannot play this world."""


class PlayerFailedError(SimulationError):
    """A simulated participant crashed, or gave no answer.

    Attributes:
        reason: the part of the message that may appear in a log: the error's type, or what was wrong with the answer.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


class LogError(MinihumanError, ValueError):
    """A log cannot be written, read or decoded."""


class NewerLogError(LogError):
    """A log has a newer version than this software can read; it is not damaged."""


class DataLossError(LogError):
    """Recorded data are missing from their log."""

    exit_code = 1  # a check failed


class WindowError(MinihumanError, RuntimeError):
    """No window can be opened on this machine."""


class DeviceError(MinihumanError, RuntimeError):
    """A device of the protocol, or something that the device needs, is missing."""


class ExportError(MinihumanError, ValueError):
    """An export cannot be made from these logs."""


class LearnError(MinihumanError, ValueError):
    """A study, a policy file, a dataset or a setting does not fit what an agent's training or use requires."""


class QueryError(MinihumanError, ValueError):
    """A study's tables cannot answer a query."""


class ReportError(MinihumanError, ValueError):
    """A study's report cannot be made from these logs."""
