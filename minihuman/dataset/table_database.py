"""A DuckDB file with the tables of some sessions: their rows, the digests of the rows, and the answers to queries.

The module deals with rows and session numbers; it knows neither logs nor selections.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from hashlib import blake2b
from itertools import chain, groupby, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import duckdb
import numpy as np
import pyarrow as pa

import minihuman
from minihuman.dataset.activity_tables import list_table_sources
from minihuman.dataset.caches import INDEX_SCHEMA, connect_cache, digest_files, digest_sources, transaction
from minihuman.dataset.column_aliases import use_current_columns
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.rows import RowBatch, SessionTables, arrow_columns, arrow_schema, as_int64
from minihuman.dataset.session_measures import average_path_measures, compare_with_shortest_path, find_layout_bounds
from minihuman.dataset.table_catalogue import TABLES, is_episode_table
from minihuman.dataset.table_queries import QUERY_SETTINGS, find_queried_tables
from minihuman.errors import QueryError

_ROWS = 100_000  # per batch
_DIGEST_MODULUS = 2**64
_ROWS_PER_INSERT = 50_000  # of one table; fewer are slower, more need more memory
_SQL_TYPES = {pa.string(): "VARCHAR", pa.int64(): "BIGINT", pa.float64(): "DOUBLE", pa.bool_(): "BOOLEAN"}
_READING = frozenset(f"StatementType.{name}" for name in ("SELECT", "EXPLAIN", "PRAGMA", "MULTI"))  # MULTI: PIVOT
_MAKERS = ("dataset", "log/model")  # the packages whose code builds the rows, besides the modules of activity tables
LOG_COLUMNS = "log, key, fingerprint, with_shortest, row_digests, metadata, about, facts"  # digested with each log
COUNTED_BY = ("episodes", "participants")  # the tables whose exclusion reasons apply to all others
PLANNED_TABLES = {
    "episodes": "row",
    "blocks": "block",
    "participants": "log",
}  # tables with world columns, and their rows' key


class StoreVersionError(Exception):
    """A file holds tables with other columns, or was made by another version of the software."""


class CatalogueChangedError(Exception):
    """A file's tables, views or macros differ from those that were created."""


class TableDatabase(AbstractContextManager["TableDatabase", None]):
    """The tables of some sessions, each identified by a number. Use it in a ``with`` statement.

    Args:
        path: the DuckDB file.
        read_only: whether the file must stay unchanged.

    Raises:
        StoreVersionError: if the file holds other tables.
        CatalogueChangedError: if the file's tables, views or macros were changed.
        duckdb.Error: if the file cannot be opened or written, or is not a DuckDB file.
    """

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open a file, and create the tables if the file is new."""
        self.path = path
        # The session numbers in the order of reading; None for the order of insertion.
        self.order: tuple[int, ...] | None = None
        self._is_placed = False  # whether the connection has the order as a table
        self.checked: frozenset[str] = frozenset(TABLES)  # tables that may be read: their digests were compared
        self.read_only = read_only
        self.is_new = False  # whether this object created the tables; no other program can have changed them
        self.connection = connect_cache(path, read_only=read_only)
        try:
            version_tables = self.connection.execute(
                "SELECT 1 FROM duckdb_tables() WHERE table_name = 'made_by'"
            ).fetchall()
            if not version_tables:
                if read_only:  # it has the session index alone
                    raise StoreVersionError
                self._create_tables()
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
        """Insert the rows of sessions, each given by its number and its rows of every table.

        Return, by session number, a digest of the session's rows in each table, in the order of ``TABLES``; 0 for a
        table without rows.
        """
        digests: dict[int, list[int]] = {}
        waiting: dict[str, dict[int, RowBatch]] = {name: {} for name in TABLES}
        for number, rows in sessions:
            digests[number] = [0] * len(TABLES)
            for name, batches in waiting.items():
                if rows.count(name):
                    batches[number] = rows.parts[name]
                if sum(part.count for part in batches.values()) >= _ROWS_PER_INSERT:
                    self._insert_rows(name, batches, digests)
        for name, batches in waiting.items():
            self._insert_rows(name, batches, digests)
        return digests

    def _insert_rows(self, name: str, parts: dict[int, RowBatch], digests: Mapping[int, list[int]]) -> None:
        """Insert some sessions' rows of one table, record their digests in ``digests``, and clear ``parts``."""
        if not parts:
            return
        counts = [part.count for part in parts.values()]
        log_numbers = np.repeat(list(parts), counts)
        row_numbers = np.concatenate([np.arange(count) for count in counts])
        columns = [as_int64(log_numbers), as_int64(row_numbers), *arrow_columns(name, list(parts.values()))]
        # not a view, which would keep the rows in memory until the transaction ends
        new = self.connection.from_arrow(pa.Table.from_arrays(columns, ["log", "row", *arrow_schema(name).names]))
        table_place = list(TABLES).index(name)
        for number, digest in new.aggregate(_compose_row_digest(name), "log").fetchall():
            digests[number][table_place] = digest
        new.insert_into(f"kept.{name}")
        parts.clear()

    def add_path_measures(self, numbers: Sequence[int], practice: Mapping[int, Collection[str]]) -> None:
        """Fill in the columns that require the worlds, using only the stored rows.

        Args:
            numbers: the numbers of sessions that no rule excludes; the rows of excluded sessions do not show which
                episodes are included.
            practice: per session number, the names of the blocks that are not analysed.
        """
        episodes = self._measure_paths(numbers)
        if not episodes:  # none of these sessions has an episode
            return
        rows_by_block: dict[tuple[int, str], list[dict[str, Any]]] = {}  # by session number and block name
        rows_by_session: dict[tuple[int, str], list[dict[str, Any]]] = {}  # by session number and ""
        for row in episodes:
            log = row["log"]
            block = row["block"]
            block_rows = rows_by_block.setdefault((log, block), [])  # a block may have no included episode
            session_rows = rows_by_session.setdefault((log, ""), [])
            if row["counts"]:
                block_rows.append(row)
                if block not in practice[log]:
                    session_rows.append(row)
        self._update_world_columns("episodes", episodes)
        for name, groups in (("blocks", rows_by_block), ("participants", rows_by_session)):
            means = [
                {"log": log, "block": block, **average_path_measures(rows)} for (log, block), rows in groups.items()
            ]
            self._update_world_columns(name, means)

    def _measure_paths(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """Compare the episodes of some sessions with their shortest paths; return one row of measures per episode."""
        episode_rows = self.connection.execute(
            "SELECT log, e.row, e.block, steps, e.max_steps, outcome, exclusion_reason IS NULL AS counts, p.world, "
            "options, p.seed FROM kept.episodes e JOIN kept.plan p USING (log, episode) "
            "WHERE log IN (SELECT unnest(?)) ORDER BY log, e.row",
            (list(numbers),),
        )
        names = [column[0] for column in episode_rows.description]
        rows = [dict(zip(names, cells, strict=True)) for cells in episode_rows.fetchall()]
        for row in rows:
            row |= compare_with_shortest_path(row, find_layout_bounds(row["world"], row["options"], row["seed"]))
        return rows

    def _update_world_columns(self, name: str, rows: list[dict[str, Any]]) -> None:
        """Store the columns of a table that require the worlds; each row names its session and its key."""
        key = PLANNED_TABLES[name]
        changed = [column for column in arrow_schema(name).names if column in COLUMNS_NEEDING_WORLD]
        assigned = ", ".join(f'"{column}" = new."{column}"' for column in changed)
        measured = pa.Table.from_pylist(rows).select(list({"log", key}) + changed)  # noqa: F841 - SQL reads it
        self.connection.execute(
            f"UPDATE kept.{name} SET {assigned} FROM measured AS new "
            f"WHERE {name}.log = new.log AND {name}.{key} = new.{key}"
        )

    def remove(self, numbers: Sequence[int]) -> None:
        """Delete sessions' rows from all tables."""
        for name in TABLES:
            self.connection.execute(f"DELETE FROM kept.{name} WHERE log IN (SELECT unnest(?))", (list(numbers),))

    def digest_rows(self, name: str, *, without: frozenset[str] = frozenset()) -> dict[int, int]:
        """Return a digest of each session's rows in a table, by session number; the columns in ``without`` are omitted.

        Sessions without rows are absent. Every edit changes the digest; equal rows have equal digests, whatever the
        session's number.
        """
        return digest_relation(self.connection.sql(f"FROM kept.{name}"), name, without=without)

    def find_changed(self, name: str) -> set[int]:
        """Return the numbers of sessions whose rows in a table differ from those inserted.

        If the table has rows under a number that no session has, that number is included.
        """
        digest_index = list(TABLES).index(name) + 1  # SQL counts from 1
        changed = self.connection.execute(
            f"SELECT log FROM (SELECT {_compose_row_digest(name)} FROM kept.{name} GROUP BY log) AS held "
            "FULL JOIN (SELECT log, row_digests FROM kept.logs) AS stored USING (log) "
            f"WHERE coalesce(held.digest, 0) IS DISTINCT FROM stored.row_digests[{digest_index}]"
        )
        return {log for (log,) in changed.fetchall()}

    def _digest_catalogue(self) -> str:
        """Return a digest of the definitions of all tables, views and macros.

        All are covered, because an added one could hide one of this program's. The session index is excluded, because
        it is rebuilt whatever its schema holds.
        """
        definitions = self.connection.execute(
            f"SELECT schema_name || table_name || sql FROM duckdb_tables() WHERE schema_name <> '{INDEX_SCHEMA}' "
            "UNION ALL "
            "SELECT schema_name || view_name || sql FROM duckdb_views() WHERE NOT internal UNION ALL "
            "SELECT schema_name || function_name || macro_definition FROM duckdb_functions() WHERE NOT internal "
            "ORDER BY 1"
        ).fetchall()
        return blake2b(repr(definitions).encode(), digest_size=16).hexdigest()

    def put_in_order(self, numbers: Sequence[int]) -> None:
        """Set the order in which ``batches`` yields the sessions, given by number."""
        if list(numbers) == sorted(numbers):
            self.order = None
            return
        self.order = tuple(numbers)
        self._is_placed = False

    def _place_sessions(self, numbers: Sequence[int]) -> None:
        """Create the temporary table that gives each session's position in the order."""
        self._is_placed = True
        self.connection.execute("CREATE OR REPLACE TEMP TABLE placed (log INTEGER, place INTEGER)")
        columns = (np.array(numbers), np.arange(len(numbers)))
        placed = pa.Table.from_arrays([as_int64(column) for column in columns], ["log", "place"])
        self.connection.from_arrow(placed).insert_into("placed")

    def batches(
        self, name: str, *, without: frozenset[str] = frozenset(), counting: bool = False
    ) -> Iterator[pa.RecordBatch]:
        """Yield one table's rows, session by session; only a few rows are in memory at a time.

        The columns in ``without`` are omitted. All batches except the last have the same number of rows, regardless of
        earlier insertions and deletions, so that equal rows make equal files. With ``counting``, excluded rows are
        omitted, and so are rows that belong to an excluded episode or session.
        """
        self._require_checked({name, *(COUNTED_BY if counting else ())})
        schema = arrow_schema(name, without=without)
        columns = ", ".join(f'"{column}"' for column in schema.names)
        source = f"FROM kept.{name}"
        if counting:
            source += f" {_compose_included_join(name)}"
        if self.order is not None and not self._is_placed:
            self._place_sessions(self.order)
        if counting or self.order is not None:
            if self.order is None:
                source += " ORDER BY log, row"
            else:
                source += " JOIN placed USING (log) ORDER BY place, row"
        for batch in _split_evenly(self.connection.sql(f"SELECT {columns} {source}").to_arrow_reader(_ROWS)):
            yield _cast(batch, schema)

    def session_batches(
        self, name: str, numbers: Sequence[int], *, without: frozenset[str] = frozenset()
    ) -> Iterator[tuple[int, Iterator[pa.RecordBatch]]]:
        """Yield the rows of one table for the given sessions, session by session; omit the columns in ``without``.

        Each item is a session's number and an iterator over its batches, to be used up before the next item is
        requested. As in ``batches``, equal rows make equal batches.
        """
        self._require_checked({name})
        schema = arrow_schema(name, without=without)
        columns = ", ".join(f'"{column}"' for column in schema.names)
        logs = ", ".join(map(str, numbers))
        rows = self.connection.sql(f"SELECT log, {columns} FROM kept.{name} WHERE log IN ({logs}) ORDER BY log, row")
        parts = chain.from_iterable(map(_split_sessions, rows.to_arrow_reader(_ROWS)))
        for number, session_parts in groupby(parts, key=_read_log_number):
            without_number = (part.select(schema.names) for part in session_parts)
            yield number, (_cast(batch, schema) for batch in _split_evenly(without_number))

    def table(self, name: str, columns: Sequence[str] | None = None, *, counting: bool = False) -> pa.Table:
        """Read a table, or only ``columns`` in this order; ``counting`` omits excluded rows as in ``batches``."""
        without = frozenset[str]()
        if columns is not None:
            without = frozenset(column.name for column in TABLES[name]).difference(columns)
        table = pa.Table.from_batches(
            self.batches(name, without=without, counting=counting), arrow_schema(name, without=without)
        )
        if columns is None:
            return table
        return table.select(columns)

    def count(self, name: str) -> int:
        """Return the number of rows in a table."""
        self._require_checked({name})
        counts = self.connection.execute(f"SELECT count(*) FROM kept.{name}").fetchall()
        return int(counts[0][0])

    def query(self, sql: str, further: Mapping[str, pa.Table] = MappingProxyType({})) -> pa.Table:
        """Run SQL on the tables, with current or earlier column names.

        A query can neither read nor write any other file. ``further`` are tables from elsewhere, by name.

        Raises:
            QueryError: if the text is not a valid SELECT statement, refers to something that does not exist, or uses a
                file.
        """
        self._require_checked(find_queried_tables(sql))
        self._connect_for_queries()
        try:
            for name, rows in further.items():
                columns = ", ".join(f'"{field.name}" {_SQL_TYPES[field.type]}' for field in rows.schema)
                self.connection.execute(f"CREATE TEMP TABLE {name} ({columns})")
                self.connection.from_arrow(rows).insert_into(name)
            if any(str(statement.type) not in _READING for statement in self.connection.extract_statements(sql)):
                raise QueryError(f"{sql!r} is not a SELECT statement; use SELECT to read the study's tables")
            try:
                relation = self.connection.sql(sql)
            except duckdb.BinderException:  # a column may have its earlier name
                relation = self.connection.sql(use_current_columns(sql))
            if relation is None:
                raise QueryError(f"{sql!r} returns no rows; a query must be a SELECT over the study's tables")
            return relation.to_arrow_table()
        except duckdb.PermissionException as error:
            raise QueryError(f"{sql!r} uses a file; a query may only read the study's tables") from error
        except duckdb.Error as error:
            reason = " ".join(str(error).split("\n\n")[0].split())
            raise QueryError(f"the query failed: {reason}; the tables are {', '.join([*TABLES, *further])}") from error

    def _connect_for_queries(self) -> None:
        """Reconnect with the settings for queries; one process cannot open the file with two kinds of settings."""
        self.connection.close()
        self.connection = connect_cache(self.path, read_only=True, settings=QUERY_SETTINGS)
        self._is_placed = False  # the temporary table went with the connection

    def _require_checked(self, names: Collection[str]) -> None:
        """Raise AssertionError if one of the tables was not compared with its digests when the store was opened."""
        unchecked = set(names) - self.checked
        if unchecked:
            raise AssertionError(f"the store was not opened for {', '.join(sorted(unchecked))}")

    def close(self) -> None:
        """Close the file, so that other processes can use it."""
        self.connection.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _create_tables(self) -> None:
        """Create the tables of a new file, and record the software that made them."""
        with transaction(self.connection):
            self.connection.execute("CREATE SCHEMA kept")
            definitions = "\n".join(map(_compose_definition, TABLES))
            self.connection.execute(definitions)  # all at once, as each call takes a millisecond
            self.connection.execute(
                "CREATE TABLE kept.logs (log INTEGER NOT NULL, key TEXT, fingerprint TEXT, with_shortest BOOLEAN, "
                "row_digests UBIGINT[], metadata BLOB, about BLOB, facts BLOB, digest UBIGINT)"
            )
            self.connection.execute("CREATE TABLE kept.made_by (version TEXT, catalogue TEXT)")
            made_by = (software_digest(), self._digest_catalogue())
            self.connection.execute("INSERT INTO kept.made_by VALUES (?, ?)", made_by)
        self.is_new = True


def _compose_included_join(name: str) -> str:
    """Return the SQL join that omits excluded rows of a table, and rows of excluded episodes or sessions."""
    if "exclusion_reason" in arrow_schema(name).names:
        return f"SEMI JOIN (SELECT log, row FROM kept.{name} WHERE exclusion_reason IS NULL) USING (log, row)"
    if is_episode_table(name):
        included_episodes = "SELECT log, episode, attempt FROM kept.episodes WHERE exclusion_reason IS NULL"
        return f"SEMI JOIN ({included_episodes}) USING (log, episode, attempt)"
    return "SEMI JOIN (SELECT log FROM kept.participants WHERE exclusion_reason IS NULL) USING (log)"


def _compose_definition(name: str) -> str:
    """Return the SQL that creates a table and the view of it that queries read, without the session's number."""
    types = {field.name: _SQL_TYPES[field.type] for field in arrow_schema(name)}
    columns = ", ".join(f'"{column}" {sql_type}' for column, sql_type in types.items())
    view_columns = ", ".join(f'"{column}"' for column in types)
    return (
        f"CREATE TABLE kept.{name} (log INTEGER NOT NULL, row INTEGER, {columns}); "
        f"CREATE VIEW {name} AS SELECT {view_columns} FROM kept.{name};"
    )


def digest_relation(
    rows: duckdb.DuckDBPyRelation, name: str, *, without: frozenset[str] = frozenset()
) -> dict[int, int]:
    """Return a digest of each session's rows in a relation, by session number.

    Args:
        rows: the rows, with the table's columns and two more: ``log``, the session's number, and ``row``, the number of
            the row in the session.
        name: the name of the table.
        without: the columns to omit.
    """
    return dict(rows.aggregate(_compose_row_digest(name, without=without), "log").fetchall())


def _compose_row_digest(name: str, *, without: frozenset[str] = frozenset()) -> str:
    """Return the SQL select list of a query that digests a table's rows by session, omitting columns in ``without``.

    The digests of the rows are added, so that the order in which they are read does not matter.
    """
    columns = ", ".join(f'"{column}"' for column in arrow_schema(name, without=without).names)
    return f"log, (sum(hash(row::BIGINT, {columns})) % {_DIGEST_MODULUS})::UBIGINT AS digest"


def _split_evenly(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Yield the same rows in batches of ``_ROWS`` rows, of which the last may have fewer.

    The sizes of DuckDB's batches depend on gaps in the file.
    """
    waiting: list[pa.RecordBatch] = []
    for batch in batches:
        waiting.append(batch)
        if sum(map(len, waiting)) >= _ROWS:
            joined = _combine(waiting)
            yield joined.slice(0, _ROWS)
            waiting = [joined.slice(_ROWS)]
    if any(map(len, waiting)):
        yield _combine(waiting)


def _cast(batch: pa.RecordBatch, schema: pa.Schema) -> pa.RecordBatch:
    arrays = [array.cast(field.type) for array, field in zip(batch.columns, schema, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _split_sessions(batch: pa.RecordBatch) -> Iterator[pa.RecordBatch]:
    """Yield the same rows in one batch per session; the first column is the session's number."""
    changes = np.flatnonzero(np.diff(batch.column(0))) + 1
    edges = [0, *changes.tolist(), len(batch)]
    for begin, end in pairwise(edges):
        if begin < end:
            yield batch.slice(begin, end - begin)


def _read_log_number(batch: pa.RecordBatch) -> int:
    """Return the session's number from the first column of a batch of its rows."""
    return int(batch.column(0)[0].as_py())


def _combine(batches: list[pa.RecordBatch]) -> pa.RecordBatch:
    """Concatenate batches, at least one of which has rows, into a single batch."""
    [batch] = pa.Table.from_batches(batches).combine_chunks().to_batches()
    return batch


def software_digest() -> str:
    """Return the versions of minihuman and DuckDB and a digest of the code that builds the rows.

    A file that was made by other software is not extended but built again.
    """
    sources = f"{digest_sources(*_MAKERS)} {digest_files(list_table_sources())}"
    return f"{minihuman.__version__} duckdb {duckdb.__version__} {sources}"
