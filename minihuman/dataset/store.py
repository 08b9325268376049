"""The study store: all tables in one DuckDB file, ``tables.duckdb``, so that no log is read twice.

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

import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import duckdb
import msgspec
import pyarrow as pa

from minihuman.dataset.cached_sessions import CachedSession, KnownLog, build_cached_session, fingerprint_log
from minihuman.dataset.caches import (
    IN_USE_ERRORS,
    TABLE_CACHE as FILE_NAME,
    describe_cache,
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
from minihuman.dataset.rows import SessionTables
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import SessionRows, StudySessions, read_session_rows
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_database import (
    COUNTED_BY,
    PLANNED_TABLES,
    CatalogueChangedError,
    StoreVersionError,
    TableDatabase,
)
from minihuman.errors import LogError, QueryError
from minihuman.log.salvage.summary_section import read_first_metadata
from minihuman.moved import forward_names

_SESSIONS_PER_UPDATE = 1_000
_MAX_OPENINGS = 5  # to look, to write, to read; another command may write meanwhile
_SESSIONS_PER_COMMIT = 384  # what is left of a piece of the file is written once more then
_ROW_DIGESTS = pa.schema([("log", pa.int32()), ("row_digests", pa.list_(pa.uint64()))])
LOG_COLUMNS = "log, key, fingerprint, with_shortest, row_digests, metadata, about, facts"


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
        self._read_tables = frozenset(TABLES if tables is None else tables).union(COUNTED_BY)
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

    @property
    def is_temporary(self) -> bool:
        """Whether the tables lie in a file that goes away, not in the study's own."""
        return self._temporary is not None

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
            prints[key] = fingerprint_log(os.fspath(first), known.fingerprint if known else "", of_participant)
            if known and is_same_content(prints[key], known.fingerprint):
                metadata[key] = msgspec.msgpack.decode(known.metadata)
            else:
                metadata[key] = read_first_metadata(first)
            return metadata[key]

        paths, skipped = list_readable_logs(source, read_metadata)
        for one in skipped:
            self._sessions.skip(one)
        return {os.fspath(path)[below:]: path for path in paths}, prints, metadata

    def _list_known(self) -> dict[str, KnownLog]:
        """What the file says of each log, once."""
        found = self.tables.connection.execute("SELECT key, log, fingerprint, with_shortest, metadata FROM kept.logs")
        return {key: KnownLog(*its) for key, *its in found.fetchall()}

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
            self._read_tables |= {"plan", *PLANNED_TABLES}
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
                digests = {name: self.tables.digest_rows(name) for name in PLANNED_TABLES}
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
                    about, facts = build_cached_session(one), msgspec.msgpack.encode(one.facts)
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


def _no_room(source: Path, error: duckdb.Error) -> QueryError:
    why = str(error).splitlines()[0]
    return QueryError(f"{source}: its tables cannot be made, beside it or in {tempfile.gettempdir()}: {why}")


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
