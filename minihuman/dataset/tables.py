"""The tables of one selection, from one open store: what reports, figures, planning and exports are made of.

Nothing above opens a log or the store. What they need and no table holds (poses, maps, key presses, the protocol) is
read here, a session at a time.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.dataset.selection import SelectedSession, Selection, SelectionSummary
from minihuman.dataset.sessions import StudySessions
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.log.model.session_log import SessionLog

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from minihuman.dataset.cached_sessions import CachedSession
    from minihuman.dataset.store import StudyStore
    from minihuman.dataset.table_catalogue import TablePartition
    from minihuman.dataset.table_files import TableFormat


class Tables(AbstractContextManager["Tables", None]):
    """A study's tables under one selection. Use it in a ``with``.

    The store is opened once, with the tables that the first ``require`` names.

    Args:
        logs: the study's, with the selection.
    """

    def __init__(self, logs: StudySessions) -> None:
        self._logs = logs
        self._opened: StudyStore | None = None
        self._has_shortest = False

    @property
    def source(self) -> Path:
        """Return the study's folder, or the one log."""
        return self._logs.source

    @property
    def selection(self) -> Selection:
        """Return which sessions and episodes are included."""
        return self._logs.selection

    @property
    def account(self) -> SelectionSummary:
        """Return what is included, and what is excluded and why, once the store is opened or the logs are read."""
        return self._logs.account

    def require(
        self, names: Collection[str] | None = None, *, shortest_paths: bool = False, with_account: bool = True
    ) -> None:
        """Open the store for some tables, unless it is open.

        Args:
            names: the tables that will be read; by default all. The digests of no others are compared.
            shortest_paths: whether the fewest possible steps are worked out, which takes the worlds themselves.
            with_account: whether ``sessions`` and the account are filled in; without, the account names what was
                skipped.

        Raises:
            LogError: if there is no such file or folder, or it is a single log that cannot be read.
            QueryError: if there is no room for the tables, beside the study or among the temporary files.
        """
        from minihuman.dataset.store import StudyStore  # a station does without tables

        if self._opened is not None:
            if shortest_paths and not self._has_shortest:
                raise AssertionError("the tables were opened without shortest paths; require these first")
            return
        self._has_shortest = shortest_paths
        self._opened = StudyStore(self._logs, with_shortest=shortest_paths, tables=names, with_account=with_account)

    @property
    def store(self) -> "StudyStore":
        """Return the open store, for what compares or copies it."""
        self.require()
        if self._opened is None:
            raise AssertionError("require opens the store")
        return self._opened

    @property
    def sessions(self) -> tuple["CachedSession", ...]:
        """Return what is known of every log, in order of path; little of one that is not selected or not readable."""
        return self.store.cached_sessions

    def arrow(self, name: str, columns: Sequence[str] | None = None, *, included: bool = False) -> "pa.Table":
        """Return a table, or some of its columns; ``included`` leaves out the rows that do not count."""
        return self.store.tables.table(name, columns, counting=included)

    def frame(self, name: str, columns: Sequence[str] | None = None, *, included: bool = False) -> "pd.DataFrame":
        """Return the same as a pandas table."""
        frame: pd.DataFrame = self.arrow(name, columns, included=included).to_pandas()
        return frame

    def count(self, name: str) -> int:
        """Count a table's rows."""
        return self.store.tables.count(name)

    def query(self, sql: str) -> "pa.Table":
        """Answer SQL about the tables.

        Raises:
            QueryError: if it is no SQL, or asks for what is not there.
        """
        return self.store.tables.query(sql)

    def write(
        self,
        folder: Path,
        *,
        names: Sequence[str] | None = None,
        kinds: Sequence["TableFormat"] = ("parquet", "csv"),
        without: frozenset[str] = frozenset(),
    ) -> tuple[Path, ...]:
        """Write the tables that have rows into a folder, some columns excluded; return the files."""
        from minihuman.dataset.table_files import write_tables

        return write_tables(self.store.tables, folder, names=names, kinds=kinds, without=without)

    def write_partitions(self, folder: Path) -> Iterator[tuple["TablePartition", Path]]:
        """Write the tables as a Parquet file per table and session below a folder; yield each once it is whole."""
        from minihuman.dataset.table_files import list_partitions, write_partitions

        return write_partitions(self.store, list_partitions(self.store), folder)

    def included_facts(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Yield every log with the facts of each episode in it that counts."""
        return self.store.facts()

    def read_log(self, session: "CachedSession") -> SessionLog:
        """Read the log of a session that the tables name.

        Raises:
            LogError: if it cannot be read any more.
        """
        from minihuman.log.read.session_reader import read_log

        return read_log(Path(session.path))

    def read_session(self, session: "CachedSession") -> SelectedSession:
        """Read a session that the tables name, with what counts of it.

        Raises:
            LogError: if its log cannot be read any more.
        """
        return self.selection.judge(self.read_log(session))

    def read_protocol(self, session: "CachedSession") -> Protocol | None:
        """Read the protocol that a session was played by; None if the log holds none."""
        toml = self.read_log(session).plan.protocol_toml
        if toml:
            return decode_logged_protocol(toml, session.path)
        return None

    def read_protocols(self) -> list[Protocol]:
        """Read the protocols that the selected sessions were played by, each once."""
        last_by_digest = {
            session.outline.protocol_sha256: session for session in self.sessions if session.outline is not None
        }
        protocols = (self.read_protocol(session) for session in last_by_digest.values())
        return [protocol for protocol in protocols if protocol is not None]

    def read_sessions(self) -> Iterator[SelectedSession]:
        """Read one session after the other from its log, without the store; that fills the account.

        Raises:
            LogError: if there is no such file or folder, or it is a single log that cannot be read.
        """
        if self._opened is not None:
            raise AssertionError("the store is open and has filled the account; read the sessions that it names")
        return iter(self._logs)

    def release(self) -> None:
        """Leave the study's own file to others once all tables are read; a temporary file stays open."""
        if self._opened is not None and not self._opened.is_temporary:
            self._opened.close()

    def close(self) -> None:
        """Leave the store's file to others."""
        if self._opened is not None:
            self._opened.close()

    def __exit__(self, *error: object) -> None:
        self.close()


def answer_query(tables: Tables, sql: str) -> "pa.Table":
    """Answer SQL about tables that are not open yet: those that the query reads are opened, and no others.

    Raises:
        QueryError: if it is no SQL, or asks for what is not there.
    """
    from minihuman.dataset.table_queries import find_queried_tables, needs_shortest_paths

    tables.require(find_queried_tables(sql), shortest_paths=needs_shortest_paths(sql), with_account=False)
    return tables.query(sql)


def select(
    source: Path,
    selection: Selection | None = None,
    *,
    say: Callable[[str], None] = lambda line: None,
    processes: int | None = None,
    engine: str = "local",
    from_logs: bool = False,
) -> Tables:
    """Select sessions and episodes of a study's folder, or of one log; nothing is read yet.

    Args:
        source: the folder or log.
        selection: which are included; by default all that were completed and that no rule or reviewer excludes.
        say: called with a line about each log that cannot be read.
        processes: how many read logs side by side; by default as many as there are processors.
        engine: reads logs in processes of this machine (local) or in a Ray cluster (ray).
        from_logs: believe no cache, and make the tables from the logs.
    """
    logs = StudySessions(source, selection, say=say, processes=processes, engine=engine, from_logs=from_logs)
    return Tables(logs)
