"""The session index of a study: one row per session, cached so that no unchanged log is read twice.

It is a table of the study's cache, ``tables.duckdb``, which may be deleted at any time. Each query loads it into memory
and brings it up to date there; a session is read again if the size, time, beginning or end of its files changed, or if
its row does not have the digest that was stored with it. The file is open only while rows are loaded or stored; where
it is in use or cannot be written, the index is made for this once. Rows are yielded one by one, so that ten thousand
sessions take no more memory than ten. What reads messages is imported only where a log's end does not say enough.
Without DuckDB, as on a station, every log is read each time.
"""

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, fields
from datetime import datetime
from hashlib import blake2b
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import minihuman
from minihuman.dataset.caches import (
    CACHE_SETTINGS,
    INDEX_SCHEMA,
    TABLE_CACHE,
    connect_cache,
    describe_file,
    digest_sources,
    duckdb,
    is_in_use,
    remove_cache,
    transaction,
)
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY, SCHEMA_VERSION, STEP
from minihuman.log.paths import LOG_SUFFIX, find_log_folders, group_sessions, raise_as_log_error, require_folder


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
_SQL_TYPES: dict[Any, str] = {str: "TEXT", int: "BIGINT", bool: "BOOLEAN", float: "DOUBLE"}
_VALUES = attrgetter(*(field.name for field in fields(SessionSummary)))
_COLUMNS = dict.fromkeys(("log", "fingerprint", "path", "problem"), "TEXT") | {
    f'"{field.name}"': _SQL_TYPES[field.type] for field in fields(SessionSummary)
}
_ROW = ", ".join(_COLUMNS)  # what the digest is of
_TABLE = f"{INDEX_SCHEMA}.sessions"
_BATCH = 500  # rows in Python at once
_MAKERS = ("admin", "log/model", "log/salvage")  # the packages whose code makes the rows
LOCK_WAIT_S = 0.2  # sessions are quickly read again, and a participant waits
_Row = tuple[Any, ...]


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
    if duckdb is None:
        for _, files in sorted(_sessions_below(study)):
            problem, *values = _summary_or_problem(files, study)
            yield SessionRow(files[0], None if problem else SessionSummary(*values), problem)
        return
    with closing(_open_index(study)) as index:
        found = index.execute(f"SELECT {_ROW} FROM sessions ORDER BY log")
        while page := found.fetchmany(_BATCH):
            for _, _, path, problem, *values in page:
                yield SessionRow(study / path, None if problem else SessionSummary(*values), problem)


def compare_index(study: Path) -> Iterator[str]:
    """Yield the differences of a study's cached session index from what its logs say, one line for each session.

    Sessions that the next command would read again, since their logs changed, are not compared.
    """
    if duckdb is None or not (study / TABLE_CACHE).is_file():
        return
    below = len(os.fspath(study / "_")) - 1
    try:
        with closing(connect_cache(study / TABLE_CACHE, read_only=True)) as kept:
            known = {row[0]: row for row in kept.execute(f"SELECT {_ROW} FROM {_TABLE}").fetchall()}
    except duckdb.CatalogException:  # it has none yet
        return
    except duckdb.Error as error:
        yield f"{TABLE_CACHE}: the session index cannot be read and will be made anew: {str(error).splitlines()[0]}"
        return
    for log, files in _sessions_below(study):
        key, fingerprint = os.fspath(log)[below:], _fingerprint(files)
        there = known.get(key)
        if there is None or there[1] != fingerprint:
            continue
        row = (key, fingerprint, os.fspath(files[0])[below:], *_summary_or_problem(files, study))
        for name, cell, expected in zip(_COLUMNS, there, row, strict=True):
            if cell != expected:
                yield f"{TABLE_CACHE}: session index, {key}, {name} is {cell!r}; the logs say {expected!r}"


def _open_index(study: Path) -> "duckdb.DuckDBPyConnection":
    """Load the index into memory, bring it up to date, and store it if anything was new."""
    own = study / TABLE_CACHE
    index = duckdb.connect(config=dict(CACHE_SETTINGS))
    try:
        index.execute(f"CREATE TABLE sessions ({', '.join(map(' '.join, _COLUMNS.items()))}, digest TEXT)")
        index.execute("CREATE TABLE present (log TEXT)")
        is_usable, damaged = _load(index, own) if own.exists() else (True, 0)
        if damaged:
            what = "1 session" if damaged == 1 else f"{damaged} sessions"
            LOGGER.warning("%s was changed by another program: the rows of %s were made anew from the logs", own, what)
        if (_refresh(index, study) or damaged) and is_usable:
            _store(index, own)
    except BaseException:
        index.close()
        raise
    return index


def _load(index: "duckdb.DuckDBPyConnection", own: Path) -> tuple[bool, int]:
    """Load the rows that are as they were stored; return whether the file can be written, and how many are not."""
    try:
        with closing(connect_cache(own, read_only=True, wait_s=LOCK_WAIT_S)) as kept:
            ((damaged,),) = kept.execute(f"SELECT count(*) FROM {_TABLE}").fetchall()
            found = kept.execute(f"SELECT {_ROW}, digest FROM {_TABLE} QUALIFY count(*) OVER (PARTITION BY log) = 1")
            while page := found.fetchmany(_BATCH):
                whole = [tuple(row) for *row, digest in page if digest == _digest(tuple(row))]
                damaged -= len(whole)
                _insert(index, whole)
        return True, damaged
    except duckdb.CatalogException:  # it has no index yet
        return True, 0
    except duckdb.BinderException:  # it has other columns
        return True, 1
    except (duckdb.Error, UnicodeError) as error:
        why = " ".join(str(error).split("\n")[0].split())
        LOGGER.warning("%s cannot be used now (%s); the sessions were read from their logs for this once", own, why)
        index.execute("DELETE FROM sessions")
        if not is_in_use(error) and os.access(own, os.R_OK | os.W_OK):
            with suppress(OSError):
                remove_cache(own)
        return not own.exists(), 0


def _refresh(index: "duckdb.DuckDBPyConnection", study: Path) -> bool:
    """Read the sessions again whose row is missing or stale, forget those that are gone; return whether any was."""
    below = len(os.fspath(study / "_")) - 1  # what every path there begins with
    changed, sessions = False, _sessions_below(study)
    while batch := list(islice(sessions, _BATCH)):
        now = {os.fspath(log)[below:]: (_fingerprint(files), files) for log, files in batch}
        known = dict(
            index.execute(
                "SELECT log, fingerprint FROM sessions WHERE log IN (SELECT unnest(?))", (list(now),)
            ).fetchall()
        )
        fresh = [
            (key, fingerprint, os.fspath(files[0])[below:], *_summary_or_problem(files, study))
            for key, (fingerprint, files) in now.items()
            if known.get(key) != fingerprint
        ]
        index.execute("DELETE FROM sessions WHERE log IN (SELECT unnest(?))", ([row[0] for row in fresh],))
        _insert(index, fresh)
        index.execute("INSERT INTO present SELECT unnest(?)", (list(now),))
        changed |= bool(fresh)
    ((gone,),) = index.execute("DELETE FROM sessions WHERE log NOT IN (FROM present)").fetchall()
    return changed or gone > 0


def _store(index: "duckdb.DuckDBPyConnection", own: Path) -> None:
    """Put the index in place of that of the study's file, in one transaction, where nothing has the file open."""
    path = str(own).replace("'", "''")
    try:
        index.execute(f"ATTACH '{path}' AS kept")
        try:
            with transaction(index):
                index.execute(f"DROP SCHEMA IF EXISTS kept.{INDEX_SCHEMA} CASCADE")  # whatever is in it
                index.execute(f"CREATE SCHEMA kept.{INDEX_SCHEMA}")
                index.execute(f"CREATE TABLE kept.{_TABLE} AS FROM sessions ORDER BY log")
        finally:
            index.execute("DETACH kept")
    except duckdb.Error as error:
        LOGGER.info("%s: the session index was not stored: %s", own, error)


def _insert(index: "duckdb.DuckDBPyConnection", rows: Sequence[_Row]) -> None:
    if rows:
        values = ", ".join(f"unnest(?::{kind}[])" for kind in (*_COLUMNS.values(), "TEXT"))
        columns = zip(*((*row, _digest(row)) for row in rows), strict=True)
        index.execute(f"INSERT INTO sessions SELECT {values}", [list(column) for column in columns])


def _digest(row: _Row) -> str:
    return blake2b(repr(row).encode(), digest_size=16).hexdigest()


def _sessions_below(study: Path) -> Iterator[tuple[Path, list[Path]]]:
    for folder, names in find_log_folders(study):
        yield from group_sessions(folder, names).items()


def _fingerprint(files: list[Path]) -> str:
    return "\n".join([f"{minihuman.__version__} {digest_sources(*_MAKERS)}", *map(describe_file, files)])


def _summary_or_problem(files: list[Path], study: Path) -> tuple[Any, ...]:
    try:
        return ("", *_VALUES(summarize_session(files)))
    except LogError as error:
        return (str(error).replace(os.fspath(study / "_")[:-1], ""), *(None for _ in fields(SessionSummary)))


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
    from minihuman.log.salvage.summary_section import all_ended_cleanly, read_summary

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
    from minihuman.log.salvage.summary_section import read_summary

    for folder, names in find_log_folders(study):
        if sum(name.endswith(LOG_SUFFIX) for name in names) < 2:  # as in nearly every folder
            continue
        logs = [log for log, files in group_sessions(folder, names).items() if log in files]
        complete: dict[tuple[str, int], dict[str, Path]] = {}  # by how the log ends
        for log in logs:
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
