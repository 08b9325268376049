"""Errors that a user can correct. Bugs remain assertions and tracebacks."""

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike, fspath, strerror

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


@contextmanager
def name_file_in_errors(path: PathLike[str]) -> Iterator[None]:
    """Let an OSError that does not say which file it is about name this one: the system's calls on open files do not.

    Raises:
        OSError: as what was raised, with the file's name.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = fspath(path)
        raise


@contextmanager
def name_output_when_full(out: PathLike[str]) -> Iterator[None]:
    """Let an error of a full disk name what was to be written: libraries name nothing, or what they copied from.

    Raises:
        OSError: as what was raised, with the output's name.
    """
    try:
        yield
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise OSError(error.errno, strerror(error.errno), fspath(out)) from error
        raise


def escape_control_characters(text: str) -> str:
    """Escape a text for a terminal: control characters, which could do anything to it, as Python writes them."""
    if text.isprintable():  # most lines of a long list
        return text
    return "".join(letter if letter.isprintable() or letter in "\n\t" else ascii(letter)[1:-1] for letter in text)


def escape_line(text: str) -> str:
    """Escape a text as one line for a terminal: a line break in it, of a file's name, is escaped too."""
    return escape_control_characters(text).replace("\n", "\\n")


class MinihumanError(Exception):
    """Base of every error that names a thing, a value and the way out; the command line prints it in one line."""

    exit_code = 2  # what the command line ends with: bad input


class WorldError(MinihumanError, ValueError):
    """A world was asked for something it cannot do: an unknown id, a bad option, an action out of range."""


class ProtocolError(MinihumanError, ValueError):
    """A protocol file says something impossible; the message holds file, path and the way out."""

    mistakes: tuple[str, ...] = ()  # a line each, where all were looked for

    @classmethod
    def of(cls, mistakes: Sequence[str], source: str) -> "ProtocolError":
        """Make the error of one mistake or more: it says the first, and where the others are said."""
        more = f" (and {len(mistakes) - 1} more: minihuman check {source} says all)" if len(mistakes) > 1 else ""
        error = cls(mistakes[0] + more)
        error.mistakes = tuple(mistakes)
        return error


class AllocationError(MinihumanError, ValueError):
    """A participant's place in the study cannot be taken."""


class SimulationError(MinihumanError, ValueError):
    """A simulated player does not exist, has no such parameter, or cannot play this world."""


class PlayerFailedError(SimulationError):
    """A simulated participant crashed, or gave no answer.

    Attributes:
        reason: what of it may stand in a log: the error's type, or what was wrong with the answer.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


class LogError(MinihumanError, ValueError):
    """A log cannot be written, read or understood."""


class NewerLogError(LogError):
    """A log is of a newer version than this software reads; it is not damaged."""


class DataLossError(LogError):
    """Something that was recorded is not in its log."""

    exit_code = 1  # a check failed


class WindowError(MinihumanError, RuntimeError):
    """No window can be opened here."""


class DeviceError(MinihumanError, RuntimeError):
    """A device of the protocol, or what it needs, is not there."""


class ExportError(MinihumanError, ValueError):
    """An export cannot be made from these logs."""


class LearnError(MinihumanError, ValueError):
    """An agent's study, policy file or dataset does not fit what was asked."""


class QueryError(MinihumanError, ValueError):
    """A study's tables cannot answer what was asked."""


class ReportError(MinihumanError, ValueError):
    """A study's report cannot be made from these logs."""
