"""Update a file of tables: read logs, insert their rows and digests, and remove stale sessions."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import NamedTuple

import msgspec
import pyarrow as pa

from minihuman.dataset.cached_sessions import CachedSession, ListedLog, build_cached_session
from minihuman.dataset.caches import transaction
from minihuman.dataset.log_files import SkippedLog, infrequent_collection, make_paths_relative, map_logs
from minihuman.dataset.rows import SessionTables
from minihuman.dataset.sessions import SessionRows, StudySessions, read_session_rows
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_database import LOG_COLUMNS, PLANNED_TABLES, TableDatabase
from minihuman.errors import LogError

SESSIONS_PER_COMMIT = 384  # each commit rewrites the last, incomplete part of the file
_SESSIONS_PER_UPDATE = 1_000
_ROW_DIGESTS = pa.schema([("log", pa.int32()), ("row_digests", pa.list_(pa.uint64()))])
_INCLUDED_SESSIONS = """
    SELECT key, log, about, row_digests FROM kept.logs SEMI JOIN kept.participants p USING (log)
    WHERE log IN (SELECT unnest(?))
    AND log NOT IN (SELECT log FROM kept.participants WHERE exclusion_reason IS NOT NULL)
"""


class _LogLine(NamedTuple):
    """The columns of a log in the table of logs that are known before its rows are inserted."""

    key: str
    fingerprint: str
    metadata: bytes
    about: bytes
    facts: bytes | None


class RowWriter:
    """Writes each session's rows and digests in one transaction, so that a session is either complete or read again.

    Args:
        tables: the file of tables.
        sessions: the study's sessions, with the selection that decides what is included.
        with_shortest: whether to compute the fewest possible steps, which requires the worlds themselves.
    """

    def __init__(self, tables: TableDatabase, sessions: StudySessions, *, with_shortest: bool) -> None:
        self._tables = tables
        self._sessions = sessions
        self._with_shortest = with_shortest

    def remove(self, numbers: Sequence[int]) -> None:
        """Remove sessions by number, together with the information about their logs."""
        if not numbers:
            return
        with transaction(self._tables.connection):
            self._tables.remove(numbers)
            self._tables.connection.execute("DELETE FROM kept.logs WHERE log IN (SELECT unnest(?))", (numbers,))

    def fill_path_measures(self, unplanned: Mapping[str, int]) -> dict[str, int]:
        """Fill in the measures that require the worlds, for included sessions that lack only these.

        Args:
            unplanned: the numbers of the sessions that lack these measures, by key.

        Returns:
            The keys and numbers of the sessions that were filled in; excluded sessions are not.
        """
        filled: dict[str, int] = {}
        waiting = iter(unplanned.values())
        while numbers := list(islice(waiting, _SESSIONS_PER_UPDATE)):
            rows = self._tables.connection.execute(_INCLUDED_SESSIONS, (numbers,)).fetchall()
            if not rows:
                continue
            practice = {
                number: msgspec.msgpack.decode(cached_session, type=CachedSession).practice
                for _, number, cached_session, _ in rows
            }
            with transaction(self._tables.connection):
                self._tables.add_path_measures(list(practice), practice)
                self._store_planned_digests({number: row_digests for _, number, _, row_digests in rows})
            filled |= {key: number for key, number, _, _ in rows}
        return filled

    def _store_planned_digests(self, former: Mapping[int, Sequence[int]]) -> None:
        """Store new digests of the tables with world columns, keeping the former digests of all other tables.

        ``former`` has each session's digests in the order of ``TABLES``, by session number.
        """
        new_digests = {name: self._tables.digest_rows(name) for name in PLANNED_TABLES}
        rows = []
        for number, former_digests in former.items():
            digest_by_table = dict(zip(TABLES, former_digests, strict=True))
            digest_by_table |= {name: digests.get(number, 0) for name, digests in new_digests.items()}
            rows.append({"log": number, "row_digests": list(digest_by_table.values())})
        new = pa.Table.from_pylist(rows, _ROW_DIGESTS)  # noqa: F841 - SQL reads it
        self._tables.connection.execute(
            "UPDATE kept.logs SET with_shortest = true, row_digests = new.row_digests, digest = NULL "
            "FROM new WHERE logs.log = new.log"
        )
        self._digest_logs()

    @infrequent_collection()
    def store_logs(self, logs: Mapping[str, ListedLog]) -> None:
        """Read logs, given by key, and store their rows, a limited number of sessions per transaction.

        Raises:
            LogError: if a log cannot be read and is the only source.
        """
        ((last_number,),) = self._tables.connection.execute("SELECT coalesce(max(log), 0) FROM kept.logs").fetchall()
        work = partial(read_session_rows, selection=self._sessions.selection, with_shortest=self._with_shortest)
        paths = [log.path for log in logs.values()]
        sessions = map_logs(paths, work, processes=self._sessions.processes, engine=self._sessions.engine)
        numbered = iter(enumerate(zip(logs.items(), sessions, strict=True), last_number + 1))
        for _ in range(0, len(logs), SESSIONS_PER_COMMIT):
            with transaction(self._tables.connection):
                self._insert_sessions(islice(numbered, SESSIONS_PER_COMMIT))

    def _insert_sessions(
        self, sessions: Iterable[tuple[int, tuple[tuple[str, ListedLog], SessionRows | SkippedLog]]]
    ) -> None:
        """Store the rows of some sessions, or why their logs cannot be read.

        Each session is given by its number, its key, its log, and its rows or the reason to skip it. Only few sessions
        are in memory at a time.
        """
        lines: dict[int, _LogLine] = {}

        def iterate_rows() -> Iterator[tuple[int, SessionTables]]:
            """Yield the rows of each readable session, after adding the line of its log to ``lines``."""
            for number, ((key, log), session) in sessions:
                cached_session, facts = self._describe(session)
                lines[number] = _LogLine(
                    key=key,
                    fingerprint=log.fingerprint,
                    metadata=msgspec.msgpack.encode(log.metadata),
                    about=msgspec.msgpack.encode(cached_session),
                    facts=facts,
                )
                if not isinstance(session, SkippedLog):
                    yield number, session.rows

        digests = self._tables.insert(iterate_rows())
        self._insert_log_lines(lines, digests)
        self._digest_logs()

    def _insert_log_lines(self, lines: Mapping[int, _LogLine], digests: Mapping[int, list[int]]) -> None:
        """Store the line of each log with the digests of its rows, which are 0 for a log that cannot be read."""
        no_digests = [0] * len(TABLES)
        self._tables.connection.executemany(
            "INSERT INTO kept.logs VALUES (?, ?, ?, ?, ?, ?, ?, ?, NULL)",
            [
                (
                    number,
                    line.key,
                    line.fingerprint,
                    self._with_shortest,
                    digests.get(number, no_digests),
                    line.metadata,
                    line.about,
                    line.facts,
                )
                for number, line in lines.items()
            ],
        )

    def _describe(self, session: SessionRows | SkippedLog) -> tuple[CachedSession, bytes | None]:
        """Return a session's cache entry and its encoded episode facts; the facts are None for an unreadable log.

        Raises:
            LogError: if the log cannot be read and is the only source.
        """
        if not isinstance(session, SkippedLog):
            return build_cached_session(session), msgspec.msgpack.encode(session.facts)
        source = self._sessions.source
        if not source.is_dir():
            raise LogError(session.reason)
        return CachedSession("", problem=make_paths_relative(source, session.reason)), None

    def _digest_logs(self) -> None:
        """Compute the digests of the newly written lines of the table of logs."""
        self._tables.connection.execute(f"UPDATE kept.logs SET digest = hash({LOG_COLUMNS}) WHERE digest IS NULL")
