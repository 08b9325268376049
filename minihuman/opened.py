"""Whatever a command was pointed at, opened: a log, a session's folder or a study's. Reading changes nothing.

What cannot be read is named with its reason, and the rest goes on.
"""

import gc
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from minihuman.errors import LogError, ProtocolError
from minihuman.log.episode import SessionLog
from minihuman.log.paths import sessions_in
from minihuman.log.read import open_log

T = TypeVar("T")
_WORTH_A_POOL = 16  # sessions; fewer are read sooner than a second process starts
_AHEAD = 4  # sessions a process, read and not yet taken


@dataclass(frozen=True, slots=True)
class Skipped:
    """A file that was left out, and why, in one sentence."""

    path: Path
    reason: str


def log_files(source: Path) -> list[Path]:
    """List what ``open_log`` takes: the log itself, or every session below a folder, in order of path.

    A session in several segments is named by its folder, so that they are read together.

    Raises:
        LogError: if there is no such file or folder.
    """
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise LogError(f"{source} does not exist; name a session log, or a folder of them")
    folders = sorted({path.parent for path in source.rglob("*.mcap*")})
    sessions = [(folder, files) for folder in folders for files in sessions_in(folder).values()]
    return [files[0] if len(files) == 1 else folder for folder, files in sessions]


def opened(source: Path) -> Iterator[SessionLog | Skipped]:
    """Open one session after the other; what cannot be read is named with its reason, and the rest goes on.

    Raises:
        LogError: if there is no such file or folder.
    """
    for path in log_files(source):
        yield open_or_skip(path)


def open_or_skip(path: Path) -> SessionLog | Skipped:
    """Open one session, or say why it cannot be."""
    return _work_on(path, _itself)


def each_log(source: Path, work: Callable[[SessionLog], T], *, processes: int | None = None) -> Iterator[T | Skipped]:
    """Yield what ``work`` makes of one session after the other, in order of path, several read side by side.

    ``work`` runs in another process where there are many sessions, so it and its results can be pickled. It may raise
    LogError or ProtocolError: that session is skipped. Only a few results are held at a time.

    Raises:
        LogError: if there is no such file or folder.
    """
    paths = log_files(source)
    workers = min(processes or os.cpu_count() or 1, len(paths) // _WORTH_A_POOL + 1)
    each = partial(_work_on, work=work)
    if workers == 1:
        yield from map(each, paths)
        return
    # what a process has imported by then is there to stay: the collector need not look through it for every session
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=gc.freeze) as pool:
        waiting: deque[Future[T | Skipped]] = deque()
        for path in paths:
            waiting.append(pool.submit(each, path))
            if len(waiting) >= _AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _work_on(path: Path, work: Callable[[SessionLog], T]) -> T | Skipped:
    try:
        return work(open_log(path))
    except (LogError, ProtocolError, OSError) as error:
        return Skipped(path, str(error))


def _itself(log: SessionLog) -> SessionLog:
    return log
