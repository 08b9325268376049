"""Session leases in a PostgreSQL database, beside the journals."""

import secrets
from collections.abc import Mapping, Sequence

from minihuman.admin.lease import TTL_S, LeaseGrant, LeaseRenewal, LeaseTable
from minihuman.dataset.journal_postgres import Database

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
    """Rows of two tables; each method is a transaction that locks the session's row.

    Args:
        url: as libpq has it.
    """

    def __init__(self, url: str) -> None:
        purpose = "the session leases"
        self._database = Database(url, _TABLES, purpose, timeout_s=_TIMEOUT_S)
        self._renewals = Database(url, _TABLES, purpose, timeout_s=_TIMEOUT_S)  # wait for nobody who acquires

    def acquire(self, session: str) -> LeaseGrant | None:
        """Lease a session, or mark it as wanted."""
        with self._database.transaction() as cursor:
            make = "insert into minihuman_leases (session, name) values (%s, %s) on conflict do nothing"
            cursor.execute(make, [session, secrets.token_hex(8)])
            ask = """
                select fence, name, ended, until > clock_timestamp(), copied_at is not null,
                    coalesce(extract(epoch from clock_timestamp() - copied_at), 0)
                from minihuman_leases where session = %s for update
            """
            row = cursor.execute(ask, [session]).fetchone()
            assert row is not None
            fence, name, ended, is_held, copied, idle_s = row
            if is_held and not ended:
                cursor.execute("update minihuman_leases set wanted = true where session = %s", [session])
                return None
            if not ended:
                fence += 1
                take = """
                    update minihuman_leases set fence = %s, until = clock_timestamp() + make_interval(secs => %s),
                        wanted = false where session = %s
                """
                cursor.execute(take, [fence, TTL_S, session])
            return LeaseGrant(fence, name, ended, copied, float(idle_s))

    def renew(self, renewals: Sequence[LeaseRenewal]) -> dict[str, bool]:
        """Renew them in the order of their names, so that no two servers wait for each other."""
        ordered = sorted(renewals, key=lambda renewal: renewal.session)
        names, fences = [each.session for each in ordered], [each.fence for each in ordered]
        lock = """
            select leases.session, wanted from minihuman_leases as leases
            join unnest(%s::text[], %s::bigint[]) as mine (session, fence)
                on leases.session = mine.session and leases.fence = mine.fence
            where ended = '' order by leases.session for update of leases
        """
        extend = """
            update minihuman_leases set until = clock_timestamp() + make_interval(secs => %s) where session = any(%s)
        """
        with self._renewals.transaction() as cursor:
            held = dict(cursor.execute(lock, [names, fences]).fetchall())
            cursor.execute(extend, [TTL_S, [*held]])
            pieces = [(each.session, each.piece) for each in ordered if each.piece is not None and each.session in held]
            if pieces:
                replace = "delete from minihuman_log_copies where session = %s and file = %s and start >= %s"
                cursor.executemany(replace, [(session, piece.file, piece.start) for session, piece in pieces])
                rows = [(session, piece.file, piece.start, piece.data) for session, piece in pieces]
                cursor.executemany(_INSERT, rows)
                stamp = "update minihuman_leases set copied_at = clock_timestamp() where session = any(%s)"
                cursor.execute(stamp, [[session for session, _ in pieces]])
            return held

    def store(self, session: str, fence: int, files: Mapping[str, bytes]) -> bool:
        """Replace the copies."""
        mine = "update minihuman_leases set copied_at = clock_timestamp() where session = %s and fence = %s"
        with self._database.transaction() as cursor:
            if cursor.execute(mine, [session, fence]).rowcount != 1:
                return False
            cursor.execute("delete from minihuman_log_copies where session = %s", [session])
            for name, data in files.items():
                cursor.execute(_INSERT, [session, name, 0, data])
            return True

    def read_files(self, session: str) -> dict[str, bytes]:
        """Put the pieces together."""
        ask = "select file, start, data from minihuman_log_copies where session = %s order by file, start"
        found: dict[str, bytearray] = {}
        with self._database.transaction() as cursor:
            for name, start, data in cursor.execute(ask, [session]).fetchall():
                copy = found.setdefault(name, bytearray())
                del copy[start:]
                copy += data
        return {name: bytes(data) for name, data in found.items()}

    def release(self, session: str, fence: int, *, ended: str = "") -> bool:
        """Let the lease run out now."""
        over = """
            update minihuman_leases set until = '-infinity', wanted = false, ended = %s
            where session = %s and fence = %s and ended in ('', %s)
        """
        with self._database.transaction() as cursor:
            return bool(cursor.execute(over, [ended, session, fence, ended]).rowcount == 1)

    def forget(self, prefix: str) -> None:
        """Delete the copies; the numbers of leases go on."""
        take = """
            update minihuman_leases set fence = fence + 1, until = '-infinity', ended = '', copied_at = null
            where starts_with(session, %s)
        """
        with self._database.transaction() as cursor:
            cursor.execute(take, [prefix])
            cursor.execute("delete from minihuman_log_copies where starts_with(session, %s)", [prefix])
