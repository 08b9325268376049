"""A study's sessions at a glance: one row each, kept in a small table beside them so that none is read twice.

The table, ``sessions.sqlite`` in the study's folder, is a cache: whenever it is asked it is first brought up to date,
by comparing file sizes and times, and it may be deleted at any time. Rows are handed out one by one, so that ten
thousand sessions take no more memory than ten.
"""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import Any

from minihuman.data.caches import SESSIONS as FILE_NAME
from minihuman.errors import LogError
from minihuman.lab.summary import Summary
from minihuman.log.paths import folders_with_logs, require_folder, sessions_among

_STORED: dict[Any, Any] = {str: str, int: int, bool: int, float: (int, float)}
_TYPES = tuple(_STORED[field.type] for field in fields(Summary))
_COLUMNS = tuple(f'"{field.name}"' for field in fields(Summary))
_VALUES = attrgetter(*(field.name for field in fields(Summary)))
_TABLE = f"sessions_v2 (log TEXT PRIMARY KEY, fingerprint TEXT, path TEXT, problem TEXT, {', '.join(_COLUMNS)})"
_PAGE = f"SELECT log, path, problem, {', '.join(_COLUMNS)} FROM sessions_v2 WHERE log > ? ORDER BY log LIMIT 100"
_KEEP = f"INSERT OR REPLACE INTO sessions_v2 VALUES (?, ?, ?, ?, {', '.join('?' * len(_COLUMNS))})"
BUSY_S = 2.0  # how long another process may hold the table before we do without it
_SPOILT = (sqlite3.Error, UnicodeError)  # what a damaged file makes sqlite raise


@dataclass(frozen=True, slots=True)
class SessionRow:
    """One session of a study: where it is, and what is in it or why it cannot be read."""

    path: Path  # the finished log; the live or cut-off segment where there is none yet
    summary: Summary | None  # None: unreadable
    problem: str  # why; "" if it is readable


def sessions(study: Path) -> Iterator[SessionRow]:
    """Yield a row for every session log below a folder, in order of path; the unreadable ones say why.

    Raises:
        LogError: if the folder does not exist.
    """
    require_folder(study, instead="a study's folder, or a session log's own")
    with closing(_Table(study)) as table:
        after = ""
        while page := table.page(after):  # no page is open while a caller works on its rows
            for _, path, problem, *values in page:
                yield SessionRow(study / path, None if problem else Summary(*values), problem)
            after = page[-1][0]


class _Table:
    """The table as of now; one in memory where the file cannot be written, is busy, is no table, or is damaged."""

    def __init__(self, study: Path) -> None:
        self._study = study
        self._table = _up_to_date(study)

    def page(self, after: str) -> list[tuple[Any, ...]]:
        """Rows behind a log's name; none at the end."""
        try:
            return _checked(self._table.execute(_PAGE, (after,)).fetchall())
        except _SPOILT:
            self._table.close()
            self._table = _refreshed(sqlite3.connect(":memory:"), self._study)
            return _checked(self._table.execute(_PAGE, (after,)).fetchall())

    def close(self) -> None:
        """Let go of it."""
        self._table.close()


def _checked(page: list[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """Rows of the types that belong there.

    Raises:
        sqlite3.Error: if one is of others: the file was damaged.
    """
    for log, path, problem, *values in page:
        texts = all(isinstance(text, str) for text in (log, path, problem))
        if not texts or not (problem or all(map(isinstance, values, _TYPES))):
            raise sqlite3.DatabaseError("the table is damaged")
    return page


def _up_to_date(study: Path) -> sqlite3.Connection:
    """Open the table as of now; one in memory where the file cannot be written, is busy, or is no table."""
    try:
        return _refreshed(sqlite3.connect(study / FILE_NAME, timeout=BUSY_S), study)
    except _SPOILT:
        return _refreshed(sqlite3.connect(":memory:"), study)


def _refreshed(table: sqlite3.Connection, study: Path) -> sqlite3.Connection:
    try:
        with table:
            table.execute(f"CREATE TABLE IF NOT EXISTS {_TABLE}")
            table.execute("CREATE TEMP TABLE present (log TEXT PRIMARY KEY)")
            _refresh(table, study)
    except _SPOILT:
        table.close()
        raise
    return table


def _refresh(table: sqlite3.Connection, study: Path) -> None:
    below = len(os.fspath(study / "_")) - 1  # what every path there begins with
    for log, files in _sessions_below(study):
        key, fingerprint = os.fspath(log)[below:], _fingerprint(files)
        table.execute("INSERT INTO present VALUES (?)", (key,))
        known = table.execute("SELECT fingerprint FROM sessions_v2 WHERE log = ?", (key,)).fetchone()
        if known != (fingerprint,):
            row = (key, fingerprint, os.fspath(files[0])[below:], *_summary_or_problem(files))
            table.execute(_KEEP, row)
    table.execute("DELETE FROM sessions_v2 WHERE log NOT IN (SELECT log FROM present)")


def _sessions_below(study: Path) -> Iterator[tuple[Path, list[Path]]]:
    for folder, names in folders_with_logs(study):
        yield from sessions_among(folder, names).items()


def _fingerprint(files: list[Path]) -> str:
    found = []
    for file in files:
        try:
            facts = file.stat()
            found.append(f"{file.name} {facts.st_size} {facts.st_mtime_ns}")
        except FileNotFoundError:  # finished just now; the next listing finds it under its new name
            found.append(f"{file.name} gone")
    return "\n".join(found)


def _summary_or_problem(files: list[Path]) -> tuple[object, ...]:
    from minihuman.lab.summarise import summarise  # all that reads logs: not needed where nothing is new

    try:
        return ("", *_VALUES(summarise(files)))
    except LogError as error:
        return (str(error), *(None for _ in _COLUMNS))
