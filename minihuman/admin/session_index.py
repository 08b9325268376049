"""The session index of a study: one row per session, cached so that no unchanged log is read twice.

The table, ``sessions.sqlite`` in the study's folder, is a cache: each query first brings it up to date by comparing
file sizes and times, and it may be deleted at any time. A row that another program changed does not have the digest
that was stored with it; it is made again, with a warning. Rows are yielded one by one, so that ten
thousand sessions take no more memory than ten. What reads logs is imported only when a log is new.
"""

import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, fields
from hashlib import blake2b
from operator import attrgetter
from pathlib import Path
from typing import Any

from minihuman.dataset.caches import SESSION_CACHE as FILE_NAME
from minihuman.errors import LogError
from minihuman.log.paths import find_log_folders, group_sessions, require_folder


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
    from minihuman.admin.session_summary import summarize_session

    try:
        return ("", *_VALUES(summarize_session(files)))
    except LogError as error:
        return (str(error).replace(os.fspath(study / "_")[:-1], ""), *(None for _ in _COLUMNS))
