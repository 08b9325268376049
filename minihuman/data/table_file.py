"""Tables in one DuckDB file: rows of many sessions put in together, handed out session by session."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from hashlib import blake2b
from pathlib import Path
from types import TracebackType

import duckdb
import numpy as np
import pyarrow as pa

import minihuman
from minihuman.data.arrow import schema
from minihuman.data.columns import TABLES
from minihuman.data.rows import Rows, together, whole_numbers
from minihuman.data.table_schema import OF_EPISODES
from minihuman.errors import StoreError

_ROWS = 100_000  # handed out at once
_SETTINGS = {"threads": "2", "memory_limit": "128MB"}
_MAKERS = ("data", "measures", "recorded")  # the packages whose code makes the rows


class OfAnotherVersionError(Exception):
    """A file holds tables of other columns, or made by other software."""


class TableFile:
    """The tables of some sessions, each under a number of its own. Use it in a ``with``.

    Raises:
        OfAnotherVersionError: if the file holds others.
        duckdb.Error: if it cannot be opened or written, or is no such file.
    """

    def __init__(self, path: Path) -> None:
        """Open a file; a new one is given its tables."""
        self.path = path
        self.order: tuple[int, ...] | None = None  # of the sessions' numbers; None: as they were put in
        self.connection = duckdb.connect(str(path), config=dict(_SETTINGS))
        try:
            there = self.connection.execute("SELECT 1 FROM duckdb_tables() WHERE table_name = 'made_by'").fetchall()
            if not there:
                self._lay_out()
            elif self.connection.execute("SELECT version FROM kept.made_by").fetchall() != [(made_by(),)]:
                raise OfAnotherVersionError
        except BaseException:
            self.connection.close()
            raise

    def insert(self, sessions: Mapping[int, Rows]) -> None:
        """Put sessions' rows in."""
        for name in TABLES if sessions else ():
            counts = [rows.count(name) for rows in sessions.values()]
            places = np.concatenate([np.arange(count) for count in counts])
            new = together(name, list(sessions.values()))
            new = new.add_column(0, "row", whole_numbers(places))
            new = new.add_column(0, "log", whole_numbers(np.repeat(list(sessions), counts)))
            self.connection.register("new", new)
            self.connection.execute(f"INSERT INTO kept.{name} SELECT * FROM new")
            self.connection.unregister("new")

    def remove(self, numbers: Sequence[int]) -> None:
        """Take sessions' rows out."""
        for name in TABLES:
            self.connection.execute(f"DELETE FROM kept.{name} WHERE log IN (SELECT unnest(?))", (list(numbers),))

    def put_in_order(self, numbers: Sequence[int]) -> None:
        """Say in which order sessions are to be handed out."""
        if list(numbers) == sorted(numbers):
            self.order = None
            return
        self.order = tuple(numbers)
        self.connection.execute("CREATE OR REPLACE TEMP TABLE placed (log INTEGER, place INTEGER)")
        columns = (np.array(numbers), np.arange(len(numbers)))
        placed = pa.Table.from_arrays([whole_numbers(column) for column in columns], ["log", "place"])
        self.connection.register("new", placed)
        self.connection.execute("INSERT INTO placed SELECT * FROM new")
        self.connection.unregister("new")

    def batches(
        self, name: str, *, without: frozenset[str] = frozenset(), counting: bool = False
    ) -> Iterator[pa.RecordBatch]:
        """One table's rows, session by session, some columns left out; only a few are in memory at a time.

        All but the last batch have the same number of rows, whatever was put in and taken out before: equal rows make
        equal files.

        ``counting`` leaves out what does not count, and what belongs to an episode or a session that does not.
        """
        wanted = schema(name, without=without)
        columns = ", ".join(f'"{column}"' for column in wanted.names)
        found = f"FROM kept.{name}"
        if counting and "left_out" in schema(name).names:
            found += f" SEMI JOIN (SELECT log, row FROM kept.{name} WHERE left_out IS NULL) USING (log, row)"
        elif counting and name in OF_EPISODES:
            theirs = "SELECT log, episode, attempt FROM kept.episodes WHERE left_out IS NULL"
            found += f" SEMI JOIN ({theirs}) USING (log, episode, attempt)"
        elif counting:
            found += " SEMI JOIN (SELECT log FROM kept.participants WHERE left_out IS NULL) USING (log)"
        if counting or self.order is not None:
            order, place = ("JOIN placed USING (log)", "place") if self.order is not None else ("", "log")
            found += f" {order} ORDER BY {place}, row"
        for batch in _even(self.connection.sql(f"SELECT {columns} {found}").to_arrow_reader(_ROWS)):
            yield pa.RecordBatch.from_arrays(
                [array.cast(field.type) for array, field in zip(batch.columns, wanted, strict=True)], schema=wanted
            )

    def table(self, name: str, columns: Sequence[str] | None = None, *, counting: bool = False) -> pa.Table:
        """A table, or some columns of it; ``counting`` as in ``batches``."""
        names = [column.name for column in TABLES[name]]
        without = frozenset(names) - set(names if columns is None else columns)
        table = pa.Table.from_batches(
            self.batches(name, without=without, counting=counting), schema(name, without=without)
        )
        return table if columns is None else table.select(columns)

    def count(self, name: str) -> int:
        """How many rows a table has."""
        counted = self.connection.execute(f"SELECT count(*) FROM kept.{name}").fetchall()
        return int(counted[0][0])

    def query(self, sql: str) -> pa.Table:
        """What SQL says of the tables, which it cannot change.

        Raises:
            StoreError: if it is no SQL, or asks for what is not there.
        """
        self.connection.close()
        self.connection = duckdb.connect(str(self.path), read_only=True, config=dict(_SETTINGS))
        try:
            found = self.connection.sql(sql)
            if found is None:
                raise StoreError(f"{sql!r} asks for nothing; it is to begin with SELECT")
            return found.to_arrow_table()
        except duckdb.Error as error:
            line = " ".join(str(error).split("\n\n")[0].split())
            raise StoreError(f"{line}; the tables are {', '.join(TABLES)}") from error

    def close(self) -> None:
        """Leave the file to others."""
        self.connection.close()

    def __enter__(self) -> "TableFile":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _lay_out(self) -> None:
        self.connection.execute("BEGIN; CREATE SCHEMA kept")
        for name in TABLES:
            self.connection.register("empty", pa.Table.from_batches([], schema(name)))
            rows = "SELECT 0::INTEGER AS log, 0::INTEGER AS row, * FROM empty"
            self.connection.execute(f"CREATE TABLE kept.{name} AS {rows}")
            self.connection.execute(f"CREATE VIEW {name} AS SELECT * EXCLUDE (log, row) FROM kept.{name}")
            self.connection.unregister("empty")
        self.connection.execute(
            "CREATE TABLE kept.logs "
            "(log INTEGER, key TEXT, fingerprint TEXT, with_shortest BOOLEAN, about BLOB, facts BLOB)"
        )
        self.connection.execute("CREATE TABLE kept.made_by (version TEXT)")
        self.connection.execute("INSERT INTO kept.made_by VALUES (?)", (made_by(),))
        self.connection.execute("COMMIT")


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


def _one(batches: list[pa.RecordBatch]) -> pa.RecordBatch:
    [one] = pa.Table.from_batches(batches).combine_chunks().to_batches()
    return one


@cache
def made_by() -> str:
    """What makes the rows: other code makes others, so a file made by it is not gone on with."""
    digest = blake2b(digest_size=8)
    root = Path(minihuman.__file__).parent
    for source in sorted(path for package in _MAKERS for path in (root / package).glob("*.py")):
        digest.update(source.read_bytes())
    return f"{minihuman.__version__} {digest.hexdigest()}"
