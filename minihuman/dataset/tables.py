"""The tables of one selection, from one open store: the data of reports, figures, planning and exports.

Modules above this one open neither logs nor the store. What they need beyond the tables (poses, maps, key presses, the
protocol) is read here, one session at a time.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.selection import SelectedSession, Selection, SelectionSummary
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import QueryError
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.log.model.session_log import SessionLog

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from minihuman.dataset.cached_sessions import CachedSession
    from minihuman.dataset.person_table import PersonTable
    from minihuman.dataset.store import StudyStore
    from minihuman.dataset.table_catalogue import TablePartition
    from minihuman.dataset.table_files import TableFormat


class Tables(AbstractContextManager["Tables", None]):
    """A study's tables under one selection. Use it in a ``with`` statement.

    The store is opened once, with the tables that the first call of ``require`` names.

    Args:
        logs: the study's sessions, with the selection.
    """

    def __init__(self, logs: StudySessions) -> None:
        self._logs = logs
        self._opened: StudyStore | None = None
        self._has_shortest = False

    @property
    def source(self) -> Path:
        """Return the path of the study's folder, or of the single log."""
        return self._logs.source

    @property
    def selection(self) -> Selection:
        """Return the selection that decides which sessions and episodes are included."""
        return self._logs.selection

    @property
    def account(self) -> SelectionSummary:
        """Return what is included, and what is excluded and why, once the store is open or the logs have been read."""
        return self._logs.account

    def require(
        self, names: Collection[str] | None = None, *, shortest_paths: bool = False, with_account: bool = True
    ) -> None:
        """Open the store for some tables; a store that is open stays as it is, whatever tables it was opened for.

        Args:
            names: the names of the tables that will be read; by default all. Only their digests are compared.
            shortest_paths: whether to compute the fewest possible steps, which requires the worlds themselves.
            with_account: whether to fill in ``sessions`` and the account; otherwise the account lists only the skipped
                logs.

        Raises:
            LogError: if there is no such file or folder, or it is a single log that cannot be read.
            QueryError: if there is no space for the tables, beside the study or in the temporary folder.
            AssertionError: if the store is open without shortest paths, which are required now.
        """
        from minihuman.dataset.store import StudyStore  # imported here: a station is installed without DuckDB

        if self._opened is not None:
            if shortest_paths and not self._has_shortest:
                raise AssertionError("the tables were opened without shortest paths; require these first")
            return
        self._has_shortest = shortest_paths
        if names is not None and PERSON_TABLE in names:
            names = set(names) - {PERSON_TABLE}
            with_account = True  # fills in the sessions, from which the protocols are read
        self._opened = StudyStore(self._logs, with_shortest=shortest_paths, tables=names, with_account=with_account)

    @property
    def store(self) -> "StudyStore":
        """Return the open store, for code that compares or copies it."""
        self.require()
        if self._opened is None:
            raise AssertionError("require opens the store")
        return self._opened

    @property
    def sessions(self) -> tuple["CachedSession", ...]:
        """Return the cached description of every log, in order of path.

        Of logs that are not selected or not readable, ``outline`` and ``quality`` are None.
        """
        return self.store.cached_sessions

    @cached_property
    def people(self) -> "PersonTable | None":
        """Return the person table, with the laboratory's own columns; None if no protocol declares such columns.

        The table is built once; building it adds notes about `participants.csv` to the account.

        Raises:
            ParticipantsFileError: if `participants.csv` cannot be read, or does not fit the protocol.
        """
        from minihuman.dataset.person_table import build_person_table

        sessions = self.store.tables.table("participants", ["study", "participant"]).to_pylist()
        people = list(dict.fromkeys((session["study"], session["participant"]) for session in sessions))
        protocols = [self.read_log(session).plan.protocol_toml for session in self._list_protocol_sessions()]
        table = build_person_table(self.source, people, protocols)
        if table is not None:
            self.account.notes.extend(table.notes)
        return table

    def _list_protocol_sessions(self) -> list["CachedSession"]:
        """Return one selected session for each protocol under which sessions were played."""
        last_by_digest = {
            session.outline.protocol_sha256: session for session in self.sessions if session.outline is not None
        }
        return list(last_by_digest.values())

    def _require_people(self) -> "PersonTable":
        """Return the person table; raise QueryError if no protocol declares its columns."""
        if self.people is None:
            raise QueryError(
                f"the study has no table {PERSON_TABLE!r}, as its protocol declares no column of participants.csv; "
                "declare some in [[about.participant_columns]] before the first session"
            )
        return self.people

    def arrow(self, name: str, columns: Sequence[str] | None = None, *, included: bool = False) -> "pa.Table":
        """Return a table, or only ``columns`` in this order, as Arrow; with ``included``, excluded rows are omitted.

        Excluded rows of the person table are those of participants without an included session.

        Raises:
            QueryError: if the person table is requested and no protocol declares its columns.
        """
        if name != PERSON_TABLE:
            return self.store.tables.table(name, columns, counting=included)
        rows = self._require_people().rows
        if included:
            keys = ["study", "participant"]
            included_sessions = self.store.tables.table("participants", keys, counting=True)
            included_people = included_sessions.group_by(keys).aggregate([])
            rows = rows.join(included_people, keys, join_type="left semi")
        if columns is None:
            return rows
        return rows.select(columns)

    def frame(self, name: str, columns: Sequence[str] | None = None, *, included: bool = False) -> "pd.DataFrame":
        """Return a table, or only ``columns`` in this order, as a pandas data frame.

        With ``included``, excluded rows are omitted, as in ``arrow``, which raises the same errors.
        """
        frame: pd.DataFrame = self.arrow(name, columns, included=included).to_pandas()
        return frame

    def count(self, name: str) -> int:
        """Return the number of rows in a table."""
        if name == PERSON_TABLE:
            return len(self.arrow(name))
        return self.store.tables.count(name)

    def query(self, sql: str) -> "pa.Table":
        """Run SQL on the tables and return the result.

        Raises:
            QueryError: if the text is not a valid SELECT statement, refers to something that does not exist, or uses a
                file.
        """
        from minihuman.dataset.table_queries import mentions_person_table

        further: Mapping[str, pa.Table] = {}
        if mentions_person_table(sql) and self.people is not None:
            further = {PERSON_TABLE: self.people.rows}
        return self.store.tables.query(sql, further)

    def write(
        self,
        folder: Path,
        *,
        names: Sequence[str] | None = None,
        kinds: Sequence["TableFormat"] = ("parquet", "csv"),
        without: frozenset[str] = frozenset(),
    ) -> tuple[Path, ...]:
        """Write the tables that have rows, and their data dictionary, into a folder; return the paths of the files.

        Args:
            folder: the folder, which is created if it does not exist.
            names: the tables to write; None for all, with the person table if there is one.
            kinds: the file formats, each of which gets a file per table.
            without: the columns to omit.
        """
        from minihuman.dataset.table_files import write_tables

        people = None
        if names is None or PERSON_TABLE in names:
            people = self.people
        if names is not None:
            names = [name for name in names if name != PERSON_TABLE]
        return write_tables(self.store.tables, folder, names=names, kinds=kinds, without=without, people=people)

    def write_partitions(self, folder: Path) -> Iterator[tuple["TablePartition", Path]]:
        """Write the tables below a folder, one Parquet file per table and session.

        Yield each partition, with the path of its file, when the file is complete.
        """
        from minihuman.dataset.table_files import list_partitions, write_partitions

        return write_partitions(self.store, list_partitions(self.store), folder)

    def included_facts(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Yield the path of a log and the facts of an episode, for each included episode."""
        return self.store.facts()

    def read_log(self, session: "CachedSession") -> SessionLog:
        """Read the log of a session that the tables name.

        Raises:
            LogError: if the log can no longer be read.
        """
        from minihuman.log.read.session_reader import read_log

        return read_log(Path(session.path))

    def read_session(self, session: "CachedSession") -> SelectedSession:
        """Read a session that the tables name, and apply the selection to it.

        Raises:
            LogError: if the log can no longer be read.
            ProtocolError, ReportError: as for ``Selection.judge``.
        """
        return self.selection.judge(self.read_log(session))

    def read_protocol(self, session: "CachedSession") -> Protocol | None:
        """Read the protocol under which a session was played; None if the log holds none.

        Raises:
            LogError: if the log can no longer be read.
            ProtocolError: if this version cannot decode the protocol.
        """
        toml = self.read_log(session).plan.protocol_toml
        if toml:
            return decode_logged_protocol(toml, session.path)
        return None

    def read_protocols(self) -> list[Protocol]:
        """Read the protocols under which the selected sessions were played, without duplicates.

        Raises:
            LogError, ProtocolError: as for ``read_protocol``.
        """
        protocols = (self.read_protocol(session) for session in self._list_protocol_sessions())
        return [protocol for protocol in protocols if protocol is not None]

    def read_sessions(self) -> Iterator[SelectedSession]:
        """Read one session after the other from its log, without the store; iterating fills the account.

        Raises:
            LogError: if there is no such file or folder, or it is a single log that cannot be read.
            AssertionError: if the store is open already.
        """
        if self._opened is not None:
            raise AssertionError("the store is open and has filled the account; read the sessions that it names")
        return iter(self._logs)

    def release(self) -> None:
        """Close the study's own file after all tables were read, so that other processes can use it.

        A temporary file stays open, because closing it would delete the tables.
        """
        if self._opened is not None and not self._opened.is_temporary:
            self._opened.close()

    def close(self) -> None:
        """Close the store's file, so that other processes can use it."""
        if self._opened is not None:
            self._opened.close()

    def __exit__(self, *error: object) -> None:
        self.close()


def answer_query(tables: Tables, sql: str) -> "pa.Table":
    """Open the tables that a query reads, and no others, and return the query's result.

    Raises:
        QueryError: if the text is not a valid SELECT statement, or refers to something that does not exist.
    """
    from minihuman.dataset.table_queries import find_queried_tables, mentions_person_table, needs_shortest_paths

    names = find_queried_tables(sql)
    if mentions_person_table(sql):
        names |= {PERSON_TABLE}
    tables.require(names, shortest_paths=needs_shortest_paths(sql), with_account=False)
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
    """Select sessions and episodes of a study's folder, or of one log, without reading any yet.

    Args:
        source: the study's folder or the log.
        selection: the rule for what is included; by default, all completed episodes that neither a rule nor a reviewer
            excludes.
        say: called with a line about each log that is skipped, such as one that cannot be read.
        processes: the number of processes that read logs in parallel; by default the number of processors.
        engine: "local" to read logs in processes of this machine, or "ray" to read them in a Ray cluster.
        from_logs: whether to ignore the cache and build the tables from the logs.
    """
    logs = StudySessions(source, selection, say=say, processes=processes, engine=engine, from_logs=from_logs)
    return Tables(logs)
