"""A study's sessions at a glance: one row each, kept in a small table beside them so that none is read twice.

The table, ``sessions.sqlite`` in the study's folder, is a cache: whenever it is asked it is first brought up to date,
by comparing file sizes and times, and it may be deleted at any time. Rows are handed out one by one, so that ten
thousand sessions take no more memory than ten.
"""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.paths import LOG_SUFFIX, PART_SUFFIX, sessions_in
from minihuman.log.summary import Summary, summarise

FILE_NAME = "sessions.sqlite"
_COLUMNS = tuple(f'"{field.name}"' for field in fields(Summary))
_TABLE = f"sessions_v1 (log TEXT PRIMARY KEY, fingerprint TEXT, path TEXT, problem TEXT, {', '.join(_COLUMNS)})"


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
    if not study.is_dir():
        raise LogError(f"{study} is not a folder; name a study's folder, or a session log's own")
    with closing(_table(study)) as table:
        _refresh(table, study)
        for path, problem, *values in table.execute(
            f"SELECT path, problem, {', '.join(_COLUMNS)} FROM sessions_v1 ORDER BY log"
        ):
            yield SessionRow(study / path, None if problem else Summary(*values), problem)


def _table(study: Path) -> sqlite3.Connection:
    """Open the table; one in memory where the folder cannot be written or the file is no table."""
    try:
        return _made(sqlite3.connect(study / FILE_NAME))
    except sqlite3.Error:
        return _made(sqlite3.connect(":memory:"))


def _made(table: sqlite3.Connection) -> sqlite3.Connection:
    with table:
        table.execute(f"CREATE TABLE IF NOT EXISTS {_TABLE}")
        table.execute("CREATE TEMP TABLE present (log TEXT PRIMARY KEY)")
    return table


def _refresh(table: sqlite3.Connection, study: Path) -> None:
    with table:
        for log, files in _sessions_below(study):
            key, fingerprint = str(log.relative_to(study)), _fingerprint(files)
            table.execute("INSERT INTO present VALUES (?)", (key,))
            known = table.execute("SELECT fingerprint FROM sessions_v1 WHERE log = ?", (key,)).fetchone()
            if known != (fingerprint,):
                row = (key, fingerprint, str(files[0].relative_to(study)), *_summary_or_problem(files))
                table.execute(f"INSERT OR REPLACE INTO sessions_v1 VALUES ({', '.join('?' * len(row))})", row)
        table.execute("DELETE FROM sessions_v1 WHERE log NOT IN (SELECT log FROM present)")


def _sessions_below(study: Path) -> Iterator[tuple[Path, list[Path]]]:
    for folder, _, names in os.walk(study):
        if any(name.endswith((LOG_SUFFIX, PART_SUFFIX)) for name in names):
            yield from sessions_in(Path(folder)).items()


def _fingerprint(files: list[Path]) -> str:
    found = []
    for file in files:
        facts = file.stat()
        found.append(f"{file.name} {facts.st_size} {facts.st_mtime_ns}")
    return "\n".join(found)


def _summary_or_problem(files: list[Path]) -> tuple[object, ...]:
    try:
        return ("", *astuple(summarise(files)))
    except LogError as error:
        return (str(error), *(None for _ in _COLUMNS))
