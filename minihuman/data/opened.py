"""Whatever a command was pointed at, opened: a log, a session's folder or a study's. Reading changes nothing.

What cannot be read is named with its reason, and the rest goes on.
"""

import atexit
import gc
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from minihuman.data.withdrawn import withdrawn_near
from minihuman.errors import LogError, ProtocolError
from minihuman.log.paths import folders_with_logs, sessions_among
from minihuman.log.read.glance import first_facts
from minihuman.log.read.guard import guarded
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
    return [path for path, _ in _found(source)]


def worth_reading(source: Path) -> tuple[list[Path], list[Skipped]]:
    """As ``log_files``, but of several logs of one session only the one in its own place, and of nobody who withdrew.

    Raises:
        LogError: if there is no such file or folder.
    """
    facts = {path: first_facts(first) for path, first in _found(source)}
    who_left = withdrawn_near({path.parent for path in facts})
    gone = {path for path, theirs in facts.items() if theirs.get("participant", "") in who_left[path.parent]}
    taken: dict[tuple[str, ...], Path] = {}
    for path in sorted(set(facts) - gone, key=lambda path: (not _in_place(path, facts[path]), path)):
        taken.setdefault(_session_of(facts[path]) or (str(path),), path)
    skipped = [
        Skipped(path, f"{_which(theirs)}, as is {kept}; move one of them away")
        for path, theirs in facts.items()
        if path not in gone and (kept := taken.get(_session_of(theirs) or (str(path),))) != path
    ]
    if gone:
        people = len({facts[path]["participant"] for path in gone})
        who = "1 participant" if people == 1 else f"{people} participants"
        skipped.append(Skipped(source if source.is_dir() else source.parent, f"{who} withdrew: left out"))
    kept_paths = set(taken.values())
    return [path for path in facts if path in kept_paths], skipped


def _found(source: Path) -> list[tuple[Path, Path]]:
    """What ``open_log`` takes, with the file that its session begins in."""
    if source.is_file():
        return [(source, source)]
    if not source.is_dir():
        raise LogError(f"{source} does not exist; name a session log, or a folder of them")
    folders = sorted(folders_with_logs(source))
    sessions = [(folder, files) for folder, names in folders for files in sessions_among(folder, names).values()]
    return [(files[0] if len(files) == 1 else folder, files[0]) for folder, files in sessions]


def _session_of(facts: dict[str, str]) -> tuple[str, ...]:
    """Which session a log says it is of; () where it does not say all of that, being damaged."""
    whose = tuple(facts.get(name, "") for name in ("study", "participant", "session"))
    return whose if all(whose) else ()


def _in_place(path: Path, facts: dict[str, str]) -> bool:
    """Whether a log lies where its session's is recorded."""
    folder = path if path.is_dir() else path.parent
    return folder.parts[-2:] == (facts.get("participant"), f"ses-{facts.get('session', ''):0>2}")


def _which(facts: dict[str, str]) -> str:
    return f"session {facts['session']} of {facts['participant']}, begun {facts.get('started_at', 'some time')}"


def open_or_skip(path: Path) -> SessionLog | Skipped:
    """Open one session, or say why it cannot be."""
    return _work_on(path, _itself)


def each_log(
    paths: Sequence[Path], work: Callable[[SessionLog], T], *, processes: int | None = None
) -> Iterator[T | Skipped]:
    """Yield what ``work`` makes of one session after the other, in order, several read side by side.

    ``work`` also runs in other processes where there are many sessions, so it and its results can be pickled. It may
    raise LogError or ProtocolError: that session is skipped. Only a few results are held at a time.
    """
    paths, each = list(paths), partial(_work_on_each, work=work)
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
    atexit.register(gc.unfreeze)  # else libraries in C take what is frozen for leaked, and say so


def _work_on_each(paths: list[Path], work: Callable[[SessionLog], T]) -> list[T | Skipped]:
    return [_work_on(path, work) for path in paths]


def _work_on(path: Path, work: Callable[[SessionLog], T]) -> T | Skipped:
    from minihuman.log.read.open_log import open_log  # all that reads messages: not needed where every row is kept

    try:
        log = open_log(path)
        with guarded(path):  # what a log says can be wrong in ways that only whoever works on it finds
            return work(log)
    except (LogError, ProtocolError, OSError) as error:
        return Skipped(path, str(error))


def _itself(log: SessionLog) -> SessionLog:
    return log
