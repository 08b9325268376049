"""Whatever a command was pointed at, opened: a log, a session's folder or a study's. Reading changes nothing.

What cannot be read is named with its reason, and the rest goes on.
"""

import gc
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from minihuman.errors import LogError, ProtocolError
from minihuman.log.paths import sessions_in
from minihuman.log.read.open_log import open_log
from minihuman.recorded.episode import SessionLog

T = TypeVar("T")
_WORTH_A_PROCESS = 32  # sessions; fewer are read sooner than one more process starts
_BATCH = 4  # sessions handed over together
_AHEAD = 12  # batches worked on and not yet taken, beside two for each other process
_Batch = tuple[list[Path], "Future[list[T]]"]


@dataclass(frozen=True, slots=True)
class Skipped:
    """A file that was left out, and why, in one sentence."""

    path: Path
    reason: str

    def line(self) -> str:
        """Say so."""
        return f"skipped {self.path}: {self.reason}"


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


def readable(sources: Iterable[Path], *, say: Callable[[str], None]) -> list[SessionLog]:
    """Open every session of several logs and folders; ``say`` is told what cannot be read, and why.

    Raises:
        LogError: if there is no such file or folder, or none of them can be read.
    """
    found = [one for source in sources for one in opened(source)]
    for one in found:
        if isinstance(one, Skipped):
            say(one.line())
    logs = [one for one in found if isinstance(one, SessionLog)]
    if not logs:
        raise LogError(f"there is no session to be read among {len(found)} logs; name a whole one")
    return logs


def open_or_skip(path: Path) -> SessionLog | Skipped:
    """Open one session, or say why it cannot be."""
    return _work_on(path, _itself)


def each_log(source: Path, work: Callable[[SessionLog], T], *, processes: int | None = None) -> Iterator[T | Skipped]:
    """Yield what ``work`` makes of one session after the other, in order of path, several read side by side.

    ``work`` also runs in other processes where there are many sessions, so it and its results can be pickled. It may
    raise LogError or ProtocolError: that session is skipped. Only a few results are held at a time.

    Raises:
        LogError: if there is no such file or folder.
    """
    paths = log_files(source)
    each = partial(_work_on_each, work=work)
    others = min(processes or os.cpu_count() or 1, len(paths) // _WORTH_A_PROCESS + 1) - 1
    if not others:
        yield from (_work_on(path, work) for path in paths)
        return
    with ProcessPoolExecutor(others, get_context("spawn"), _settle, (work,)) as pool:
        waiting: deque[_Batch[T | Skipped]] = deque()
        for first in range(0, len(paths), _BATCH):
            batch = paths[first : first + _BATCH]
            waiting.append((batch, pool.submit(each, batch)))
            if len(waiting) >= _AHEAD + 2 * others:
                yield from _oldest(waiting, each)
        while waiting:
            yield from _oldest(waiting, each)


def _oldest(waiting: "deque[_Batch[T]]", each: Callable[[list[Path]], list[T]]) -> list[T]:
    """Wait for the oldest batch's results, and meanwhile work in this process on the newest that no other has begun."""
    while not waiting[0][1].done():
        free = next((place for place in reversed(range(len(waiting))) if waiting[place][1].cancel()), None)
        if free is None:
            break
        batch, done = waiting[free][0], Future[list[T]]()
        done.set_result(each(batch))
        waiting[free] = (batch, done)
    return waiting.popleft()[1].result()


def _settle(work: Callable[[SessionLog], object]) -> None:
    """Make a process ready. Handed over, ``work`` has imported what it needs: the collector may leave that alone."""
    gc.freeze()


def _work_on_each(paths: list[Path], work: Callable[[SessionLog], T]) -> list[T | Skipped]:
    return [_work_on(path, work) for path in paths]


def _work_on(path: Path, work: Callable[[SessionLog], T]) -> T | Skipped:
    try:
        return work(open_log(path))
    except (LogError, ProtocolError, OSError) as error:
        return Skipped(path, str(error))


def _itself(log: SessionLog) -> SessionLog:
    return log
