"""Journals in a PostgreSQL database, for stations and servers on several machines."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Generic, TypeVar

import msgspec
import psycopg

from minihuman.storage.database import Database, JournalDatabaseError
from minihuman.storage.journal import Journal, LineChain, LineDecoder, LinesRead, LockedJournal

Line = TypeVar("Line")
_TABLES = """
create table if not exists minihuman_journals (
    name text primary key,
    generation bigint not null default 0  -- goes up when lines are taken out
);
create table if not exists minihuman_lines (
    journal text not null references minihuman_journals (name),
    number bigint not null,
    line bytea not null,
    primary key (journal, number)
)
"""
_ADD = """
insert into minihuman_lines (journal, number, line)
select %s, number, line from unnest(%s::bigint[], %b::bytea[]) as added (number, line)
"""
_HOLD_TIMEOUT_S = 20.0  # long enough to take a slot and plan a session while the journal is held
_CursorOpener = Callable[[], AbstractContextManager["psycopg.Cursor[Any]"]]


class PostgresJournal(Journal[Line], Generic[Line]):
    """A journal in the rows of a table; the journal's own row is locked while a process holds it.

    Args:
        url: the address in libpq's form, postgresql://user@host/database.
        name: the journal's name.
        decode: decodes a line, or returns None to skip it.
        chained: whether each line has a checksum and the head of the chain before it, as in ``FileJournal``.
        declaration: a line that is written before the first added line, as in ``FileJournal``; None for none.
    """

    def __init__(
        self,
        url: str,
        name: str,
        decode: LineDecoder[Line],
        *,
        chained: bool = False,
        declaration: Line | None = None,
    ) -> None:
        self._name = name
        self._decode = decode
        self._chained = chained
        self._declaration = declaration
        self._chain = LineChain(name)
        self._database = Database(url, _TABLES, name, timeout_s=_HOLD_TIMEOUT_S)
        self._generation = -1
        self._last_number = 0  # of the last line that was read
        self._lines: list[Line] = []

    @property
    def begun(self) -> bool:
        """Whether the journal has a line."""
        return bool(self.read())

    @property
    def unchained(self) -> int:
        """The number of lines read that have no checksum."""
        return self._chain.unchained

    def read(self) -> Sequence[Line]:
        """Return all lines; empty if the journal does not exist."""
        # no transaction: if lines are removed between the two queries, the next call sees a new generation
        with self._open_cursor_by(self._database.open_cursor) as cursor:
            row = cursor.execute("select generation from minihuman_journals where name = %s", [self._name]).fetchone()
            return self._read_new_lines(cursor, row[0]) if row else ()

    @contextmanager
    def hold(self) -> Iterator[LockedJournal[Line]]:
        """Lock the journal's row while the context lasts, and yield the locked journal.

        The lock also ends with the connection. The lines that are added are committed when the context ends.
        """
        with self._open_cursor_by(self._database.transaction) as cursor:
            lines = self._read_new_lines(cursor, self._lock_row(cursor))
            chain = self._chain.copy() if self._chained else None
            yield _LockedRows(cursor, self._name, self._last_number, lines, self._declaration, chain)

    def keep(self, is_kept: Callable[[bytes], bool]) -> None:
        """Delete the lines for which ``is_kept`` returns false, and make all readers read the journal again."""
        with self._open_cursor_by(self._database.transaction) as cursor:
            self._lock_row(cursor)
            rows = cursor.execute(
                "select number, line from minihuman_lines where journal = %s", [self._name]
            ).fetchall()
            removed_numbers = [number for number, line in rows if not is_kept(bytes(line))]
            if removed_numbers:
                delete = "delete from minihuman_lines where journal = %s and number = any(%s)"
                cursor.execute(delete, [self._name, removed_numbers])
                cursor.execute(
                    "update minihuman_journals set generation = generation + 1 where name = %s", [self._name]
                )

    def close(self) -> None:
        """Close the connection; the next query opens another."""
        self._database.close()

    def _lock_row(self, cursor: "psycopg.Cursor[Any]") -> int:
        """Lock the journal's row, after inserting it if necessary; return the journal's generation."""
        select = "select generation from minihuman_journals where name = %s for update"
        insert = "insert into minihuman_journals (name) values (%s) on conflict do nothing"
        while (row := cursor.execute(select, [self._name]).fetchone()) is None:
            cursor.execute(insert, [self._name])
        return int(row[0])

    def _read_new_lines(self, cursor: "psycopg.Cursor[Any]", generation: int) -> Sequence[Line]:
        """Read the lines added since the last call, or all lines if the generation differs; return all lines.

        Args:
            cursor: a cursor of the database.
            generation: the journal's present generation, a number that grows when lines are removed.
        """
        if generation != self._generation:
            self._generation = generation
            self._last_number = 0
            self._lines = []
            self._chain = LineChain(self._name)
        select = "select number, line from minihuman_lines where journal = %s and number > %s order by number"
        for number, line in cursor.execute(select, [self._name, self._last_number]).fetchall():
            chain = self._chain.copy()  # so that a line that is refused or cannot be decoded changes nothing
            content = bytes(line)
            if self._chained:
                content = chain.open(content, number)
            if content:
                decoded = self._decode(content, number)
                if decoded is not None:
                    self._lines.append(decoded)
            self._last_number = number
            self._chain = chain
        return LinesRead(self._lines)

    @contextmanager
    def _open_cursor_by(self, open_cursor: "_CursorOpener") -> Iterator["psycopg.Cursor[Any]"]:
        """Yield the cursor that a method of ``Database`` opens.

        Raises:
            JournalDatabaseError: if the database cannot be queried; the next read then begins at the first line.
        """
        try:
            with open_cursor() as cursor:
                yield cursor
        except JournalDatabaseError:
            self._generation = -1  # the transaction whose lines were read may have been rolled back
            raise


class _LockedRows(LockedJournal[Line]):
    def __init__(
        self,
        cursor: "psycopg.Cursor[Any]",
        name: str,
        last_number: int,
        lines: Sequence[Line],
        declaration: Line | None,
        chain: LineChain | None,
    ) -> None:
        super().__init__(lines, declaration)
        self._cursor = cursor
        self._name = name
        self._last_number = last_number
        self._chain = chain

    def _write(self, lines: tuple[Line, ...]) -> None:
        """Insert lines, which are durable once the transaction has ended."""
        encoded = [msgspec.json.encode(line) for line in lines]
        if self._chain is not None:
            encoded = [self._chain.seal(line) for line in encoded]
        first_number = self._last_number + 1
        numbers = list(range(first_number, first_number + len(encoded)))
        self._cursor.execute(_ADD, [self._name, numbers, encoded])  # one round trip for all: there may be 1,000 links
        self._last_number += len(encoded)
