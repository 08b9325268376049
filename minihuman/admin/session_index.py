"""The session index of a study: one row per session, cached so that no unchanged log is read twice.

The table, ``sessions.sqlite`` in the study's folder, is a cache: each query first brings it up to date by comparing
file sizes and times, and it may be deleted at any time. A row that another program changed does not have the digest
that was stored with it; it is made again, with a warning. Rows are yielded one by one, so that ten
thousand sessions take no more memory than ten. What reads
messages is imported only where a log's end does not say enough.
"""

import logging
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, fields
from datetime import datetime
from hashlib import blake2b
from operator import attrgetter
from pathlib import Path
from typing import Any

from minihuman.dataset.caches import SESSION_CACHE as FILE_NAME
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY, SCHEMA_VERSION, STEP
from minihuman.log.paths import find_log_folders, group_sessions, raise_as_log_error, require_folder
from minihuman.log.salvage.summary_section import all_ended_cleanly, read_summary


@dataclass(frozen=True, slots=True)
class SessionSummary:
    """A session in one row. Counts are of all its segments together."""

    study: str
    participant: str
    group: str
    session: int
    player: str
    started_at: str  # ISO 8601 UTC
    segments: int
    clean: bool
    end_reason: str  # an EndReason, or "cut_off"
    episodes_planned: int  # less those that were skipped
    episodes_completed: int  # with an outcome other than abandoned
    steps: int
    duration_s: float  # from a segment's start to its last message, summed
    complete: bool  # it said so, or nothing was left to do but to read last words


LOGGER = logging.getLogger("minihuman")
_COLUMNS = tuple(f'"{field.name}"' for field in fields(SessionSummary))
_VALUES = attrgetter(*(field.name for field in fields(SessionSummary)))
_ROW = f"log, fingerprint, path, problem, {', '.join(_COLUMNS)}"  # what the digest is of
_PAGE = "SELECT * FROM sessions_v3 WHERE log > ? ORDER BY log LIMIT 100"  # as digested: a column's name may be damaged
LOCK_TIMEOUT_S = 2.0  # how long another process may hold the table before we do without it
_DAMAGE_ERRORS = (sqlite3.Error, UnicodeError)  # what a damaged file makes sqlite raise


@dataclass(frozen=True, slots=True)
class SessionRow:
    """One session of a study: where it is, and what is in it or why it cannot be read."""

    path: Path  # the finished log; the live or cut-off segment where there is none yet
    summary: SessionSummary | None  # None: unreadable
    problem: str  # why; "" if it is readable


def read_session_index(study: Path) -> Iterator[SessionRow]:
    """Yield a row for every session log below a folder, in order of path; the unreadable ones say why.

    Raises:
        LogError: if the folder does not exist.
    """
    require_folder(study, instead="a study's folder, or a session log's own")
    with closing(_IndexTable(study)) as table:
        after = ""
        while page := table.page(after):  # no page is open while a caller works on its rows
            for _, _, path, problem, *values, _ in page:
                yield SessionRow(study / path, None if problem else SessionSummary(*values), problem)
            after = page[-1][0]


def compare_index(study: Path) -> Iterator[str]:
    """Yield the differences of a study's ``sessions.sqlite`` from what its logs say, one line for each session.

    Sessions that the next command would read again, since their logs changed, are not compared.
    """
    if not (study / FILE_NAME).is_file():
        return
    below = len(os.fspath(study / "_")) - 1
    try:
        with closing(sqlite3.connect(f"{(study / FILE_NAME).absolute().as_uri()}?mode=ro", uri=True)) as table:
            known = {row[0]: row for row in table.execute(f"SELECT {_ROW} FROM sessions_v3").fetchall()}
    except _DAMAGE_ERRORS as error:
        yield f"{FILE_NAME} cannot be read and will be made anew: {error}"
        return
    for log, files in _sessions_below(study):
        key, fingerprint = os.fspath(log)[below:], _fingerprint(files)
        there = known.get(key)
        if there is None or there[1] != fingerprint:
            continue
        row = (key, fingerprint, os.fspath(files[0])[below:], *_summary_or_problem(files, study))
        for name, cell, expected in zip(_ROW.split(", "), there, row, strict=True):
            if cell != expected:
                yield f"{FILE_NAME}: {key}, {name} is {cell!r}; the logs say {expected!r}"


class _IndexTable:
    """The table as of now; one in memory where the file cannot be written, is busy, is no table, or is damaged."""

    def __init__(self, study: Path) -> None:
        self._study = study
        self._table = _up_to_date(study)

    def page(self, after: str) -> list[tuple[Any, ...]]:
        """Rows behind a log's name; none at the end."""
        try:
            return self._table.execute(_PAGE, (after,)).fetchall()
        except _DAMAGE_ERRORS:
            self._table.close()
            self._table = _refreshed(sqlite3.connect(":memory:"), self._study)
            return self._table.execute(_PAGE, (after,)).fetchall()

    def close(self) -> None:
        """Let go of it."""
        self._table.close()


def _up_to_date(study: Path) -> sqlite3.Connection:
    """Open the table as of now; one in memory where the file cannot be written, is busy, or is no table."""
    try:
        return _refreshed(sqlite3.connect(study / FILE_NAME, timeout=LOCK_TIMEOUT_S), study)
    except _DAMAGE_ERRORS:
        return _refreshed(sqlite3.connect(":memory:"), study)


def _refreshed(table: sqlite3.Connection, study: Path) -> sqlite3.Connection:
    try:
        with table:
            # Rows have digests, their order has none.
            if table.execute("PRAGMA integrity_check(1)").fetchone() != ("ok",):
                raise sqlite3.DatabaseError("the index does not match the rows")
            table.execute("DROP TABLE IF EXISTS sessions_v2")  # of earlier versions: rows without a digest
            table.execute(f"CREATE TABLE IF NOT EXISTS sessions_v3 ({_ROW}, digest, PRIMARY KEY (log))")
            table.execute("CREATE TEMP TABLE present (log TEXT PRIMARY KEY)")
            _refresh(table, study)
    except _DAMAGE_ERRORS:
        table.close()
        raise
    return table


def _refresh(table: sqlite3.Connection, study: Path) -> None:
    below = len(os.fspath(study / "_")) - 1  # what every path there begins with
    damaged = 0
    for log, files in _sessions_below(study):
        key, fingerprint = os.fspath(log)[below:], _fingerprint(files)
        table.execute("INSERT INTO present VALUES (?)", (key,))
        known = table.execute("SELECT * FROM sessions_v3 WHERE log = ?", (key,)).fetchone()
        is_damaged = known is not None and known[-1] != _digest(known[:-1])
        damaged += is_damaged
        if known is None or is_damaged or known[1] != fingerprint:
            row = (key, fingerprint, os.fspath(files[0])[below:], *_summary_or_problem(files, study))
            values = ", ".join("?" * (len(row) + 1))
            table.execute(f"INSERT OR REPLACE INTO sessions_v3 VALUES ({values})", (*row, _digest(row)))
    table.execute("DELETE FROM sessions_v3 WHERE log NOT IN (SELECT log FROM present)")
    if damaged:
        what = "1 session" if damaged == 1 else f"{damaged} sessions"
        own = study / FILE_NAME
        LOGGER.warning("%s was changed by another program: the rows of %s were made anew from the logs", own, what)


def _digest(row: tuple[object, ...]) -> str:
    """Digest a row as SQLite gives it back, where a boolean is an integer."""
    values = tuple(int(value) if isinstance(value, bool) else value for value in row)
    return blake2b(repr(values).encode(), digest_size=16).hexdigest()


def _sessions_below(study: Path) -> Iterator[tuple[Path, list[Path]]]:
    for folder, names in find_log_folders(study):
        yield from group_sessions(folder, names).items()


def _fingerprint(files: list[Path]) -> str:
    found = []
    for file in files:
        try:
            facts = file.stat()
            found.append(f"{file.name} {facts.st_size} {facts.st_mtime_ns}")
        except FileNotFoundError:  # finished just now; the next listing finds it under its new name
            found.append(f"{file.name} gone")
    return "\n".join(found)


def _summary_or_problem(files: list[Path], study: Path) -> tuple[object, ...]:
    try:
        return ("", *_VALUES(summarize_session(files)))
    except LogError as error:
        return (str(error).replace(os.fspath(study / "_")[:-1], ""), *(None for _ in _COLUMNS))


def summarize_session(files: Sequence[Path]) -> SessionSummary:
    """Sum up a session's log and segments, in order.

    A finished log is summed up from what was written at its end, if that holds and is enough; others are read through.

    Raises:
        LogError: if one cannot be opened, is no session log, of another schema version or damaged, or holds no plan.
    """
    with raise_as_log_error(files[0]):
        summary = _summarize_finished(files[0]) if len(files) == 1 else None
        if summary is None:
            from minihuman.admin.log_info import summarize_from_messages  # all that reads messages: rarely needed

            summary = summarize_from_messages(files)
        datetime.fromisoformat(summary.started_at)  # metadata have no checksum, and who is due is told from this
        return summary


def _summarize_finished(log: Path) -> SessionSummary | None:
    """Sum up a log from what its segments' ends say; None where one does not, as in logs of earlier versions.

    Also None where all episodes were played and the session ended otherwise: what else was left messages alone say.
    """
    found = read_summary(log)
    if found is None or not found.starts or not len(found.starts) == len(found.facts) == len(found.ends):
        return None
    if found.starts[0].get("schema_version") != str(SCHEMA_VERSION) or "completed" not in found.ends[-1]:
        return None
    first, last = found.starts[0], found.ends[-1]
    reason, planned, completed = last["reason"], int(last["planned"]), int(last["completed"])
    if reason != "complete" and 0 < planned == completed:
        return None
    return SessionSummary(
        study=first["study"],
        participant=first["participant"],
        group=first["group"],
        session=int(first["session"]),
        player=found.facts[0].get("player", "unknown"),
        started_at=first["started_at"],
        segments=len(found.starts),
        clean=all_ended_cleanly(found.starts, found.ends),
        end_reason=reason,
        episodes_planned=planned,
        episodes_completed=completed,
        steps=found.counts[STEP],
        duration_s=sum(int(end.get("lasted_ns", 0)) for end in found.ends) / 1e9,
        complete=reason == "complete",
    )


def find_double_sessions(study: Path) -> Iterator[str]:
    """Name each session that was completed twice: by two servers of an earlier version, which did not know each other.

    Copies of one log are none.
    """
    for folder, names in find_log_folders(study):
        logs = [log for log, files in group_sessions(folder, names).items() if log in files]
        complete: dict[tuple[str, int], dict[str, Path]] = {}  # by how the log ends
        for log in logs if len(logs) > 1 else ():
            try:
                found, its = read_summary(log), summarize_session([log])
            except LogError:  # named elsewhere
                continue
            if found is not None and its.complete:
                ends = complete.setdefault((its.participant, its.session), {})
                ends.setdefault(found.ends[-1].get(CHAIN_KEY, its.started_at), log)
        for (participant, session), ends in complete.items():
            if len(ends) > 1:
                paths = ", ".join(str(log) for log in ends.values())
                yield f"{participant} completed session {session} {len(ends)} times: {paths}; keep one in the study"
