"""A study's sessions, read side by side on several cores and turned into rows."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from minihuman.errors import LogError, ProtocolError, WorldError
from minihuman.marks import read_marks, tags
from minihuman.measures.shortest import UNKNOWN, Shortest, shortest
from minihuman.opened import Skipped, log_files, open_or_skip
from minihuman.report.exclusions import Rules
from minihuman.report.tables import Rows, session_tables
from minihuman.study.plan import EpisodePlan, SessionPlan

_WORTH_A_POOL = 16  # sessions; fewer are read sooner than a second process starts


@dataclass(frozen=True, slots=True)
class Reading:
    """How a study is read: the tags that choose episodes, and whether shortest paths are worked out."""

    only: frozenset[str] = frozenset()
    without: frozenset[str] = frozenset()
    with_shortest: bool = True


@dataclass(frozen=True, slots=True)
class Session:
    """One session's plan and rows."""

    path: Path
    plan: SessionPlan
    rows: Rows


def read_study(source: Path, reading: Reading, *, processes: int | None = None) -> Iterator[Session | Skipped]:
    """Yield every session's rows in order of path, or why it is skipped. Only a few are held at a time.

    Raises:
        LogError: if there is no such file or folder.
        ReportError: if the protocol excludes by a measure that there is not.
    """
    paths = log_files(source)
    workers = min(processes or os.cpu_count() or 1, len(paths) // _WORTH_A_POOL + 1)
    read = partial(read_session, reading=reading)
    if workers == 1:
        yield from map(read, paths)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("forkserver")) as pool:
        yield from _in_order(pool, read, paths, ahead=4 * workers)


def read_session(path: Path, reading: Reading) -> Session | Skipped:
    """Read one session and make its rows, or say why it cannot be."""
    log = open_or_skip(path)
    if isinstance(log, Skipped):
        return log
    try:
        rules = Rules.of(log.plan, only=reading.only, without=reading.without)
        in_force = tags(read_marks(log.path))
        rows = session_tables(
            log, tags=in_force, rules=rules, shortest=_shortest if reading.with_shortest else _unknown
        )
    except (LogError, ProtocolError) as error:
        return Skipped(path, str(error))
    return Session(log.path, log.plan, rows)


def _in_order(
    pool: ProcessPoolExecutor, read: Callable[[Path], Session | Skipped], paths: Iterable[Path], *, ahead: int
) -> Iterator[Session | Skipped]:
    """Results in the order of the paths, with no more than ``ahead`` of them waiting to be taken."""
    waiting: deque[Future[Session | Skipped]] = deque()
    for path in paths:
        waiting.append(pool.submit(read, path))
        if len(waiting) >= ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def _shortest(plan: EpisodePlan) -> Shortest:
    """The shortest path, unknown where the world cannot be made here."""
    try:
        return shortest(plan)
    except WorldError:
        return UNKNOWN


def _unknown(plan: EpisodePlan) -> Shortest:
    return UNKNOWN
