"""Limit how long a plug-in's code may take to answer, and name its failures without what must not be in a log."""

import re
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from minihuman.errors import MinihumanError
from minihuman.operating_system import interrupt_after

ANSWER_TIMEOUT_S = 60.0


@contextmanager
def limit_answer_time() -> Iterator[None]:
    """Interrupt Python code that takes longer than ``ANSWER_TIMEOUT_S``.

    Only in the main thread, and where the system has interval timers (not on Windows); elsewhere there is no limit.

    Raises:
        TimeoutError: in the code, if it takes longer.
    """
    with interrupt_after(ANSWER_TIMEOUT_S):
        yield


def locate_error(error: BaseException) -> str:
    """Where an error was raised: file name and line, without the folder."""
    frames = traceback.extract_tb(error.__traceback__)
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""


_PATHS = re.compile(r"\S*[/\\](.*[/\\])?\S*")


def describe_failure(error: BaseException) -> str:
    """Describe an error for a log: its type and, if it is one of ours, its sentence without whatever may be a path."""
    if not isinstance(error, MinihumanError):
        return type(error).__name__
    return f"{type(error).__name__}: {_PATHS.sub('...', str(error).partition(chr(10))[0])}"
