"""The study store: all tables in one DuckDB file, ``tables.duckdb``, so that no log is read twice.

The file is a cache and may be deleted at any time. Every use first brings it up to date: a session is read again if the
size, time, beginning or end of its log or annotations changed, or if its rows in a requested table do not match the
stored digest. The digests are compared once: ``tables.duckdb.checked`` beside the file records which tables were
compared, and identifies the file by its size, times, beginning and end; DuckDB counts every change at the beginning.
Rows and digests change in one transaction, so that a killed process leaves each session either complete or to be read
again. Edits that also forge the digests are found by ``verify --tables``, which recomputes every table from the logs.

The store holds the tables under the default selection. For another selection, or if the file cannot be written (full
disk, no permission, locked by another process), the same tables are built in a temporary file; the latter case is
reported. They are built in a file, not in memory, because a thousand sessions would need gigabytes.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import duckdb
import msgspec

from minihuman.dataset.cached_sessions import CachedSession, KnownLog, ListedLog, list_logs
from minihuman.dataset.caches import describe_cache, is_same_content, read_checked, write_checked
from minihuman.dataset.log_files import SkippedLog
from minihuman.dataset.row_writer import SESSIONS_PER_COMMIT, RowWriter
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store_file import StoreFile
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_database import COUNTED_BY, LOG_COLUMNS, PLANNED_TABLES
from minihuman.moved import forward_names

_MAX_OPENINGS = 5  # to check, to write and to read; another command may write in between


class _Damage(NamedTuple):
    """The parts of a file whose rows no longer have the digests with which they were written."""

    changed: set[int]  # numbers of sessions with changed rows or log lines, and of rows without a session
    doubled: set[str]  # keys of logs that the file holds more than once


class StudyStore(AbstractContextManager["StudyStore", None]):
    """The tables of a study's sessions, brought up to date when the store is opened. Use it in a ``with`` statement.

    Opening the store fills the sessions' account.

    Args:
        sessions: the study's sessions, with the selection that decides what is included.
        with_shortest: whether to compute the fewest possible steps, which requires the worlds themselves.
        tables: the tables that will be read; only their digests are compared.
        with_account: whether to fill in ``cached_sessions`` and the account; otherwise the account lists only the
            skipped logs.

    Raises:
        LogError: if there is no such file or folder, or it is a single log that cannot be read.
        QueryError: if there is no space for the tables, beside the study or in the temporary folder.
    """

    def __init__(
        self,
        sessions: StudySessions,
        *,
        with_shortest: bool,
        tables: Collection[str] | None = None,
        with_account: bool = True,
    ) -> None:
        self.cached_sessions: tuple[CachedSession, ...] = ()  # one per log, in the order of paths
        self.selection = sessions.selection
        self._sessions = sessions
        self._with_shortest = with_shortest
        self._read_tables = frozenset(TABLES if tables is None else tables).union(COUNTED_BY)
        self._keys: tuple[str, ...] = ()
        self._known: dict[str, KnownLog] = {}  # while the rows are brought up to date
        self._described = ""  # describes the file as of the comparison with the digests
        self._compared = frozenset[str]()  # the tables that were compared; empty if nothing was
        self._file = StoreFile(sessions)
        self.tables = self._file.open_database(read_only=True)
        try:
            logs = self._list_and_refresh()
            self._fill_account(logs, include_readable=with_account)
            self._known = {}
        except duckdb.Error as error:
            self.close()
            raise self._file.build_no_space_error(error) from error
        except BaseException:
            self.close()
            raise

    @property
    def is_temporary(self) -> bool:
        """Return whether the tables lie in a temporary file instead of the study's own."""
        return self._file.is_temporary

    def facts(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Yield the path of a log and the facts of an episode, for each included episode."""
        paths = {key: self._sessions.source / key for key in self._keys}
        rows = self.tables.connection.execute("SELECT key, facts FROM kept.logs WHERE facts IS NOT NULL")
        while lines := rows.fetchmany(SESSIONS_PER_COMMIT):
            for key, encoded_facts in lines:
                for facts in msgspec.msgpack.decode(encoded_facts):
                    yield paths[key], facts

    def close(self) -> None:
        """Close the file, so that other processes can use it."""
        self.tables.close()
        self._file.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _list_and_refresh(self) -> dict[str, ListedLog]:
        """Bring the rows up to date, in a temporary file if the study's own fails; return the readable logs by key."""
        self._described = describe_cache(self.tables.path)
        self._compared = read_checked(self.tables.path)
        self._known = self._list_known()
        logs, skipped = list_logs(self._sessions.source, self._known if self._compared else {})
        for log in skipped:
            self._sessions.skip(log)
        try:
            self._bring_up_to_date(logs)
        except duckdb.Error as error:
            if self._file.is_temporary:
                raise
            self.tables.close()
            self._file.note_unusable_file(error)
            self.tables = self._file.open_temporary()
            self._known = {}
            self._compared = frozenset()
            self._refresh(logs)
        return logs

    def _list_known(self) -> dict[str, KnownLog]:
        """Return the file's description of each log, by key."""
        rows = self.tables.connection.execute("SELECT key, log, fingerprint, with_shortest, metadata FROM kept.logs")
        return {key: KnownLog(*facts) for key, *facts in rows.fetchall()}

    def _bring_up_to_date(self, logs: Mapping[str, ListedLog]) -> None:
        """Rewrite stale rows, and leave the study's file open for reading only, so that other processes can read it.

        Tables compared before the file was closed are not compared again unless the file changed in the meantime.

        Raises:
            duckdb.TransactionException: if other commands change the file again and again.
        """
        for _ in range(_MAX_OPENINGS):
            is_fresh = self._refresh(logs)
            if is_fresh and (self.tables.read_only or self._file.is_temporary):
                if not self._file.is_temporary and read_checked(self.tables.path) != self._compared:
                    write_checked(self.tables.path, self._compared)
                return
            if not self.tables.read_only:
                self.tables.connection.execute("CHECKPOINT")
                self._described = describe_cache(self.tables.path)
            self.tables.close()
            self.tables = self._file.open_database(read_only=is_fresh)
            described = describe_cache(self.tables.path)
            if described != self._described:
                self._described = described
                self._compared = frozenset()
            self._known = self._list_known()
        raise duckdb.TransactionException("other commands are changing it")

    def _refresh(self, logs: Mapping[str, ListedLog]) -> bool:
        """Bring every session's rows up to date, and return True.

        Return False, without any change to the file, if the file is open for reading only and would have to be written.
        """
        if any(self._lacks_shortest(log) for log in self._known.values()):
            self._read_tables |= {"plan", *PLANNED_TABLES}
        damage = self._find_damage()
        fresh, without_shortest = self._find_fresh_sessions(logs, damage)
        is_damaged = bool(damage.changed or damage.doubled)
        if not is_damaged:
            self._compared |= self._read_tables
        all_fresh = fresh.keys() == logs.keys() == self._known.keys()
        if self.tables.read_only and (is_damaged or not all_fresh):
            return False
        writer = RowWriter(self.tables, self._sessions, with_shortest=self._with_shortest)
        fresh |= writer.fill_path_measures(without_shortest)
        damaged = damage.changed | {self._known[key].number for key in damage.doubled}
        if damaged:
            self._file.note_damage(len(damaged))
        ((stored_numbers,),) = self.tables.connection.execute(
            "SELECT coalesce(list(log), []) FROM kept.logs"
        ).fetchall()
        stale_numbers = damage.changed.union(stored_numbers).difference(fresh.values())
        writer.remove(sorted(stale_numbers))
        unread = {key: log for key, log in logs.items() if key not in fresh}
        if unread:
            writer.store_logs(unread)
        self._compared |= self._read_tables
        return True

    def _lacks_shortest(self, log: KnownLog) -> bool:
        """Return whether the fewest possible steps are requested and the rows of a session lack them."""
        return self._with_shortest and not log.with_shortest

    def _find_damage(self) -> _Damage:
        """Find the sessions whose rows or log lines differ from their digests, and the logs that are stored twice.

        Only requested tables that were not compared yet are read. A file that this object created has no damage.
        """
        changed = set[int]()
        doubled = set[str]()
        if self.tables.is_new:
            return _Damage(changed, doubled)
        if not self._compared:
            connection = self.tables.connection
            changed_lines = f"SELECT log FROM kept.logs WHERE digest IS DISTINCT FROM hash({LOG_COLUMNS})"
            changed = {log for (log,) in connection.execute(changed_lines).fetchall()}
            doubled_keys = "SELECT key FROM kept.logs GROUP BY key HAVING count(*) > 1"
            doubled = {key for (key,) in connection.execute(doubled_keys).fetchall()}
        for name in self._read_tables - self._compared:
            changed |= self.tables.find_changed(name)
        return _Damage(changed, doubled)

    def _find_fresh_sessions(
        self, logs: Mapping[str, ListedLog], damage: _Damage
    ) -> tuple[dict[str, int], dict[str, int]]:
        """Find the sessions whose rows match their logs.

        Returns:
            By key, the numbers of the sessions that are complete, and of those that lack only the fewest possible
            steps.
        """
        fresh: dict[str, int] = {}
        without_shortest: dict[str, int] = {}
        for key, stored_log in self._known.items():
            if stored_log.number in damage.changed or key in damage.doubled:
                continue
            if key not in logs or not is_same_content(logs[key].fingerprint, stored_log.fingerprint):
                continue
            if self._lacks_shortest(stored_log):
                without_shortest[key] = stored_log.number
            else:
                fresh[key] = stored_log.number
        return fresh, without_shortest

    def _fill_account(self, logs: Mapping[str, ListedLog], *, include_readable: bool) -> None:
        """Fill in the account, the cached sessions and the order in which sessions are read.

        Without ``include_readable``, only the logs that cannot be read are put into the account.
        """
        condition = "" if include_readable else "WHERE facts IS NULL"
        rows = self.tables.connection.execute(f"SELECT key, about FROM kept.logs {condition}").fetchall()
        sessions = {key: msgspec.msgpack.decode(cached_session, type=CachedSession) for key, cached_session in rows}
        numbers = dict(self.tables.connection.execute("SELECT key, log FROM kept.logs").fetchall())
        self.tables.put_in_order([numbers[key] for key in logs])
        self.tables.checked = self._read_tables
        self._keys = tuple(logs)
        self.cached_sessions = tuple(  # with current paths, as files may have moved
            msgspec.structs.replace(sessions[key], path=str(log.path)) for key, log in logs.items() if key in sessions
        )
        for session in self.cached_sessions:
            if session.problem:
                self._sessions.skip(SkippedLog(Path(session.path), session.problem))
            else:
                self._sessions.account.add(session.to_summary())


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
