"""Leases of sessions in a database that several servers share: one hosts a session, and the next can resume it.

A lease expires unless its holder renews it. Each lease has a fence, a number that grows: a holder with an older fence
can no longer write. The database also keeps copies of what the holders have recorded.

If a study's journals are files, all its servers are on one machine, and the lock of the live log replaces the lease.
"""

import abc
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.errors import LogError
from minihuman.storage.study_journals import find_database_url

if TYPE_CHECKING:
    from psycopg import Cursor

TTL_S = 10.0
RENEWAL_INTERVAL_S = 3.0


class LeaseHeldError(LogError):
    """Another server hosts the session, and was asked to hand it over."""


class LeaseLostError(LogError):
    """Another server has the session now."""


@dataclass(frozen=True, slots=True)
class LeaseGrant:
    """The database's answer to a server that requests a lease."""

    fence: int
    name: str  # of the session, for its page: random, the same for every holder
    ended: str = ""  # why the session ended for good; then nothing is leased
    copied: bool = False  # whether any server has copied a log of it
    idle_s: float = 0.0  # since a server last copied a log of it


@dataclass(frozen=True, slots=True)
class LogPiece:
    """The bytes of a live log from a given position onwards."""

    file: str
    start: int  # the position, in bytes from the log's start, of the first byte of ``data``
    data: bytes


@dataclass(frozen=True, slots=True)
class LeaseRenewal:
    """A lease to renew, with the bytes to add to the copy of its log."""

    session: str
    fence: int
    piece: LogPiece | None = None


class LeaseTable(abc.ABC):
    """The leases of a study's sessions, and copies of their logs, timed by the database's clock.

    Every method raises OSError if the database cannot be queried. It is then unknown whether the operation was done,
    and it can be repeated.
    """

    @abc.abstractmethod
    def acquire(self, session: str) -> LeaseGrant | None:
        """Lease a session for ``TTL_S`` seconds.

        Returns:
            The grant; if it has an ``ended``, the session has ended for good, and nothing is leased. None if another
            server has the lease; the session is then marked as requested, so that this server hands it over.
        """

    @abc.abstractmethod
    def renew(self, renewals: Sequence[LeaseRenewal]) -> dict[str, bool]:
        """Renew leases and add pieces to copies, all or none; a piece replaces the copy from its own position onwards.

        Returns:
            For each session whose lease was renewed, whether another server requests it. Sessions that have ended, or
            whose lease has a newer fence, are absent.
        """

    @abc.abstractmethod
    def store(self, session: str, fence: int, files: Mapping[str, bytes]) -> bool:
        """Replace the copies of a session's files, whose contents are given by name.

        Returns:
            True; or False, without a change, if the lease has a newer fence, so that another server may have it.
        """

    @abc.abstractmethod
    def read_files(self, session: str) -> dict[str, bytes]:
        """Return the copies of a session's files, by name; empty if there are none."""

    @abc.abstractmethod
    def release(self, session: str, fence: int, *, ended: str = "") -> bool:
        """End a lease, and record why the session ended if it ended for good.

        Args:
            session: the session's name.
            fence: the fence of the lease.
            ended: the reason why the session ended for good; "" if it can be leased again.

        Returns:
            True; or False, without a change, if the lease has a newer fence or the session has another ending.
        """

    @abc.abstractmethod
    def forget(self, prefix: str) -> None:
        """Delete the copies of all sessions whose names begin with ``prefix``; revoke their leases and endings."""


def open_lease_table(study_dir: Path) -> LeaseTable | None:
    """Open the database table of a study's leases; return None if the study's journals are files."""
    if url := find_database_url(study_dir):
        return PostgresLeaseTable(url)
    return None


_TABLES = """
create table if not exists minihuman_leases (
    session text primary key,
    name text not null,
    fence bigint not null default 0,
    until timestamptz not null default '-infinity',
    wanted boolean not null default false,
    ended text not null default '',
    copied_at timestamptz  -- null: never
);
create table if not exists minihuman_log_copies (
    session text not null references minihuman_leases (session),
    file text not null,
    start bigint not null,  -- the byte at which it belongs
    data bytea not null,
    primary key (session, file, start)
)
"""
_TIMEOUT_S = 5.0  # half a lease
_INSERT = "insert into minihuman_log_copies (session, file, start, data) values (%s, %s, %s, %s)"


class PostgresLeaseTable(LeaseTable):
    """Leases in two tables of a PostgreSQL database; each method is a transaction that locks the session's row.

    Args:
        url: the address in libpq's form.
    """

    def __init__(self, url: str) -> None:
        from minihuman.storage.database import Database  # psycopg: only where journals are in a database

        purpose = "the session leases"
        self._database = Database(url, _TABLES, purpose, timeout_s=_TIMEOUT_S)
        self._renewals = Database(url, _TABLES, purpose, timeout_s=_TIMEOUT_S)  # never wait for a server that acquires

    def acquire(self, session: str) -> LeaseGrant | None:
        """Lease a session, or mark it as requested, in one SQL statement, so that all conditions see the same time."""
        insert_or_update = """
            insert into minihuman_leases as had (session, name, fence, until)
                values (%s, %s, 1, now() + make_interval(secs => %s))
            on conflict (session) do update set
                fence = had.fence + (had.ended = '' and had.until <= now())::int,
                until = case when had.ended = '' and had.until <= now() then excluded.until else had.until end,
                wanted = had.ended = '' and had.until > now()
            returning fence, name, ended, wanted, copied_at is not null,
                coalesce(extract(epoch from clock_timestamp() - copied_at), 0)
        """
        with self._database.open_cursor() as cursor:
            row = cursor.execute(insert_or_update, [session, secrets.token_hex(8), TTL_S]).fetchone()
        assert row is not None
        fence, name, ended, is_held, copied, idle_s = row
        if is_held:
            return None
        return LeaseGrant(fence, name, ended, copied, float(idle_s))

    def renew(self, renewals: Sequence[LeaseRenewal]) -> dict[str, bool]:
        """Renew leases in the order of their sessions' names, so that no two servers wait for each other."""
        ordered = sorted(renewals, key=lambda renewal: renewal.session)
        names = [renewal.session for renewal in ordered]
        fences = [renewal.fence for renewal in ordered]
        lock_and_select = """
            select leases.session, wanted from minihuman_leases as leases
            join unnest(%s::text[], %s::bigint[]) as mine (session, fence)
                on leases.session = mine.session and leases.fence = mine.fence
            where ended = '' order by leases.session for update of leases
        """
        with self._renewals.transaction() as cursor:
            wanted_by_session = dict(cursor.execute(lock_and_select, [names, fences]).fetchall())
            cursor.execute(
                "update minihuman_leases set until = clock_timestamp() + make_interval(secs => %s)"
                " where session = any(%s)",
                [TTL_S, [*wanted_by_session]],
            )
            pieces = [
                (renewal.session, renewal.piece)
                for renewal in ordered
                if renewal.piece is not None and renewal.session in wanted_by_session
            ]
            if pieces:
                _append_to_copies(cursor, pieces)
            return wanted_by_session

    def store(self, session: str, fence: int, files: Mapping[str, bytes]) -> bool:
        """Replace the copies of a session's files; return False, without a change, if the lease has a newer fence."""
        mark_copied = "update minihuman_leases set copied_at = clock_timestamp() where session = %s and fence = %s"
        with self._database.transaction() as cursor:
            if cursor.execute(mark_copied, [session, fence]).rowcount != 1:
                return False
            cursor.execute("delete from minihuman_log_copies where session = %s", [session])
            for name, content in files.items():
                cursor.execute(_INSERT, [session, name, 0, content])
            return True

    def read_files(self, session: str) -> dict[str, bytes]:
        """Return the copies of a session's files, joined from their pieces."""
        select = "select file, start, data from minihuman_log_copies where session = %s order by file, start"
        copies: dict[str, bytearray] = {}
        with self._database.transaction() as cursor:
            for name, start, piece in cursor.execute(select, [session]).fetchall():
                copy = copies.setdefault(name, bytearray())
                del copy[start:]  # the piece replaces the copy from its own position onwards
                copy += piece
        return {name: bytes(copy) for name, copy in copies.items()}

    def release(self, session: str, fence: int, *, ended: str = "") -> bool:
        """Let a lease expire at once; return False if it has a newer fence or the session has another ending."""
        end_lease = """
            update minihuman_leases set until = '-infinity', wanted = false, ended = %s
            where session = %s and fence = %s and ended in ('', %s)
        """
        with self._database.transaction() as cursor:
            return bool(cursor.execute(end_lease, [ended, session, fence, ended]).rowcount == 1)

    def forget(self, prefix: str) -> None:
        """Delete the copies of sessions, and revoke their leases and endings; the fences keep growing."""
        with self._database.transaction() as cursor:
            cursor.execute(
                """
                update minihuman_leases set fence = fence + 1, until = '-infinity', ended = '', copied_at = null
                where starts_with(session, %s)
                """,
                [prefix],
            )
            cursor.execute("delete from minihuman_log_copies where starts_with(session, %s)", [prefix])


def _append_to_copies(cursor: "Cursor[Any]", pieces: Sequence[tuple[str, LogPiece]]) -> None:
    """Add pieces, each given after its session's name, to the copies of logs.

    A piece replaces its copy from the piece's own position onwards.
    """
    cursor.executemany(
        "delete from minihuman_log_copies where session = %s and file = %s and start >= %s",
        [(session, piece.file, piece.start) for session, piece in pieces],
    )
    cursor.executemany(_INSERT, [(session, piece.file, piece.start, piece.data) for session, piece in pieces])
    cursor.execute(
        "update minihuman_leases set copied_at = clock_timestamp() where session = any(%s)",
        [[session for session, _ in pieces]],
    )
