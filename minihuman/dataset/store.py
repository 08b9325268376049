"""The study store: all tables in one DuckDB file, ``tables.duckdb``, so that no log is read twice; and query results
as text.

It is a cache, and may be deleted at any time. Every use first brings it up to date: a session is read again if the
size, time, beginning or end of its log or annotations changed, or if its rows in a table that is to be read do not have
the digest that was stored with them. The digests are compared once: ``tables.duckdb.checked`` beside it says of which
tables, and of which file, by its size, times, beginning and end; DuckDB counts every change at the beginning. Rows and
digests change in one transaction, so that a process that is killed leaves the session either whole or to be read again.
Edits that also forge the digests are found by ``verify --tables``, which recomputes every table from the logs.

It holds the tables under the default selection. For another selection, or where the file cannot be written (disk full,
no permission, locked by another process), the same tables are made in a temporary file; the latter is said. It is a
file, not memory, because a thousand sessions would need gigabytes.
"""

import io
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from hashlib import blake2b
from itertools import groupby, islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import duckdb
import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.csv

import minihuman
from minihuman.dataset.activity_tables import list_table_sources
from minihuman.dataset.annotations import annotations_path
from minihuman.dataset.caches import (
    CACHE_SETTINGS,
    IN_USE_ERRORS,
    INDEX_SCHEMA,
    TABLE_CACHE as FILE_NAME,
    connect_cache,
    describe_cache,
    describe_file,
    digest_files,
    digest_sources,
    is_same_content,
    read_checked,
    remove_cache,
    transaction,
    write_checked,
)
from minihuman.dataset.log_files import (
    SkippedLog,
    infrequent_collection,
    list_readable_logs,
    map_logs,
    name_paths_from,
)
from minihuman.dataset.recording_quality import PlanOutline, RecordingQuality
from minihuman.dataset.rows import RowBatch, SessionTables, arrow_columns, arrow_schema, as_int64
from minihuman.dataset.selection import Selection, SelectionSummary, find_practice_blocks
from minihuman.dataset.session_measures import average_path_measures, compare_with_shortest_path, find_layout_bounds
from minihuman.dataset.sessions import SessionRows, StudySessions, read_session_rows
from minihuman.dataset.table_catalogue import TABLES, is_episode_table
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, use_current_columns
from minihuman.errors import LogError, QueryError
from minihuman.log.salvage.summary_section import read_first_metadata

_ROWS = 100_000  # handed out at once
_QUERY_SETTINGS = {  # SQL reads the tables: no files, no network, no variables of this program
    **CACHE_SETTINGS,
    "threads": "2",
    "enable_external_access": "false",
    "python_enable_replacements": "false",
    "lock_configuration": "true",
}
_DIGEST_MODULUS = 2**64
_SESSIONS_PER_UPDATE = 1_000
_MAX_OPENINGS = 5  # to look, to write, to read; another command may write meanwhile
_SESSIONS_PER_COMMIT = 384  # what is left of a piece of the file is written once more then
_ROWS_PER_INSERT = 50_000  # of a table; fewer are slower, more take more memory
_READING = frozenset(f"StatementType.{name}" for name in ("SELECT", "EXPLAIN", "PRAGMA", "MULTI"))  # MULTI: PIVOT
_MAKERS = ("dataset", "log/model")  # the packages whose code makes the rows, beside the modules of activities' tables
_ROW_DIGESTS = pa.schema([("log", pa.int32()), ("row_digests", pa.list_(pa.uint64()))])
_COUNTED_BY = ("episodes", "participants")  # the tables whose exclusion reasons say what counts in all others
_PLANNED = {
    "episodes": "row",
    "blocks": "block",
    "participants": "log",
}  # tables with world columns, and their rows' key
LOG_COLUMNS = "log, key, fingerprint, with_shortest, row_digests, metadata, about, facts"


class StoreVersionError(Exception):
    """A file holds tables of other columns, or made by other software."""


class CatalogueChangedError(Exception):
    """A file's tables, views or macros are not those that were laid out."""


def find_queried_tables(sql: str) -> frozenset[str]:
    """The tables that a query reads; all of them if the query alone does not tell."""
    try:
        with duckdb.connect(config=dict(_QUERY_SETTINGS)) as parser:
            names = frozenset(name.lower() for name in parser.get_table_names(sql))
    except duckdb.Error:
        return frozenset(TABLES)
    is_computed = "query" in sql.lower()  # the functions query() and query_table() take names that are computed
    return frozenset(TABLES) if is_computed else names & TABLES.keys()


def needs_shortest_paths(sql: str) -> bool:
    """Whether a query may read a column that takes the worlds themselves; True if the query alone does not tell."""
    names = find_queried_tables(sql)
    if not any(has_world_columns(name) for name in names):
        return False
    if "query" in sql.lower():  # a text that is a query
        return True
    try:
        with duckdb.connect(config=dict(_QUERY_SETTINGS)) as parser:
            ((tree,),) = parser.execute("SELECT json_serialize_sql(?::VARCHAR)", (use_current_columns(sql),)).fetchall()
    except duckdb.Error:
        return True
    nodes = list(_walk(msgspec.json.decode(tree)))
    whole_rows = {str(node[key]).lower() for node in nodes for key in ("alias", "table_name") if node.get(key)}
    return any(
        node.get("error")
        or node.get("class") in ("STAR", "POSITIONAL_REFERENCE")
        or node.get("type") == "PIVOT"
        or (
            isinstance(parts := node.get("column_names"), list)
            and (parts[-1].lower() in COLUMNS_NEEDING_WORLD or parts[-1].lower() in whole_rows)
        )
        for node in nodes
    )


def _walk(tree: Any) -> Iterator[dict[str, Any]]:
    """Every object of a JSON document."""
    if isinstance(tree, dict):
        yield tree
    for part in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        yield from _walk(part)


def has_world_columns(name: str) -> bool:
    """Whether a table has columns that take the worlds themselves."""
    return any(column.name in COLUMNS_NEEDING_WORLD for column in TABLES[name])


class TableDatabase(AbstractContextManager["TableDatabase", None]):
    """The tables of some sessions, each under a number of its own. Use it in a ``with``.

    Args:
        path: the file.
        read_only: leave the file as it is.

    Raises:
        StoreVersionError: if the file holds others.
        CatalogueChangedError: if its tables, views or macros were changed.
        duckdb.Error: if it cannot be opened or written, or is no such file.
    """

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open a file; a new one is given its tables."""
        self.path = path
        self.order: tuple[int, ...] | None = None  # of the sessions' numbers; None: as they were put in
        self.checked: frozenset[str] = frozenset(TABLES)  # tables that may be read: their digests were compared
        self.read_only = read_only
        self.connection = connect_cache(path, read_only=read_only)
        try:
            there = self.connection.execute("SELECT 1 FROM duckdb_tables() WHERE table_name = 'made_by'").fetchall()
            if not there:
                if read_only:  # it has the session index alone
                    raise StoreVersionError
                self._lay_out()
            else:
                made_by = self.connection.execute("SELECT version, catalogue FROM kept.made_by").fetchall()
                if [version for version, _ in made_by] != [software_digest()]:
                    raise StoreVersionError
                if made_by[0][1] != self._digest_catalogue():
                    raise CatalogueChangedError
        except BaseException:
            self.connection.close()
            raise

    def insert(self, sessions: Iterable[tuple[int, SessionTables]]) -> dict[int, list[int]]:
        """Put sessions' rows in, and give the digests of each session's rows, in the order of ``TABLES``."""
        digests: dict[int, list[int]] = {}
        waiting: dict[str, dict[int, RowBatch]] = {name: {} for name in TABLES}
        for number, rows in sessions:
            digests[number] = [0] * len(TABLES)
            for name, its in waiting.items():
                if rows.count(name):
                    its[number] = rows.parts[name]
                if sum(part.count for part in its.values()) >= _ROWS_PER_INSERT:
                    self._insert(name, its, digests)
        for name, its in waiting.items():
            self._insert(name, its, digests)
        return digests

    def _insert(self, name: str, parts: dict[int, RowBatch], digests: Mapping[int, list[int]]) -> None:
        """Put some sessions' rows of a table in, note their digests, and forget them."""
        if not parts:
            return
        counts = [part.count for part in parts.values()]
        numbers = np.repeat(list(parts), counts), np.concatenate([np.arange(count) for count in counts])
        columns = [*map(as_int64, numbers), *arrow_columns(name, list(parts.values()))]
        # no view, which would keep them in memory until the transaction ends
        new = self.connection.from_arrow(pa.Table.from_arrays(columns, ["log", "row", *arrow_schema(name).names]))
        for number, digest in new.aggregate(_row_digest(name), "log").fetchall():
            digests[number][list(TABLES).index(name)] = digest
        new.insert_into(f"kept.{name}")
        parts.clear()

    def add_path_measures(self, numbers: Sequence[int], practice: Mapping[int, Collection[str]]) -> None:
        """Fill in the columns that take the worlds, from the rows alone.

        Args:
            numbers: of sessions that no rule excludes: others' rows do not tell which episodes count.
            practice: each session's blocks that are not analysed.
        """
        found = self.connection.execute(
            "SELECT log, e.row, e.block, steps, e.max_steps, outcome, exclusion_reason IS NULL AS counts, p.world, "
            "options, p.seed FROM kept.episodes e JOIN kept.plan p USING (log, episode) "
            "WHERE log IN (SELECT unnest(?)) ORDER BY log, e.row",
            (list(numbers),),
        )
        names = [column[0] for column in found.description]
        new: dict[str, list[dict[str, Any]]] = {name: [] for name in _PLANNED}
        means: dict[str, dict[tuple[int, str], list[dict[str, Any]]]] = {"blocks": {}, "participants": {}}
        for values in found.fetchall():
            row = dict(zip(names, values, strict=True))
            least = find_layout_bounds(row["world"], row["options"], row["seed"])
            row |= compare_with_shortest_path(row, least)
            new["episodes"].append(row)
            log, block = row["log"], row["block"]
            of_block = means["blocks"].setdefault((log, block), [])
            of_session = means["participants"].setdefault((log, ""), [])
            if row["counts"]:
                of_block.append(row)
                if block not in practice[log]:
                    of_session.append(row)
        for name, groups in means.items():
            new[name] = [
                {"log": log, "block": block, **average_path_measures(rows)} for (log, block), rows in groups.items()
            ]
        for name, key in _PLANNED.items():
            if not new[name]:  # none of these sessions had an episode
                continue
            changed = [column for column in arrow_schema(name).names if column in COLUMNS_NEEDING_WORLD]
            assigned = ", ".join(f'"{column}" = new."{column}"' for column in changed)
            found_out = pa.Table.from_pylist(new[name]).select(list({"log", key}) + changed)  # noqa: F841 - SQL reads it
            self.connection.execute(
                f"UPDATE kept.{name} SET {assigned} FROM found_out AS new "
                f"WHERE {name}.log = new.log AND {name}.{key} = new.{key}"
            )

    def remove(self, numbers: Sequence[int]) -> None:
        """Take sessions' rows out."""
        for name in TABLES:
            self.connection.execute(f"DELETE FROM kept.{name} WHERE log IN (SELECT unnest(?))", (list(numbers),))

    def digest_rows(self, name: str, *, without: frozenset[str] = frozenset()) -> dict[int, int]:
        """The digest of each session's rows in a table, of those that have any, some columns excluded.

        Any edit changes it. Equal rows have equal digests, whatever the session's number.
        """
        digests = _row_digest(name, without=without)
        return dict(self.connection.sql(f"FROM kept.{name}").aggregate(digests, "log").fetchall())

    def find_changed(self, name: str) -> set[int]:
        """The sessions whose rows in a table are not those that were put in; those of no session among them."""
        place = list(TABLES).index(name) + 1
        found = self.connection.execute(
            f"SELECT log FROM (SELECT {_row_digest(name)} FROM kept.{name} GROUP BY log) AS held "
            "FULL JOIN (SELECT log, row_digests FROM kept.logs) AS stored USING (log) "
            f"WHERE coalesce(held.digest, 0) IS DISTINCT FROM stored.row_digests[{place}]"
        )
        return {log for (log,) in found.fetchall()}

    def _digest_catalogue(self) -> str:
        """Digest the definitions of all tables, views and macros, any of which could stand for one of ours.

        But for the session index, which is made anew whatever is in its schema.
        """
        found = self.connection.execute(
            f"SELECT schema_name || table_name || sql FROM duckdb_tables() WHERE schema_name <> '{INDEX_SCHEMA}' "
            "UNION ALL "
            "SELECT schema_name || view_name || sql FROM duckdb_views() WHERE NOT internal UNION ALL "
            "SELECT schema_name || function_name || macro_definition FROM duckdb_functions() WHERE NOT internal "
            "ORDER BY 1"
        ).fetchall()
        return blake2b(repr(found).encode(), digest_size=16).hexdigest()

    def put_in_order(self, numbers: Sequence[int]) -> None:
        """Say in which order sessions are to be handed out."""
        if list(numbers) == sorted(numbers):
            self.order = None
            return
        self.order = tuple(numbers)
        self.connection.execute("CREATE OR REPLACE TEMP TABLE placed (log INTEGER, place INTEGER)")
        columns = (np.array(numbers), np.arange(len(numbers)))
        placed = pa.Table.from_arrays([as_int64(column) for column in columns], ["log", "place"])
        self.connection.from_arrow(placed).insert_into("placed")

    def batches(
        self, name: str, *, without: frozenset[str] = frozenset(), counting: bool = False
    ) -> Iterator[pa.RecordBatch]:
        """One table's rows, session by session, some columns excluded; only a few are in memory at a time.

        All but the last batch have the same number of rows, whatever was put in and taken out before: equal rows make
        equal files.

        ``counting`` leaves out what does not count, and what belongs to an episode or a session that does not.
        """
        self._require_checked({name, *(_COUNTED_BY if counting else ())})
        wanted = arrow_schema(name, without=without)
        columns = ", ".join(f'"{column}"' for column in wanted.names)
        found = f"FROM kept.{name}"
        if counting and "exclusion_reason" in arrow_schema(name).names:
            found += f" SEMI JOIN (SELECT log, row FROM kept.{name} WHERE exclusion_reason IS NULL) USING (log, row)"
        elif counting and is_episode_table(name):
            theirs = "SELECT log, episode, attempt FROM kept.episodes WHERE exclusion_reason IS NULL"
            found += f" SEMI JOIN ({theirs}) USING (log, episode, attempt)"
        elif counting:
            found += " SEMI JOIN (SELECT log FROM kept.participants WHERE exclusion_reason IS NULL) USING (log)"
        if counting or self.order is not None:
            order, place = ("JOIN placed USING (log)", "place") if self.order is not None else ("", "log")
            found += f" {order} ORDER BY {place}, row"
        for batch in _even(self.connection.sql(f"SELECT {columns} {found}").to_arrow_reader(_ROWS)):
            yield _cast(batch, wanted)

    def session_batches(
        self, name: str, numbers: Sequence[int], *, without: frozenset[str] = frozenset()
    ) -> Iterator[tuple[int, Iterator[pa.RecordBatch]]]:
        """One table's rows of some sessions, session by session, some columns excluded; others are not read.

        Use up a session's batches before the next session's. As in ``batches``, equal rows make equal batches.
        """
        self._require_checked({name})
        wanted = arrow_schema(name, without=without)
        columns = ", ".join(f'"{column}"' for column in wanted.names)
        logs = ", ".join(map(str, numbers))
        found = self.connection.sql(f"SELECT log, {columns} FROM kept.{name} WHERE log IN ({logs}) ORDER BY log, row")
        parts = (part for batch in found.to_arrow_reader(_ROWS) for part in _split_sessions(batch))
        for number, theirs in groupby(parts, key=lambda part: int(part.column(0)[0].as_py())):
            yield number, (_cast(batch, wanted) for batch in _even(part.select(wanted.names) for part in theirs))

    def table(self, name: str, columns: Sequence[str] | None = None, *, counting: bool = False) -> pa.Table:
        """A table, or some columns of it; ``counting`` as in ``batches``."""
        names = [column.name for column in TABLES[name]]
        without = frozenset(names) - set(names if columns is None else columns)
        table = pa.Table.from_batches(
            self.batches(name, without=without, counting=counting), arrow_schema(name, without=without)
        )
        return table if columns is None else table.select(columns)

    def count(self, name: str) -> int:
        """How many rows a table has."""
        self._require_checked({name})
        counted = self.connection.execute(f"SELECT count(*) FROM kept.{name}").fetchall()
        return int(counted[0][0])

    def query(self, sql: str) -> pa.Table:
        """Answer SQL about the tables, by present or earlier column names. It reads and writes no other file.

        Raises:
            QueryError: if it is no SQL, or asks for what is not there.
        """
        self._require_checked(find_queried_tables(sql))
        self.connection.close()
        self.connection = connect_cache(self.path, read_only=True, settings=_QUERY_SETTINGS)
        try:
            if any(str(each.type) not in _READING for each in self.connection.extract_statements(sql)):
                raise QueryError(f"{sql!r} is not a SELECT statement; use SELECT to read the study's tables")
            try:
                found = self.connection.sql(sql)
            except duckdb.BinderException:
                found = self.connection.sql(use_current_columns(sql))
            if found is None:
                raise QueryError(f"{sql!r} returns no rows; a query must be a SELECT over the study's tables")
            return found.to_arrow_table()
        except duckdb.PermissionException as error:
            raise QueryError(f"{sql!r} uses a file; a query may only read the study's tables") from error
        except duckdb.Error as error:
            line = " ".join(str(error).split("\n\n")[0].split())
            raise QueryError(f"the query failed: {line}; the tables are {', '.join(TABLES)}") from error

    def _require_checked(self, names: Collection[str]) -> None:
        if unchecked := set(names) - self.checked:
            raise AssertionError(f"the store was not opened for {', '.join(sorted(unchecked))}")

    def close(self) -> None:
        """Leave the file to others."""
        self.connection.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _lay_out(self) -> None:
        with transaction(self.connection):
            self.connection.execute("CREATE SCHEMA kept")
            for name in TABLES:
                empty = self.connection.from_arrow(pa.Table.from_batches([], arrow_schema(name)))
                empty.project("0::INTEGER AS log, 0::INTEGER AS row, *").to_table(f"kept.{name}")
                self.connection.execute(f"ALTER TABLE kept.{name} ALTER log SET NOT NULL")
                columns = ", ".join(f'"{column.name}"' for column in TABLES[name])
                self.connection.execute(f"CREATE VIEW {name} AS SELECT {columns} FROM kept.{name}")
            self.connection.execute(
                "CREATE TABLE kept.logs (log INTEGER NOT NULL, key TEXT, fingerprint TEXT, with_shortest BOOLEAN, "
                "row_digests UBIGINT[], metadata BLOB, about BLOB, facts BLOB, digest UBIGINT)"
            )
            self.connection.execute("CREATE TABLE kept.made_by (version TEXT, catalogue TEXT)")
            made_by = (software_digest(), self._digest_catalogue())
            self.connection.execute("INSERT INTO kept.made_by VALUES (?, ?)", made_by)


def _row_digest(name: str, *, without: frozenset[str] = frozenset()) -> str:
    """The columns of a query that digests a table's rows by session."""
    columns = ", ".join(f'"{column}"' for column in arrow_schema(name, without=without).names)
    return f"log, (sum(hash(row::BIGINT, {columns})) % {_DIGEST_MODULUS})::UBIGINT AS digest"


def _even(found: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """The same rows in batches of ``_ROWS``: DuckDB's own follow where its file has gaps."""
    waiting: list[pa.RecordBatch] = []
    for batch in found:
        waiting.append(batch)
        if sum(map(len, waiting)) >= _ROWS:
            whole = _one(waiting)
            yield whole.slice(0, _ROWS)
            waiting = [whole.slice(_ROWS)]
    if any(map(len, waiting)):
        yield _one(waiting)


def _cast(batch: pa.RecordBatch, schema: pa.Schema) -> pa.RecordBatch:
    arrays = [array.cast(field.type) for array, field in zip(batch.columns, schema, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _split_sessions(batch: pa.RecordBatch) -> Iterator[pa.RecordBatch]:
    """The same rows, one session each; the first column is the session's number."""
    edges = [0, *(np.flatnonzero(np.diff(batch.column(0))) + 1).tolist(), len(batch)]
    yield from (batch.slice(begin, end - begin) for begin, end in pairwise(edges) if begin < end)


def _one(batches: list[pa.RecordBatch]) -> pa.RecordBatch:
    [one] = pa.Table.from_batches(batches).combine_chunks().to_batches()
    return one


def software_digest() -> str:
    """What makes the rows: other code makes others, so a file made by it is not gone on with."""
    sources = f"{digest_sources(*_MAKERS)} {digest_files(list_table_sources())}"
    return f"{minihuman.__version__} duckdb {duckdb.__version__} {sources}"


class CachedSession(msgspec.Struct, frozen=True):
    """What is known of a log whose rows are cached: where it is, what counts of it, or why it cannot be read."""

    path: str  # "" in the file, which names no folder outside the study
    problem: str = ""
    study: str = ""
    blocks: int = 0  # that have an episode that counts
    outline: PlanOutline | None = None  # of the session's plan; None, as the quality, of one that is not asked for
    quality: RecordingQuality | None = None
    account: tuple[int, int, tuple[tuple[str, str, int], ...], tuple[tuple[str, int], ...]] = (0, 0, (), ())
    practice: tuple[str, ...] = ()  # the blocks that its protocol does not analyse
    excluded: tuple[tuple[str, str, str], ...] = ()  # the participant, where a rule excludes them: reason, study, code

    def to_summary(self) -> SelectionSummary:
        """The account of this log alone."""
        sessions, episodes, versions, excluded_episodes = self.account
        account = SelectionSummary(sessions=sessions, episodes=episodes)
        account.versions.update({(study, version): count for study, version, count in versions})
        account.excluded_episodes.update(dict(excluded_episodes))
        account.excluded_participants.update(self.excluded)
        return account


class _KnownLog(NamedTuple):
    """What the file says of a log."""

    number: int
    fingerprint: str
    with_shortest: bool
    metadata: bytes  # its first, as MessagePack


class StudyStore(AbstractContextManager["StudyStore", None]):
    """The tables of a study's sessions, up to date as of when it was opened. Use it in a ``with``.

    Opening it fills the sessions' account.

    Args:
        sessions: of which study, and what counts.
        with_shortest: whether the fewest possible steps are worked out, which takes the worlds themselves.
        tables: those that will be read; the digests of no others are compared.
        with_account: whether ``kept`` and the account are filled in; without, the account says what was skipped.

    Raises:
        LogError: if there is no such file or folder, or it is a single log that cannot be read.
        StoreError: if there is no room for the tables, beside the study or among the temporary files.
    """

    def __init__(
        self,
        sessions: StudySessions,
        *,
        with_shortest: bool,
        tables: Collection[str] | None = None,
        with_account: bool = True,
    ) -> None:
        self.kept: tuple[CachedSession, ...] = ()  # every log, in order of path
        self._keys: tuple[str, ...] = ()
        self._with_shortest = with_shortest
        self._sessions = sessions
        self._read_tables = frozenset(TABLES if tables is None else tables).union(_COUNTED_BY)
        self.selection = sessions.selection
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._described = ""  # the file, when its rows were compared with their digests
        self._compared = frozenset[str]()  # the tables of which they were; of no log's own, where it is empty
        self.tables = self._open(read_only=True)
        try:
            self._described, self._compared = describe_cache(self.tables.path), read_checked(self.tables.path)
            self._known = self._list_known()
            now, prints, metadata = self._list_logs()
            try:
                self._bring_up_to_date(now, prints, metadata)
            except duckdb.Error as error:
                if self._temporary is not None:
                    raise
                self.tables.close()
                self._note_not_kept(error)
                self.tables, self._known, self._compared = self._open_temporary(), {}, frozenset()
                self._refresh(now, prints, metadata)
            self._account(now, whole=with_account)
            self._known = {}
        except duckdb.Error as error:
            self.close()
            raise _no_room(sessions.source, error) from error
        except BaseException:
            self.close()
            raise

    def facts(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Every log with the facts of each episode in it that counts."""
        paths = {path: self._sessions.source / path for path in self._keys}
        found = self.tables.connection.execute("SELECT key, facts FROM kept.logs WHERE facts IS NOT NULL")
        while lines := found.fetchmany(_SESSIONS_PER_COMMIT):
            for key, facts in lines:
                yield from ((paths[key], of_episode) for of_episode in msgspec.msgpack.decode(facts))

    def close(self) -> None:
        """Leave the file to others."""
        self.tables.close()
        if self._temporary is not None:
            self._temporary.cleanup()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _list_logs(self) -> tuple[dict[str, Path], dict[str, str], dict[str, dict[str, str]]]:
        """List the logs to be read, by key, with each log's fingerprint and first metadata; note those to be skipped.

        Of a log that is as the file says, which is as it was when it was compared, the metadata are taken from there.
        """
        source = self._sessions.source
        below = len(os.fspath((source if source.is_dir() else source.parent) / "_")) - 1
        prints, metadata = dict[str, str](), dict[str, dict[str, str]]()
        of_participant: dict[str, str] = {}

        def read_metadata(log: Path, first: Path) -> dict[str, str]:
            key = os.fspath(log)[below:]
            known = self._known.get(key) if self._compared else None
            prints[key] = _fingerprint(os.fspath(first), known.fingerprint if known else "", of_participant)
            if known and is_same_content(prints[key], known.fingerprint):
                metadata[key] = msgspec.msgpack.decode(known.metadata)
            else:
                metadata[key] = read_first_metadata(first)
            return metadata[key]

        paths, skipped = list_readable_logs(source, read_metadata)
        for one in skipped:
            self._sessions.skip(one)
        return {os.fspath(path)[below:]: path for path in paths}, prints, metadata

    def _list_known(self) -> dict[str, _KnownLog]:
        """What the file says of each log, once."""
        found = self.tables.connection.execute("SELECT key, log, fingerprint, with_shortest, metadata FROM kept.logs")
        return {key: _KnownLog(*its) for key, *its in found.fetchall()}

    def _open(self, *, read_only: bool) -> TableDatabase:
        """The study's own file if it can hold what is asked for, else one that goes away; a new one can be written."""
        own = self._sessions.source / FILE_NAME
        if self._sessions.selection == Selection() and own.parent.is_dir() and not self._sessions.from_logs:
            for _ in ("as it is", "anew"):
                try:
                    if not own.exists():
                        remove_cache(own)
                    return TableDatabase(own, read_only=read_only and own.exists())
                except (duckdb.IOException, *IN_USE_ERRORS, OSError) as error:  # in use, or a read-only folder
                    self._note_not_kept(error)
                    break
                except (StoreVersionError, CatalogueChangedError, duckdb.Error) as error:  # cut off, none, or no room
                    if read_only and isinstance(error, StoreVersionError):
                        return self._open(read_only=False)
                    if isinstance(error, CatalogueChangedError):
                        self._note(f"{own} was changed by another program; its tables were made anew from the logs")
                    try:
                        remove_cache(own)
                    except OSError as error:
                        self._note_not_kept(error)
                        break
        return self._open_temporary()

    def _note_not_kept(self, error: Exception) -> None:
        own, why = self._sessions.source / FILE_NAME, " ".join(str(error).split("\n")[0].split())
        self._note(f"{own} cannot be used now ({why}); the tables were made anew for this once")

    def _note(self, line: str) -> None:
        self._sessions.account.notes.append(line)

    def _open_temporary(self) -> TableDatabase:
        """A file that goes away."""
        self._temporary = tempfile.TemporaryDirectory(prefix="minihuman-")
        try:
            return TableDatabase(Path(self._temporary.name) / FILE_NAME)
        except duckdb.Error as error:
            self._temporary.cleanup()
            raise _no_room(self._sessions.source, error) from error

    def _bring_up_to_date(
        self, now: Mapping[str, Path], prints: Mapping[str, str], metadata: Mapping[str, dict[str, str]]
    ) -> None:
        """Write what is stale, and leave the study's file open for reading alone: others can read it, too.

        What was compared before the file was closed is not compared again unless it changed meanwhile.
        """
        for _ in range(_MAX_OPENINGS):
            is_fresh = self._refresh(now, prints, metadata)
            if is_fresh and (self.tables.read_only or self._temporary is not None):
                if self._temporary is None and read_checked(self.tables.path) != self._compared:
                    write_checked(self.tables.path, self._compared)
                return
            if not self.tables.read_only:
                self.tables.connection.execute("CHECKPOINT")
                self._described = describe_cache(self.tables.path)
            self.tables.close()
            self.tables = self._open(read_only=is_fresh)
            if (described := describe_cache(self.tables.path)) != self._described:
                self._described, self._compared = described, frozenset()
            self._known = self._list_known()
        raise duckdb.TransactionException("other commands are changing it")

    def _refresh(
        self, now: Mapping[str, Path], prints: Mapping[str, str], metadata: Mapping[str, dict[str, str]]
    ) -> bool:
        """Bring every session's rows up to date; False, with nothing done, if that takes writing."""
        logs = self.tables.connection
        if not all(known.with_shortest >= self._with_shortest for known in self._known.values()):
            self._read_tables |= {"plan", *_PLANNED}
        changed, doubled = set[int](), set[str]()
        if not self._compared:
            digest = f"SELECT log FROM kept.logs WHERE digest IS DISTINCT FROM hash({LOG_COLUMNS})"
            changed = {log for (log,) in logs.execute(digest).fetchall()}
            doubled = {
                key for (key,) in logs.execute("SELECT key FROM kept.logs GROUP BY key HAVING count(*) > 1").fetchall()
            }
        changed = changed.union(*map(self.tables.find_changed, self._read_tables - self._compared))
        have, unplanned = dict[str, int](), dict[str, int]()
        for key, known in self._known.items():
            is_whole = known.number not in changed and key not in doubled
            if is_whole and key in now and is_same_content(prints[key], known.fingerprint):
                (have if known.with_shortest >= self._with_shortest else unplanned)[key] = known.number
        if not changed and not doubled:
            self._compared |= self._read_tables
        if self.tables.read_only and (changed or doubled or not have.keys() == now.keys() == self._known.keys()):
            return False
        have |= self._plan_paths(unplanned)
        ((numbers,),) = logs.execute("SELECT coalesce(list(log), []) FROM kept.logs").fetchall()
        stale = sorted(changed.union(numbers).difference(have.values()))
        if damaged := len(changed | {self._known[key].number for key in doubled}):
            what = "1 session" if damaged == 1 else f"{damaged} sessions"
            own = self._sessions.source / FILE_NAME
            self._note(f"{own} was changed by another program: the rows of {what} were made anew from the logs")
        if stale:
            with transaction(self.tables.connection):
                self.tables.remove(stale)
                logs.execute("DELETE FROM kept.logs WHERE log IN (SELECT unnest(?))", (stale,))
        fresh = {key: path for key, path in now.items() if key not in have}
        if fresh:
            self._read(fresh, prints, metadata)
        self._compared |= self._read_tables
        return True

    def _account(self, now: Mapping[str, Path], *, whole: bool) -> None:
        """Note what is known of each log, or with ``whole`` off of those to be skipped, and in which order to read."""
        of_which = "" if whole else "WHERE facts IS NULL"
        about = self.tables.connection.execute(f"SELECT key, about FROM kept.logs {of_which}").fetchall()
        found = {key: msgspec.msgpack.decode(of_log, type=CachedSession) for key, of_log in about}
        numbers = dict(self.tables.connection.execute("SELECT key, log FROM kept.logs").fetchall())
        self.tables.put_in_order([numbers[key] for key in now])
        self.tables.checked = self._read_tables
        self._keys = tuple(now)
        self.kept = tuple(
            msgspec.structs.replace(found[key], path=str(path)) for key, path in now.items() if key in found
        )  # they may move
        for one in self.kept:
            if one.problem:
                self._sessions.skip(SkippedLog(Path(one.path), one.problem))
            else:
                self._sessions.account.add(one.to_summary())

    def _plan_paths(self, unplanned: Mapping[str, int]) -> dict[str, int]:
        """Fill in what takes the worlds, of sessions whose rows are whole without; give those that were filled in."""
        logs, filled = self.tables.connection, dict[str, int]()
        waiting = iter(unplanned.values())
        while numbers := list(islice(waiting, _SESSIONS_PER_UPDATE)):
            about = logs.execute(
                "SELECT key, log, about, row_digests FROM kept.logs SEMI JOIN kept.participants p USING (log) "
                "WHERE log IN (SELECT unnest(?)) AND log NOT IN "
                "(SELECT log FROM kept.participants WHERE exclusion_reason IS NOT NULL)",
                (numbers,),
            ).fetchall()
            sessions = {log: (key, msgspec.msgpack.decode(its, type=CachedSession)) for key, log, its, _ in about}
            if not sessions:
                continue
            with transaction(self.tables.connection):
                practice = {log: its.practice for log, (_, its) in sessions.items()}
                self.tables.add_path_measures(list(sessions), practice)
                digests = {name: self.tables.digest_rows(name) for name in _PLANNED}
                stored = [
                    {
                        "log": log,
                        "row_digests": [
                            digests[name].get(log, 0) if name in digests else old
                            for name, old in zip(TABLES, row_digests, strict=True)
                        ],
                    }
                    for _, log, _, row_digests in about
                ]
                new = pa.Table.from_pylist(stored, _ROW_DIGESTS)  # noqa: F841 - SQL reads it
                logs.execute(
                    "UPDATE kept.logs SET with_shortest = true, row_digests = new.row_digests, digest = NULL "
                    "FROM new WHERE logs.log = new.log"
                )
                logs.execute(f"UPDATE kept.logs SET digest = hash({LOG_COLUMNS}) WHERE digest IS NULL")
            filled |= {key: log for log, (key, _) in sessions.items()}
        return filled

    @infrequent_collection()
    def _read(
        self, fresh: Mapping[str, Path], prints: Mapping[str, str], metadata: Mapping[str, dict[str, str]]
    ) -> None:
        """Read logs and keep their rows, some sessions at a time."""
        logs = self.tables.connection
        ((last,),) = logs.execute("SELECT coalesce(max(log), 0) FROM kept.logs").fetchall()
        work = partial(read_session_rows, selection=self._sessions.selection, with_shortest=self._with_shortest)
        its = self._sessions
        found = map_logs(list(fresh.values()), work, processes=its.processes, engine=its.engine)
        numbered = iter(enumerate(zip(fresh, found, strict=True), last + 1))
        for _ in range(0, len(fresh), _SESSIONS_PER_COMMIT):
            with transaction(logs):
                self._insert_sessions(islice(numbered, _SESSIONS_PER_COMMIT), prints, metadata)

    def _insert_sessions(
        self,
        sessions: Iterable[tuple[int, tuple[str, SessionRows | SkippedLog]]],
        prints: Mapping[str, str],
        metadata: Mapping[str, dict[str, str]],
    ) -> None:
        """Keep some sessions' rows, or why a log of theirs cannot be read; memory holds few at a time."""
        lines = dict[int, tuple[Any, ...]]()

        def each() -> Iterator[tuple[int, SessionTables]]:
            for number, (key, one) in sessions:
                if not isinstance(one, SkippedLog):
                    about, facts = _read_cached_sessions(one), msgspec.msgpack.encode(one.facts)
                    yield number, one.rows
                elif self._sessions.source.is_dir():
                    about, facts = CachedSession("", problem=name_paths_from(self._sessions.source, one.reason)), None
                else:
                    raise LogError(one.reason)
                encoded = msgspec.msgpack.encode(metadata[key]), msgspec.msgpack.encode(about)
                lines[number] = (key, prints[key], self._with_shortest, *encoded, facts)

        digests, logs = self.tables.insert(each()), self.tables.connection
        logs.executemany(
            "INSERT INTO kept.logs VALUES (?, ?, ?, ?, ?, ?, ?, ?, NULL)",
            [(n, *its[:3], digests.get(n, [0] * len(TABLES)), *its[3:]) for n, its in lines.items()],
        )
        logs.execute(f"UPDATE kept.logs SET digest = hash({LOG_COLUMNS}) WHERE digest IS NULL")


def _read_cached_sessions(one: SessionRows) -> CachedSession:
    account = one.account
    versions = tuple((*whose, count) for whose, count in account.versions.items())
    wanted = one.rows.count("participants") > 0
    return CachedSession(
        path="",
        study=one.plan.study,
        blocks=len({facts["block"] for facts in one.facts}),
        practice=tuple(sorted(find_practice_blocks(one.plan))),
        outline=PlanOutline.of(one.plan) if wanted else None,
        quality=one.quality if wanted else None,
        account=(account.sessions, account.episodes, versions, tuple(account.excluded_episodes.items())),
        excluded=tuple(sorted(account.excluded_participants)),
    )


def _no_room(source: Path, error: duckdb.Error) -> QueryError:
    why = str(error).splitlines()[0]
    return QueryError(f"{source}: its tables cannot be made, beside it or in {tempfile.gettempdir()}: {why}")


def _fingerprint(first: str, known: str, of_participant: dict[str, str]) -> str:
    """Of a log, by the file that it begins in, of the marks beside it, and of the participant's other sessions.

    A rule that excludes a participant may be broken in any of their sessions, so each one's rows depend on all.
    """
    folder = os.path.dirname(first)
    if not os.path.basename(folder).startswith("ses-"):
        marks = os.path.basename(annotations_path(Path(first)))
        return _describe_files(folder, marks.partition("_")[0], known)
    participant = os.path.dirname(folder)
    if participant not in of_participant:
        folders = sorted(
            entry.path for entry in os.scandir(participant or ".") if entry.name.startswith("ses-") and entry.is_dir()
        )
        of_participant[participant] = "\n".join(_describe_files(one, "", known) for one in folders)
    return of_participant[participant]


def _describe_files(folder: str, prefix: str, known: str) -> str:
    """Describe a folder's files whose names begin so, a line each; ``known`` as in ``describe_file``."""
    return "\n".join(
        describe_file(entry.path, entry.stat(), name=f"{os.path.basename(folder)}/{entry.name}", known=known)
        for entry in sorted(os.scandir(folder or "."), key=lambda entry: entry.name)
        if entry.name.startswith(prefix) and entry.is_file()
    )


MAX_SHOWN_ROWS = 100  # rows; more are for a file


def format_result_csv(answer: pa.Table) -> str:
    """Every row, under the columns' names."""
    file = io.BytesIO()
    pa.csv.write_csv(answer, file)
    return file.getvalue().decode()


def format_result_lines(answer: pa.Table) -> Iterator[str]:
    """The first rows, in columns; what is missing is a dot."""
    rows = [
        ["." if one is None else f"{one:.6g}" if isinstance(one, float) else str(one) for one in row.values()]
        for row in answer.slice(0, MAX_SHOWN_ROWS).to_pylist()
    ]
    widths = [max(map(len, column)) for column in zip(answer.column_names, *rows, strict=True)]
    numbers = [pa.types.is_integer(kind) or pa.types.is_floating(kind) for kind in answer.schema.types]
    for row in (answer.column_names, *rows):
        cells = zip(row, widths, numbers, strict=True)
        yield "  ".join(cell.rjust(width) if number else cell.ljust(width) for cell, width, number in cells).rstrip()
    if answer.num_rows > MAX_SHOWN_ROWS:
        yield f"({answer.num_rows} rows, {MAX_SHOWN_ROWS} of them shown; --csv prints all)"
