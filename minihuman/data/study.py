"""A study's sessions, read side by side on several cores and turned into rows."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from minihuman.data.exclusions import Rules
from minihuman.data.marks import read_marks, tags
from minihuman.data.opened import Skipped, each_log
from minihuman.data.rows import Rows
from minihuman.data.tables import session_tables
from minihuman.errors import WorldError
from minihuman.measures.shortest import UNKNOWN, Shortest, shortest
from minihuman.recorded.episode import SessionLog
from minihuman.study.plan import EpisodePlan, SessionPlan


@dataclass(frozen=True, slots=True)
class Reading:
    """How a study is read: the tags that choose episodes, and whether the fewest possible steps are worked out.

    They are worked out in any case where the protocol leaves episodes or participants out by them.
    """

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
    yield from each_log(source, partial(read_session, reading=reading), processes=processes)


def read_session(log: SessionLog, reading: Reading) -> Session:
    """Make a session's rows.

    Raises:
        LogError: if the marks beside the log cannot be understood.
        ProtocolError: if the protocol in the log cannot be understood.
        ReportError: if the protocol excludes by a measure that there is not.
    """
    rules = Rules.of(log.plan, only=reading.only, without=reading.without)
    planner = _shortest if reading.with_shortest or rules.need_world else _unknown
    marks = read_marks(log.path)
    rows = session_tables(log, tags=tags(marks), rules=rules, shortest=planner, marks=marks)
    return Session(log.path, log.plan, rows)


def _shortest(plan: EpisodePlan) -> Shortest:
    """The shortest path, unknown where the world cannot be made here."""
    try:
        return shortest(plan)
    except WorldError:
        return UNKNOWN


def _unknown(plan: EpisodePlan) -> Shortest:
    return UNKNOWN
