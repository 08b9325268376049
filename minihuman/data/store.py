"""The store: a study's tables kept beside it in ``tables.duckdb``, so that no log is read twice.

It is a cache: whenever it is asked it is first brought up to date, by comparing the sizes and times of logs and marks,
and it may be deleted at any time. What it holds is what the default selection says of every session; for another
selection, or where the file cannot be written or is another process's, the same tables are made in a temporary file.
"""

import os
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from hashlib import blake2b
from pathlib import Path
from types import TracebackType
from typing import Any

import duckdb
import msgspec
import pyarrow as pa

import minihuman
from minihuman.data.columns import TABLES, schema
from minihuman.data.counted import Account
from minihuman.data.marks import marks_path
from minihuman.data.opened import Skipped, each_log, worth_reading
from minihuman.data.rows import together
from minihuman.data.selection import Selection
from minihuman.data.study import SessionRows, Sessions, read_rows
from minihuman.errors import LogError, StoreError

FILE_NAME = "tables.duckdb"
_TOGETHER = 64  # sessions put in at once
_ROWS = 100_000  # handed out at once
_SETTINGS = {"threads": "2", "memory_limit": "512MB"}


class Kept(msgspec.Struct, frozen=True):
    """What is known of a log whose rows are kept: where it is, what counts of it, or why it cannot be read."""

    path: str
    problem: str = ""
    study: str = ""
    facts: tuple[dict[str, Any], ...] = ()  # of each episode that counts
    account: tuple[int, int, tuple[tuple[str, str, int], ...], tuple[tuple[str, str, int], ...]] = (0, 0, (), ())

    def taken(self) -> Account:
        """The account of this log alone."""
        sessions, episodes, versions, left_out = self.account
        account = Account(sessions=sessions, episodes=episodes)
        account.versions.update({(study, version): count for study, version, count in versions})
        account.left_out.update({(level, reason): count for level, reason, count in left_out})  # type: ignore[misc]
        return account


class Store:
    """The tables of a study's sessions, up to date as of when it was opened. Use it in a ``with``.

    Opening it fills the sessions' account.
    """

    def __init__(self, sessions: Sessions, *, with_shortest: bool) -> None:
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._with_shortest = with_shortest
        self._sessions = sessions
        self.kept: tuple[Kept, ...] = ()  # in order of path
        self._in_order = True
        self.path, self._tables = self._open()
        try:
            self._refresh()
        except BaseException:
            self.close()
            raise

    def batches(self, name: str, *, without: frozenset[str] = frozenset()) -> Iterator[pa.RecordBatch]:
        """One table's rows, session by session in order of path, some columns left out."""
        wanted = schema(name, without=without)
        columns = ", ".join(f'"{column}"' for column in wanted.names)
        order = "" if self._in_order else "ORDER BY (SELECT place FROM placed WHERE placed.log = rows.log), row"
        found = self._tables.execute(f"SELECT {columns} FROM kept.{name} AS rows {order}")
        for batch in found.to_arrow_reader(_ROWS):
            yield pa.RecordBatch.from_arrays(
                [array.cast(field.type) for array, field in zip(batch.columns, wanted, strict=True)], schema=wanted
            )

    def table(self, name: str, columns: Sequence[str]) -> pa.Table:
        """Some columns of a table, in the same order."""
        without = frozenset(column.name for column in TABLES[name]) - set(columns)
        return pa.Table.from_batches(self.batches(name, without=without), schema(name, without=without)).select(columns)

    def query(self, sql: str) -> pa.Table:
        """What a user's SQL says of the tables, which it cannot change.

        Raises:
            StoreError: if it is no SQL, or asks for what is not there.
        """
        self._tables.close()
        self._tables = duckdb.connect(self.path, read_only=True, config=_SETTINGS)
        try:
            return self._tables.execute(sql).to_arrow_table()
        except duckdb.Error as error:
            line = " ".join(str(error).split("\n\n")[0].split())
            raise StoreError(f"{line}; the tables are {', '.join(TABLES)}") from error

    def close(self) -> None:
        """Leave the file to others."""
        self._tables.close()
        if self._temporary is not None:
            self._temporary.cleanup()

    def __enter__(self) -> "Store":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _open(self) -> tuple[str, duckdb.DuckDBPyConnection]:
        """The study's own file if it can hold what is asked for, else one that goes away."""
        source = self._sessions.source
        if self._sessions.selection == Selection() and source.is_dir():
            for attempt in ("as it is", "anew"):
                try:
                    return str(source / FILE_NAME), _opened(source / FILE_NAME)
                except (_OfAnotherVersion, duckdb.Error) as problem:
                    if attempt == "anew" or isinstance(problem, duckdb.IOException) and _is_busy(problem):
                        break
                    _remove(source / FILE_NAME)
        self._temporary = tempfile.TemporaryDirectory(prefix="minihuman-")
        path = Path(self._temporary.name) / FILE_NAME
        return str(path), _opened(path)

    def _refresh(self) -> None:
        sessions, tables = self._sessions, self._tables
        paths, skipped = worth_reading(sessions.source)
        now = {_key(path, sessions.source): (path, _fingerprint(path)) for path in paths}
        have = {
            key: (number, fingerprint, with_shortest)
            for key, number, fingerprint, with_shortest in tables.execute(
                "SELECT key, log, fingerprint, with_shortest FROM kept.logs"
            ).fetchall()
        }
        fresh = {
            key
            for key, (_, fingerprint) in now.items()
            if key not in have or have[key][1] != fingerprint or (self._with_shortest and not have[key][2])
        }
        stale = [have[key][0] for key in have if key not in now or key in fresh]
        if stale:
            _forget(tables, stale)
        if fresh:
            self._read([now[key][0] for key in now if key in fresh], {key: now[key][1] for key in fresh})
        self._settle(list(now), skipped)

    def _read(self, paths: list[Path], fingerprints: dict[str, str]) -> None:
        sessions, tables = self._sessions, self._tables
        (number,) = tables.execute("SELECT coalesce(max(log), 0) FROM kept.logs").fetchone() or (0,)
        work = partial(read_rows, selection=sessions.selection, with_shortest=self._with_shortest)
        waiting: list[tuple[int, SessionRows]] = []
        found = each_log(paths, work, processes=sessions.processes)
        for number, (path, one) in enumerate(zip(paths, found, strict=True), number + 1):
            key = _key(path, sessions.source)
            if isinstance(one, Skipped):
                if not sessions.source.is_dir():
                    raise LogError(one.reason)
                kept = Kept(str(one.path), problem=one.reason)
            else:
                kept = _kept(one)
                waiting.append((number, one))
            row = (number, key, fingerprints[key], self._with_shortest, msgspec.msgpack.encode(kept))
            tables.execute("INSERT INTO kept.logs VALUES (?, ?, ?, ?, ?)", row)
            if len(waiting) >= _TOGETHER:
                _insert(tables, waiting)
        _insert(tables, waiting)

    def _settle(self, keys: list[str], skipped: list[Skipped]) -> None:
        """Say what is there, in order of path, and put it into the account."""
        found = {
            key: (number, msgspec.msgpack.decode(about, type=Kept))
            for key, number, about in self._tables.execute("SELECT key, log, about FROM kept.logs").fetchall()
        }
        numbers = [found[key][0] for key in keys]
        self._in_order = numbers == sorted(numbers)
        if not self._in_order:
            self._tables.execute("CREATE OR REPLACE TEMP TABLE placed (log INTEGER PRIMARY KEY, place INTEGER)")
            self._tables.executemany("INSERT INTO placed VALUES (?, ?)", [(n, at) for at, n in enumerate(numbers)])
        self.kept = tuple(found[key][1] for key in keys)
        for one in skipped:
            self._sessions.skip(one)
        for one in self.kept:
            if one.problem:
                self._sessions.skip(Skipped(Path(one.path), one.problem))
            else:
                self._sessions.account.add(one.taken())


class _OfAnotherVersion(Exception):
    """The file holds tables of other columns, or made by other software."""


def _opened(path: Path) -> duckdb.DuckDBPyConnection:
    """Open a file of this version; a new one is given its tables.

    Raises:
        _OfAnotherVersion: if it holds others.
        duckdb.Error: if it cannot be opened or written, or is no such file.
    """
    tables = duckdb.connect(str(path), config=_SETTINGS)
    try:
        there = tables.execute("SELECT table_name FROM information_schema.tables WHERE table_name = 'made_by'").fetchall()
        if not there:
            _lay_out(tables)
        elif tables.execute("SELECT version FROM kept.made_by").fetchall() != [(_version(),)]:
            raise _OfAnotherVersion
    except BaseException:
        tables.close()
        raise
    return tables


def _lay_out(tables: duckdb.DuckDBPyConnection) -> None:
    tables.execute("BEGIN; CREATE SCHEMA kept")
    tables.execute(
        "CREATE TABLE kept.logs (log INTEGER, key TEXT, fingerprint TEXT, with_shortest BOOLEAN, about BLOB)"
    )
    for name in TABLES:
        empty = schema(name).empty_table()
        tables.register("empty", empty)
        tables.execute(f"CREATE TABLE kept.{name} AS SELECT 0::INTEGER AS log, 0::INTEGER AS row, * FROM empty")
        tables.execute(f"CREATE VIEW {name} AS SELECT * EXCLUDE (log, row) FROM kept.{name}")
        tables.unregister("empty")
    tables.execute("CREATE TABLE kept.made_by (version TEXT)")
    tables.execute("INSERT INTO kept.made_by VALUES (?)", (_version(),))
    tables.execute("COMMIT")


def _version() -> str:
    """What the rows are made by: other software or other columns make others."""
    columns = repr([(name, *schema(name)) for name in TABLES])
    return f"{minihuman.__version__} {blake2b(columns.encode(), digest_size=8).hexdigest()}"


def _insert(tables: duckdb.DuckDBPyConnection, waiting: list[tuple[int, SessionRows]]) -> None:
    """Put sessions' rows in, and let go of them."""
    for name in TABLES if waiting else ():
        counts = [one.rows.count(name) for _, one in waiting]
        new = together(name, [one.rows for _, one in waiting])
        numbers = pa.array([number for (number, _), count in zip(waiting, counts, strict=True) for _ in range(count)])
        rows = pa.array([row for count in counts for row in range(count)])
        tables.register("new", new.add_column(0, "row", rows).add_column(0, "log", numbers))
        tables.execute(f"INSERT INTO kept.{name} SELECT * FROM new")
        tables.unregister("new")
    waiting.clear()


def _forget(tables: duckdb.DuckDBPyConnection, numbers: list[int]) -> None:
    for name in ("logs", *TABLES):
        tables.execute(f"DELETE FROM kept.{name} WHERE log IN (SELECT unnest(?))", (numbers,))


def _kept(one: SessionRows) -> Kept:
    account = one.account
    versions = tuple((*whose, count) for whose, count in account.versions.items())
    left_out = tuple((*why, count) for why, count in account.left_out.items())
    return Kept(
        path=str(one.path),
        study=one.plan.study,
        facts=one.facts,
        account=(account.sessions, account.episodes, versions, left_out),
    )


def _key(path: Path, source: Path) -> str:
    return str(path.relative_to(source)) if source.is_dir() else path.name


def _fingerprint(path: Path) -> str:
    """Of a log, or a session's folder of segments, and of the marks beside it."""
    folder = path if path.is_dir() else path.parent
    marks = marks_path(path)
    return "\n".join(
        f"{entry.name} {facts.st_size} {facts.st_mtime_ns}"
        for entry in sorted(os.scandir(folder), key=lambda entry: entry.name)
        if (path.is_dir() or entry.name in (path.name, marks.name)) and entry.is_file()
        for facts in [entry.stat()]
    )


def _is_busy(problem: duckdb.Error) -> bool:
    """Whether a file is another process's, or may not be written, rather than broken."""
    return any(word in str(problem) for word in ("lock", "Permission", "Read-only", "read-only"))


def _remove(path: Path) -> None:
    for one in (path, path.with_name(f"{path.name}.wal")):
        one.unlink(missing_ok=True)
