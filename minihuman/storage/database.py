"""A connection to a PostgreSQL database that is opened on demand and closed when it takes too long."""

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import psycopg

from minihuman.storage.deadlines import cut_off_late
from minihuman.storage.redaction import redact, remember_address

_CREATE_TABLES_LOCK = 0x6D68  # the key of an advisory lock: "mh" in ASCII
_CONNECT_TIMEOUT_S = 5


class JournalDatabaseError(OSError):
    """The database that holds a study's journals cannot be queried."""


class Database:
    """A connection to a database, opened on demand and reopened after it was lost.

    A network that silently drops data does not break a connection by itself. A transaction that takes too long is
    therefore cut off on both sides: here, where the caller waits for the answer, and in the database, where others wait
    for its locks.

    Args:
        url: the address in libpq's form, postgresql://user@host/database.
        tables: SQL statements that create the tables if they do not exist.
        purpose: the use of the database, for errors: "the database of ...".
        timeout_s: the longest duration of a transaction, in seconds.
    """

    def __init__(self, url: str, tables: str, purpose: str, *, timeout_s: float) -> None:
        self._url = url
        remember_address(url)
        self._tables = tables
        self._purpose = purpose
        self._timeout_s = timeout_s
        self._guard = threading.RLock()
        self._connection: psycopg.Connection[Any] | None = None

    @contextmanager
    def transaction(self) -> Iterator["psycopg.Cursor[Any]"]:
        """Open a transaction and yield its cursor; other threads wait until it has ended.

        Raises:
            JournalDatabaseError: if the database cannot be queried; it is then unknown whether the transaction was
                committed.
        """
        with self.open_cursor() as cursor, cursor.connection.transaction():
            yield cursor

    @contextmanager
    def open_cursor(self) -> Iterator["psycopg.Cursor[Any]"]:
        """Yield a cursor on which every statement is a transaction; other threads wait until it is closed.

        Raises:
            JournalDatabaseError: if the database cannot be queried; it is then unknown whether a statement was
                committed.
        """
        with self._guard:
            try:
                connection = self._connect_if_needed()
                with self._close_after_timeout(connection), connection.cursor() as cursor:
                    yield cursor
            except psycopg.Error as error:
                self.close()
                reason = redact(" ".join(str(error).split()))  # the driver's errors have several lines
                raise JournalDatabaseError(
                    f"the database of {self._purpose} cannot be queried: {reason}; check that it is running and "
                    "reachable"
                ) from None  # the driver's error may contain the password

    def close(self) -> None:
        """Close the connection; the next query opens another."""
        with self._guard:
            if self._connection is not None:
                self._connection.close()
                self._connection = None

    def _connect_if_needed(self) -> "psycopg.Connection[Any]":
        """Return the open connection, after connecting and creating the tables if necessary."""
        if self._connection is None or self._connection.closed:
            connection = psycopg.connect(self._url, autocommit=True, connect_timeout=_CONNECT_TIMEOUT_S)
            self._connection = connection
            with self._close_after_timeout(connection), connection.transaction(), connection.cursor() as cursor:
                timeout_ms = str(round(self._timeout_s * 1000))
                cursor.execute("select set_config('idle_in_transaction_session_timeout', %s, false)", [timeout_ms])
                cursor.execute("select pg_advisory_xact_lock(%s)", [_CREATE_TABLES_LOCK])
                cursor.execute(self._tables)
        return self._connection

    @contextmanager
    def _close_after_timeout(self, connection: "psycopg.Connection[Any]") -> Iterator[None]:
        """Close the connection if the context lasts longer than the timeout; the next query then opens another."""
        with cut_off_late(self._timeout_s, partial(_shut_down_socket, connection)) as timer:
            try:
                yield
            finally:
                if not timer.is_alive():  # the timer has shut the socket, perhaps after the last answer
                    self.close()


def _shut_down_socket(connection: "psycopg.Connection[Any]") -> None:
    """Shut a connection's socket down, so that a thread that waits for the database's answer gets an error."""
    # a duplicate, since psycopg keeps and closes its own descriptor
    with suppress(OSError, psycopg.Error), socket.socket(fileno=os.dup(connection.fileno())) as duplicate:
        duplicate.shutdown(socket.SHUT_RDWR)
