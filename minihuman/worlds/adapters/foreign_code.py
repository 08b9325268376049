"""The boundary to foreign code: what a foreign world raises becomes a WorldCodeError that names the place.

A world must not end the program either: SystemExit, and a KeyboardInterrupt without Ctrl-C, count as errors of the
world.
"""

import dis
import re
import threading
import traceback
from pathlib import Path
from types import TracebackType

from minihuman.errors import MinihumanError, WorldError

_MAX_TEXT_CHARS = 200  # quoted from a world's error
_MISSING_ATTRIBUTE = re.compile(r"'([\w.]+)' object has no attribute '(\w+)'")  # Python's text of an AttributeError


class WorldCodeError(WorldError):
    """An error for a foreign world's code that raised an exception, which is the cause, or tried to end the program."""

    @property
    def log_text(self) -> str:
        """Return the error's text for a log: the type and message of the world's exception, without file and line.

        If the world tried to end the program, the text is that of this error.
        """
        cause = self.__cause__
        if not isinstance(cause, Exception):
            return str(self)
        if isinstance(cause, WorldError):
            return str(cause)
        return f"{type(cause).__name__}: {cause}"


class RemoteCodeError(WorldCodeError):
    """An error for a foreign world's code that failed in its own process, or for the end of that process.

    Args:
        message: what failed, and where
        log_text: the text for a log; the message if it is empty
    """

    def __init__(self, message: str, log_text: str = "") -> None:
        super().__init__(message)
        self._log_text = log_text or message

    @property
    def log_text(self) -> str:
        """Return the error's text for a log."""
        return self._log_text


class contain_errors:  # noqa: N801 - used as `contextlib.suppress` is
    """A context manager that turns exceptions of a foreign world's code into a WorldCodeError.

    A `MinihumanError`, and a KeyboardInterrupt from Ctrl-C, pass unchanged.

    Args:
        world_id: the world's id
        call: the call that runs the code, such as "step()"
    """

    __slots__ = ("_call", "_world_id")

    def __init__(self, world_id: str, call: str) -> None:
        self._world_id = world_id
        self._call = call

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, trace: TracebackType | None) -> None:
        if error is None or isinstance(error, MinihumanError) or _is_from_user(error):
            return
        raise WorldCodeError(f"{self._world_id}: {self._call} {describe_error(error)}") from error


def describe_error(error: BaseException) -> str:
    """Describe an exception of a world's code and its place, as in "raised ValueError: no such cell (maze.py:31)"."""
    frames = traceback.extract_tb(error.__traceback__)
    if frames:
        location = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    else:
        location = ""
    match error:
        case SystemExit():
            return f"tried to end the program{location}; end the episode instead, by returning terminated = True"
        case KeyboardInterrupt():
            return f"raised KeyboardInterrupt{location}, as Ctrl-C does; raise another error, or end the episode"
        case ValueError() | TypeError() if frames and _is_unpacking(frames[-1]):
            return f"did not return what Gymnasium asks for, so its wrapper {location.strip()} could not read it"
        case RecursionError():
            return f"calls itself without end{location}"
    text = " ".join(str(error).split())
    if isinstance(error, NotImplementedError) and not text:
        return f"is not implemented{location}"
    advice = ""
    if missing := _MISSING_ATTRIBUTE.fullmatch(text):
        message = f": {missing[1]} has no {missing[2]}"
        advice = "; if this code is unchanged, it expects another version of a package"
    elif text:
        message = f": {text[:_MAX_TEXT_CHARS]}"
    elif frames and frames[-1].line:  # an assertion without words: its line says what does not hold
        message = f" at `{frames[-1].line[:_MAX_TEXT_CHARS]}`"
    else:
        message = ""
    return f"raised {type(error).__name__}{message}{location}{advice}"


def _is_unpacking(frame: traceback.FrameSummary) -> bool:
    """Return whether the frame is a wrapper of Gymnasium that unpacks what a world returned."""
    return Path(frame.filename).parent.name == "wrappers" and "= self.env." in (frame.line or "")


def _is_from_user(error: BaseException) -> bool:
    """Return whether an error is a KeyboardInterrupt from Ctrl-C, and not from a ``raise`` in the interrupted code.

    Python handles signals in the main thread only.
    """
    if not isinstance(error, KeyboardInterrupt) or threading.current_thread() is not threading.main_thread():
        return False
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return True
    return dis.opname[trace.tb_frame.f_code.co_code[trace.tb_lasti]] != "RAISE_VARARGS"
