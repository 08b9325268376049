"""The session index of a study: one row per session, cached so that no unchanged log is read twice.

The index is a table of the study's cache, ``tables.duckdb``, which may be deleted at any time. Each query loads it into
memory in packed form, brings it up to date there and stores what changed. A session is read again if the size, time,
beginning or end of its files changed, or if its row does not match the stored digest. The file is open only while rows
are loaded or stored; if it is in use or cannot be written, the index is rebuilt for this query alone. A row takes half
a kilobyte of memory, and rows are yielded one by one. The code that reads messages is imported only if the end of a log
does not hold enough. Without DuckDB, as on a station, every log is read each time.
"""

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, fields
from datetime import datetime
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import msgspec

import minihuman
from minihuman.admin.session_summary import SessionSummary
from minihuman.dataset.caches import (
    INDEX_SCHEMA,
    TABLE_CACHE,
    connect_cache,
    describe_file,
    digest_sources,
    duckdb,
    is_in_use,
    is_same_content,
    read_checked,
    remove_cache,
    transaction,
    write_checked,
)
from minihuman.errors import LogError
from minihuman.log.names import CHAIN_KEY, PLAIN_SCHEMA_VERSION, SCHEMA_VERSION, STEP
from minihuman.log.paths import (
    LOG_SUFFIX,
    LogFolders,
    find_log_folders,
    group_sessions,
    is_plain_log_name,
    raise_as_log_error,
    require_folder,
)

LOGGER = logging.getLogger("minihuman")
_SQL_TYPES: dict[Any, str] = {str: "TEXT", int: "BIGINT", bool: "BOOLEAN", float: "DOUBLE"}
_VALUES = attrgetter(*(field.name for field in fields(SessionSummary)))
_COLUMNS = dict.fromkeys(("log", "fingerprint", "path", "problem"), "TEXT") | {
    f'"{field.name}"': _SQL_TYPES[field.type] for field in fields(SessionSummary)
}
_ROW = ", ".join(_COLUMNS)  # the columns that the digest covers
_TABLE = f"{INDEX_SCHEMA}.sessions"
_MADE_BY = f"{INDEX_SCHEMA}.made_by"
_BATCH = 500  # rows fetched or inserted at once
_MAKERS = ("admin", "log/model", "log/salvage")  # the packages whose code makes the rows
LOCK_WAIT_S = 0.2  # short, since a participant may wait and logs are quickly read again
_Rows = dict[str, tuple[str, bytes]]  # by log: its fingerprint, and all else as MessagePack, a fifth of objects' memory
_Storing = Literal["never", "anew", "added"]  # how to store rows: not at all, as a new index, or in the existing one


@dataclass(frozen=True, slots=True)
class SessionRow:
    """One session of a study: its path, and its summary or the reason why it cannot be read."""

    path: Path  # the finished log; if there is none yet, the live or cut-off segment
    summary: SessionSummary | None  # None if the log cannot be read
    problem: str  # why it cannot be read; "" if it can


def read_session_index(study: Path, folders: LogFolders | None = None) -> Iterator[SessionRow]:
    """Yield a row for every session log below a folder, in the order of paths; unreadable ones state the problem.

    Args:
        study: the study's folder.
        folders: the result of a ``find_log_folders`` call for the folder that was made just before, if any.

    Raises:
        LogError: if the folder does not exist.
    """
    require_folder(study, instead="a study's folder, or a session log's own")
    cache = study / TABLE_CACHE
    rows, storing, n_damaged = _load_rows(cache)
    if n_damaged:
        sessions = "1 session" if n_damaged == 1 else f"{n_damaged} sessions"
        LOGGER.warning(
            "%s was changed by another program: the rows of %s were made anew from the logs", cache, sessions
        )
        storing = "anew"
    fresh, gone = _refresh_rows(rows, study, folders)
    if n_damaged or fresh or gone:
        _store_rows(cache, rows, fresh, gone, storing)
    for key in sorted(rows):
        _, packed = rows[key]
        path, problem, *fields = msgspec.msgpack.decode(packed)
        if problem:
            yield SessionRow(study / path, None, problem)
        else:
            yield SessionRow(study / path, SessionSummary(*fields), problem)


def compare_index(study: Path) -> Iterator[str]:
    """Yield the differences of a study's cached session index from its logs, one line for each difference.

    Sessions whose logs have changed are not compared, because the next command reads them again.
    """
    if duckdb is None or not (study / TABLE_CACHE).is_file():
        return
    try:
        with closing(connect_cache(study / TABLE_CACHE, read_only=True)) as connection:
            if connection.execute(f"FROM {_MADE_BY}").fetchall() != [(_identify_software(),)]:
                return
            cached_rows = {row[0]: row for row in connection.execute(f"SELECT {_ROW} FROM {_TABLE}").fetchall()}
    except duckdb.CatalogException:  # it has none yet
        return
    except duckdb.Error as error:
        first_line = str(error).splitlines()[0]
        yield f"{TABLE_CACHE}: the session index cannot be read and will be made anew: {first_line}"
        return
    prefix_length = _measure_prefix(study)
    for log, files in _group_sessions_below(find_log_folders(study)):
        key = os.fspath(log)[prefix_length:]
        if key not in cached_rows:
            continue
        cached_row = cached_rows[key]
        cached_key, fingerprint, *_ = cached_row
        if not is_same_content(fingerprint or "", _fingerprint_files(files, fingerprint or "")):
            continue
        first_file = os.fspath(files[0])[prefix_length:]
        row = (cached_key, fingerprint, first_file, *_summarize_as_row(files, study))
        for name, cell, expected in zip(_COLUMNS, cached_row, row, strict=True):
            if cell != expected:
                yield f"{TABLE_CACHE}: session index, {key}, {name} is {cell!r}; the logs say {expected!r}"


def _measure_prefix(study: Path) -> int:
    """Return the number of characters at the start of a path in the study that precede its path within the study."""
    return len(os.fspath(study / "_")) - len("_")


def _load_rows(cache: Path) -> tuple[_Rows, _Storing, int]:
    """Load the intact rows of the index.

    Returns:
        The rows, empty if there is no index that can be used; how to store new rows; and how many rows another program
        changed.
    """
    rows = _Rows()
    if duckdb is None:
        return rows, "never", 0
    if not cache.exists():
        return rows, "anew", 0
    try:
        with closing(connect_cache(cache, read_only=True, wait_s=LOCK_WAIT_S)) as connection:
            if connection.execute(f"FROM {_MADE_BY}").fetchall() != [(_identify_software(),)]:
                return rows, "anew", 0
            ((n_stored,),) = connection.execute(f"SELECT count(*) FROM {_TABLE}").fetchall()
            intact_rows = connection.execute(
                f"SELECT {_ROW} FROM {_TABLE} WHERE digest = hash({_ROW})::TEXT "
                "QUALIFY count(*) OVER (PARTITION BY log) = 1"
            )
            while page := intact_rows.fetchmany(_BATCH):
                rows.update((key, (fingerprint, msgspec.msgpack.encode(row))) for key, fingerprint, *row in page)
        return rows, "added", n_stored - len(rows)
    except duckdb.CatalogException:  # it has no index yet
        return rows, "anew", 0
    except duckdb.BinderException:  # it has other columns, so another program changed it
        return rows, "anew", 1
    except (duckdb.Error, UnicodeError) as error:
        return _Rows(), _handle_unusable_index(cache, error), 0


def _handle_unusable_index(cache: Path, error: Exception) -> _Storing:
    """Warn that the index cannot be used, remove it if it is broken, and return how to store new rows.

    Args:
        cache: the file of the study's cache.
        error: the error that reading the index raised.
    """
    first_line, *_ = str(error).split("\n")
    reason = " ".join(first_line.split())
    LOGGER.warning("%s cannot be used now (%s); the sessions were read from their logs for this once", cache, reason)
    if not is_in_use(error) and os.access(cache, os.R_OK | os.W_OK):
        with suppress(OSError):
            remove_cache(cache)
    return "never" if cache.exists() else "anew"


def _refresh_rows(rows: _Rows, study: Path, folders: LogFolders | None) -> tuple[list[str], list[str]]:
    """Update rows in place: read sessions whose row is missing or stale, and drop rows whose log is gone.

    Args:
        rows: the rows, by the key of their session.
        study: the study's folder.
        folders: the folders with logs, each with its file names; None to search for them.

    Returns:
        The keys of the sessions that were read, and the keys of the rows that were dropped.
    """
    prefix_length = _measure_prefix(study)
    fresh = list[str]()
    gone = list[str]()
    n_sessions = 0
    if folders is None:
        folders = find_log_folders(study)
    for log, files in _list_session_files(folders):
        n_sessions += 1
        key = log[prefix_length:]
        cached_fingerprint, _ = rows.get(key, ("", b""))
        fingerprint = _fingerprint_files(files, cached_fingerprint)
        if not is_same_content(fingerprint, cached_fingerprint):
            row = (files[0][prefix_length:], *_summarize_as_row([Path(file) for file in files], study))
            rows[key] = (fingerprint, msgspec.msgpack.encode(row))
            fresh.append(key)
    if len(rows) > n_sessions:
        present = {os.fspath(log)[prefix_length:] for log, _ in _group_sessions_below(find_log_folders(study))}
        gone = sorted(rows.keys() - present)
        for key in gone:
            del rows[key]
    return fresh, gone


def _store_rows(cache: Path, rows: _Rows, fresh: Sequence[str], gone: Sequence[str], storing: _Storing) -> None:
    """Write new and changed rows into the study's cache in one transaction, unless another process has it open.

    Args:
        cache: the study's cache.
        rows: all rows, by the key of their session.
        fresh: the keys of new and changed rows.
        gone: the keys of sessions whose rows are to be deleted.
        storing: how to store rows.
    """
    if storing == "never":
        return
    try:
        with closing(connect_cache(cache, wait_s=0)) as connection:
            checked = read_checked(cache)
            with transaction(connection):
                _write_rows(connection, rows, fresh, gone, is_new=storing == "anew")
            connection.execute("CHECKPOINT")
            if checked:
                write_checked(cache, checked)
    except duckdb.Error as error:
        LOGGER.info("%s: the session index was not stored: %s", cache, error)


def _write_rows(
    connection: "duckdb.DuckDBPyConnection", rows: _Rows, fresh: Sequence[str], gone: Sequence[str], *, is_new: bool
) -> None:
    """Write new and changed rows, and delete rows whose session is gone.

    Args:
        connection: the connection to the study's cache.
        rows: all rows, by the key of their session.
        fresh: the keys of the rows to write.
        gone: the keys of the rows to delete.
        is_new: whether to begin a new index and write all rows.
    """
    if is_new:
        _create_index(connection)
        fresh = sorted(rows)
    else:
        connection.execute(f"DELETE FROM {_TABLE} WHERE log IN (SELECT unnest(?))", ([*fresh, *gone],))
    unnested = ", ".join(f"unnest(?::{kind}[]) AS {name}" for name, kind in _COLUMNS.items())
    for first in range(0, len(fresh), _BATCH):
        keys = fresh[first : first + _BATCH]
        new_rows = [(key, rows[key][0], *msgspec.msgpack.decode(rows[key][1])) for key in keys]
        columns = [list(column) for column in zip(*new_rows, strict=True)]
        connection.execute(f"INSERT INTO {_TABLE} SELECT *, hash({_ROW})::TEXT FROM (SELECT {unnested})", columns)


def _create_index(connection: "duckdb.DuckDBPyConnection") -> None:
    """Create an empty index; an existing one is deleted."""
    columns = ", ".join(f"{name} {kind}" for name, kind in _COLUMNS.items())
    connection.execute(f"DROP SCHEMA IF EXISTS {INDEX_SCHEMA} CASCADE")
    connection.execute(f"CREATE SCHEMA {INDEX_SCHEMA}")
    connection.execute(f"CREATE TABLE {_MADE_BY} AS SELECT ?::TEXT AS software", (_identify_software(),))
    connection.execute(f"CREATE TABLE {_TABLE} ({columns}, digest TEXT)")


def _identify_software() -> str:
    """Return a text that identifies the software that builds the rows and their digests; other rows are rebuilt."""
    return f"{minihuman.__version__} duckdb {duckdb.__version__} {digest_sources(*_MAKERS)}"


def _group_sessions_below(folders: LogFolders) -> Iterator[tuple[Path, list[Path]]]:
    for folder, names in folders:
        yield from group_sessions(folder, names).items()


def _list_session_files(folders: LogFolders) -> Iterator[tuple[str, list[str]]]:
    """Yield the path of each session's log and those of its files, as strings.

    With ``Path`` objects, a large study would take twice the time.
    """
    for folder, names in folders:
        candidates = [name for name in names if LOG_SUFFIX in name]
        if len(candidates) == 1 and is_plain_log_name(candidates[0]):
            log = os.path.join(folder, candidates[0])
            yield log, [log]
            continue
        for path, files in group_sessions(folder, names).items():
            yield os.fspath(path), [os.fspath(file) for file in files]


def _fingerprint_files(files: Sequence[Path | str], cached: str) -> str:
    """Return a text that changes when the contents of files change.

    Args:
        files: the files of a session.
        cached: an earlier text for these files, which may save reading them; "" for none.
    """
    return "\n".join(describe_file(file, known=cached) for file in files)


def _summarize_as_row(files: list[Path], study: Path) -> tuple[Any, ...]:
    """Return a session's problem and summary as the cells of a row.

    Args:
        files: the session's log and segments, in order.
        study: the study's folder; the problem names paths within it.

    Returns:
        "" and the fields of ``SessionSummary``; or, if the log cannot be read, the reason and None for each field.
    """
    try:
        return ("", *_VALUES(summarize_session(files)))
    except LogError as error:
        path_prefix = os.fspath(study / "_")[: -len("_")]
        return (str(error).replace(path_prefix, ""), *(None for _ in fields(SessionSummary)))


def summarize_session(files: Sequence[Path]) -> SessionSummary:
    """Summarize a session from its log and segments, given in order.

    A finished log is summarized from the metadata at its end if they suffice; other logs are read completely.

    Raises:
        LogError: if a file cannot be opened, is not a session log, has another schema version, is damaged, or holds no
            plan.
    """
    with raise_as_log_error(files[0]):
        summary = _summarize_finished(files[0]) if len(files) == 1 else None
        if summary is None:
            from minihuman.admin.log_info import summarize_from_messages  # all that reads messages: rarely needed

            summary = summarize_from_messages(files)
        datetime.fromisoformat(summary.started_at)  # raises if damaged, since metadata have no checksum
        return summary


_SUMMARIZED_VERSIONS = {
    str(version) for version in range(PLAIN_SCHEMA_VERSION, SCHEMA_VERSION + 1)
}  # versions whose logs have the summary's facts at their end


def _summarize_finished(log: Path) -> SessionSummary | None:
    """Summarize a log from its metadata; return None if they do not suffice, so that the messages must be read.

    They do not suffice if the ends of segments lack facts, as in logs of earlier versions, or if all episodes were
    played but the session did not end as complete: only the messages show what was left.
    """
    from minihuman.log.salvage.summary_section import all_ended_cleanly, read_summary

    contents = read_summary(log)
    if contents is None or not contents.starts:
        return None
    if not len(contents.starts) == len(contents.facts) == len(contents.ends):
        return None
    first = contents.starts[0]
    last = contents.ends[-1]
    if first.get("schema_version") not in _SUMMARIZED_VERSIONS or "completed" not in last:
        return None
    reason = last["reason"]
    n_planned = int(last["planned"])
    n_completed = int(last["completed"])
    if reason != "complete" and 0 < n_planned == n_completed:
        return None
    duration_ns = sum(int(end.get("lasted_ns", 0)) for end in contents.ends)
    return SessionSummary(
        study=first["study"],
        participant=first["participant"],
        group=first["group"],
        session=int(first["session"]),
        player=contents.facts[0].get("player", "unknown"),
        started_at=first["started_at"],
        segments=len(contents.starts),
        clean=all_ended_cleanly(contents.starts, contents.ends),
        end_reason=reason,
        episodes_planned=n_planned,
        episodes_completed=n_completed,
        steps=contents.counts[STEP],
        duration_s=duration_ns / 1e9,
        complete=reason == "complete",
    )


def find_double_sessions(folders: LogFolders) -> Iterator[str]:
    """Yield a line for each session that was completed twice, by two servers of an earlier version without leases.

    Copies of one log do not count.

    Args:
        folders: the folders to search, each with its file names.
    """
    from minihuman.log.salvage.summary_section import read_summary

    for folder, names in folders:
        if sum(name.endswith(LOG_SUFFIX) for name in names) < 2:  # as in nearly every folder
            continue
        logs = [log for log, files in group_sessions(folder, names).items() if log in files]
        logs_by_end: dict[tuple[str, int], dict[str, Path]] = {}  # of each completed session: a log for each end
        for log in logs:
            try:
                contents = read_summary(log)
                summary = summarize_session([log])
            except LogError:  # reported elsewhere
                continue
            if contents is not None and summary.complete:
                ends = logs_by_end.setdefault((summary.participant, summary.session), {})
                ends.setdefault(contents.ends[-1].get(CHAIN_KEY, summary.started_at), log)
        for (participant, session), ends in logs_by_end.items():
            if len(ends) > 1:
                paths = ", ".join(str(log) for log in ends.values())
                yield f"{participant} completed session {session} {len(ends)} times: {paths}; keep one in the study"
