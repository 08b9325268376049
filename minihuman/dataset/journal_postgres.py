"""Journals in a PostgreSQL database, for stations and servers on several machines; and the connection to it."""

import os
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Any, Generic, TypeVar

import msgspec
import psycopg

from minihuman.dataset.journal import Journal, LineChain, LineDecoder, LinesRead, LockedJournal

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
_CREATE_TABLES_LOCK = 0x6D68
_CONNECT_TIMEOUT_S = 5
_HOLD_TIMEOUT_S = 20.0  # so long a journal may be held: a slot is taken and a session planned meanwhile
_Asking = Callable[[], AbstractContextManager["psycopg.Cursor[Any]"]]


class JournalDatabaseError(OSError):
    """The database that holds a study's journals cannot be asked."""


class Database:
    """A connection to a database, made when it is needed, and made again after it was lost.

    A network that swallows what is sent breaks no connection by itself. So a transaction that takes too long is cut
    off: here, where somebody waits for the answer, and in the database, where others wait for its locks.

    Args:
        url: as libpq has it: postgresql://user@host/database.
        tables: SQL that makes the tables where there are none.
        purpose: what it is for, in errors: "the database of ...".
        timeout_s: how long a transaction may take.
    """

    def __init__(self, url: str, tables: str, purpose: str, *, timeout_s: float) -> None:
        self._url, self._tables, self._purpose, self._timeout_s = url, tables, purpose, timeout_s
        self._guard = threading.RLock()
        self._connection: psycopg.Connection[Any] | None = None

    @contextmanager
    def transaction(self) -> Iterator["psycopg.Cursor[Any]"]:
        """A transaction; other threads wait.

        Raises:
            JournalDatabaseError: if the database cannot be asked; whether it was committed is then unknown.
        """
        with self.ask() as cursor, cursor.connection.transaction():
            yield cursor

    @contextmanager
    def ask(self) -> Iterator["psycopg.Cursor[Any]"]:
        """A cursor on which every statement is committed by itself; other threads wait.

        Raises:
            JournalDatabaseError: if the database cannot be asked; whether it was committed is then unknown.
        """
        with self._guard:
            try:
                connection = self._connected()
                with self._cut_off_late(connection), connection.cursor() as cursor:
                    yield cursor
            except psycopg.Error as error:
                self.close()
                said = " ".join(str(error).split())  # in lines
                raise JournalDatabaseError(
                    f"the database of {self._purpose} cannot be queried: {said}; check that it is running and reachable"
                ) from error

    def close(self) -> None:
        """Let go of the connection; it is made again when it is needed."""
        with self._guard:
            if self._connection is not None:
                self._connection.close()
                self._connection = None

    def _connected(self) -> "psycopg.Connection[Any]":
        if self._connection is None or self._connection.closed:
            made = psycopg.connect(self._url, autocommit=True, connect_timeout=_CONNECT_TIMEOUT_S)
            self._connection = made
            with self._cut_off_late(made), made.transaction(), made.cursor() as cursor:
                limit_ms = str(round(self._timeout_s * 1000))
                cursor.execute("select set_config('idle_in_transaction_session_timeout', %s, false)", [limit_ms])
                cursor.execute("select pg_advisory_xact_lock(%s)", [_CREATE_TABLES_LOCK])
                cursor.execute(self._tables)
        return self._connection

    @contextmanager
    def _cut_off_late(self, connection: "psycopg.Connection[Any]") -> Iterator[None]:
        timer = threading.Timer(self._timeout_s, _shut, [connection])
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            if not timer.is_alive():  # it shut the connection, after the last answer: the next call makes another
                self.close()
            timer.cancel()


def _shut(connection: "psycopg.Connection[Any]") -> None:
    with suppress(OSError, psycopg.Error), socket.socket(fileno=os.dup(connection.fileno())) as line:
        line.shutdown(socket.SHUT_RDWR)


class PostgresJournal(Journal[Line], Generic[Line]):
    """Rows of a table; its journal's row is locked while a process holds it.

    Args:
        url: as libpq has it: postgresql://user@host/database.
        name: of the journal.
        decode: reads a line.
        chained: as in ``FileJournal``.
        declaration: as there.
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
        self._name, self._decode, self._chained = name, decode, chained
        self._declaration = declaration
        self._chain = LineChain(name)
        self._database = Database(url, _TABLES, name, timeout_s=_HOLD_TIMEOUT_S)
        self._generation = -1
        self._last = 0  # number of the last line that was read
        self._lines: list[Line] = []

    @property
    def begun(self) -> bool:
        """Whether it has a line."""
        return bool(self.read())

    @property
    def unchained(self) -> int:
        """How many lines that were read have no checksum."""
        return self._chain.unchained

    def read(self) -> Sequence[Line]:
        """All lines."""
        with self._asking(self._database.ask) as cursor:  # lines taken out in between change the next generation
            row = cursor.execute("select generation from minihuman_journals where name = %s", [self._name]).fetchone()
            return self._read_on(cursor, row[0]) if row else ()

    @contextmanager
    def hold(self) -> Iterator[LockedJournal[Line]]:
        """Keep others out by the lock of a row, which ends with the connection."""
        with self._asking(self._database.transaction) as cursor:
            lines = self._read_on(cursor, self._locked(cursor))
            chain = self._chain.copy() if self._chained else None
            yield _LockedRows(cursor, self._name, self._last, lines, self._declaration, chain)

    def keep(self, wanted: Callable[[bytes], bool]) -> None:
        """Delete the others; readers read everything again."""
        with self._asking(self._database.transaction) as cursor:
            self._locked(cursor)
            rows = cursor.execute(
                "select number, line from minihuman_lines where journal = %s", [self._name]
            ).fetchall()
            out = [number for number, line in rows if not wanted(bytes(line))]
            if out:
                delete = "delete from minihuman_lines where journal = %s and number = any(%s)"
                cursor.execute(delete, [self._name, out])
                cursor.execute(
                    "update minihuman_journals set generation = generation + 1 where name = %s", [self._name]
                )

    def close(self) -> None:
        """Let go of the connection; it is made again when it is needed."""
        self._database.close()

    def _locked(self, cursor: "psycopg.Cursor[Any]") -> int:
        """Lock the journal's row, made where there is none; its generation."""
        lock = "select generation from minihuman_journals where name = %s for update"
        while (row := cursor.execute(lock, [self._name]).fetchone()) is None:
            make = "insert into minihuman_journals (name) values (%s) on conflict do nothing"
            cursor.execute(make, [self._name])
        return int(row[0])

    def _read_on(self, cursor: "psycopg.Cursor[Any]", generation: int) -> Sequence[Line]:
        if generation != self._generation:
            self._generation, self._last, self._lines = generation, 0, []
            self._chain = LineChain(self._name)
        ask = "select number, line from minihuman_lines where journal = %s and number > %s order by number"
        for number, line in cursor.execute(ask, [self._name, self._last]).fetchall():
            chain = self._chain.copy()
            whole = chain.open(bytes(line), number) if self._chained else bytes(line)
            found = self._decode(whole, number) if whole else None
            if found is not None:
                self._lines.append(found)
            self._last, self._chain = number, chain
        return LinesRead(self._lines)

    @contextmanager
    def _asking(self, how: "_Asking") -> Iterator["psycopg.Cursor[Any]"]:
        try:
            with how() as cursor:
                yield cursor
        except JournalDatabaseError:
            self._generation = -1  # what was read may have been undone
            raise


class _LockedRows(LockedJournal[Line]):
    def __init__(
        self,
        cursor: "psycopg.Cursor[Any]",
        name: str,
        last: int,
        lines: Sequence[Line],
        declaration: Line | None,
        chain: LineChain | None,
    ) -> None:
        super().__init__(lines, declaration)
        self._cursor, self._name, self._last, self._chain = cursor, name, last, chain

    def _write(self, lines: tuple[Line, ...]) -> None:
        """Insert them; they last when the transaction has ended."""
        encoded = map(msgspec.json.encode, lines)
        sealed = list(encoded if self._chain is None else map(self._chain.seal, encoded))
        numbers = list(range(self._last + 1, self._last + 1 + len(sealed)))
        self._cursor.execute(_ADD, [self._name, numbers, sealed])  # one round trip for all: there may be 1,000 links
        self._last += len(sealed)
