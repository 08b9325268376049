"""A database that holds journals and leases: away, cut off from one server, or losing a commit or the word of it.

A server may die at a commit of its own: before it, or when it is done.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import msgspec

from minihuman.storage.journal import Journal, LineChain, LineDecoder, LockedJournal
from minihuman.storage.lease import LeaseGrant, LeaseRenewal
from tests.fault_simulation.schedule import ProcessKilled, Schedule
from tests.fault_simulation.volume import ProcessDisk
from tests.lab.lease_table import MemoryLeaseTable

T = TypeVar("T")
URL = "postgresql://simulated/study"


class DatabaseError(OSError):
    """As the real one's: it cannot be asked."""


class Database:
    """Rows, by journal; they outlive every process.

    Args:
        schedule: the time.
    """

    def __init__(self, schedule: Schedule) -> None:
        self.schedule = schedule
        self.rows: dict[str, list[bytes]] = {}
        self.away = False
        self.cut_off: set[str] = set()  # the machines that cannot reach it
        self.asker = ""  # the machine whose turn it is
        self.lost_commits = 0.0  # probability that a commit is undone, and the program is told so
        self.lost_answers = 0.0  # that it is done, and the program hears that it failed
        self.lost_stores = 0.0  # the same of finished logs alone, half of them done
        self.process: ProcessDisk | None = None  # whose turn it is

    def open_journal(
        self, url: str, name: str, decode: LineDecoder[Any], *, chained: bool = False, declaration: Any = None
    ) -> "DatabaseJournal":
        """A journal as one process has it."""
        return DatabaseJournal(self, name, decode, chained, declaration)

    def ask(self) -> None:
        """Refuse where it is away."""
        if self.process is not None and self.process.dead:
            raise ProcessKilled
        if self.away or self.asker in self.cut_off:
            raise DatabaseError("the database cannot be queried: connection refused")

    def commit(self, name: str, rows: list[bytes]) -> None:
        """End a transaction."""
        self.transact(f"{name}: {len(rows)} rows", lambda: self.rows.__setitem__(name, rows))

    def transact(self, what: str, do: Callable[[], T]) -> T:
        """Do something, or lose it, or lose the word of it."""
        self.ask()
        is_store = what.startswith("store ")
        dies = self.process is not None and self.process.commit(what)
        if self.schedule.chance(self.lost_commits) or (is_store and self._loses_store()):
            self.schedule.note(f"lost: {what}")
            raise DatabaseError("the database cannot be queried: the connection was lost")
        self.schedule.note(f"commit of {what}")
        found = do()
        if dies and self.process is not None:
            self.process.die()
        if self.schedule.chance(self.lost_answers) or (is_store and self._loses_store()):
            self.schedule.note(f"answer lost: {what}")
            raise DatabaseError("the database cannot be queried: the connection was lost")
        return found

    def _loses_store(self) -> bool:
        return self.lost_stores > 0 and self.schedule.chance(self.lost_stores)


class LeaseDatabase(MemoryLeaseTable):
    """The leases of a study, in the same database and on its clock.

    Args:
        database: where they are.
    """

    def __init__(self, database: Database) -> None:
        super().__init__(lambda: database.schedule.now_ns / 1e9)
        self._database = database

    def acquire(self, session: str) -> LeaseGrant | None:
        """Lease a session, or mark it as wanted."""
        return self._database.transact(f"acquire {session}", lambda: super(LeaseDatabase, self).acquire(session))

    def renew(self, renewals: Sequence[LeaseRenewal]) -> dict[str, bool]:
        """Renew leases and add to the copies."""
        return self._database.transact("renew", lambda: super(LeaseDatabase, self).renew(renewals))

    def store(self, session: str, fence: int, files: Mapping[str, bytes]) -> bool:
        """Replace the copies."""
        return self._database.transact(
            f"store {session}", lambda: super(LeaseDatabase, self).store(session, fence, files)
        )

    def read_files(self, session: str) -> dict[str, bytes]:
        """The copies."""
        self._database.ask()
        return super().read_files(session)

    def release(self, session: str, fence: int, *, ended: str = "") -> bool:
        """End a lease."""
        return self._database.transact(
            f"release {session} {ended}", lambda: super(LeaseDatabase, self).release(session, fence, ended=ended)
        )


class DatabaseJournal(Journal[Any]):
    """A journal in the database; the same contract as PostgreSQL's."""

    def __init__(
        self, database: Database, name: str, decode: LineDecoder[Any], chained: bool, declaration: Any
    ) -> None:
        self._database, self._name, self._decode, self._chained = database, name, decode, chained
        self._declaration = declaration
        self._chain = LineChain(name)

    @property
    def begun(self) -> bool:
        """Whether it has a line."""
        return bool(self.read())

    @property
    def unchained(self) -> int:
        """How many lines that were read have no checksum."""
        return self._chain.unchained

    def read(self) -> tuple[Any, ...]:
        """All lines."""
        self._database.ask()
        self._chain = LineChain(self._name)
        lines = []
        for number, row in enumerate(self._database.rows.get(self._name, []), 1):
            whole = self._chain.open(row, number) if self._chained else row
            lines.append(self._decode(whole, number) if whole else None)
        return tuple(line for line in lines if line is not None)

    def close(self) -> None:
        """Let go of the connection."""

    @contextmanager
    def hold(self) -> Iterator["_LockedTable"]:
        """A transaction, which ends with the block."""
        lines = self.read()
        held = _LockedTable(lines, self._declaration, self._chain.copy() if self._chained else None)
        yield held
        if held.added:
            self._database.commit(self._name, [*self._database.rows.get(self._name, []), *held.added])

    def keep(self, wanted: Callable[[bytes], bool]) -> None:
        """Take the others out."""
        self._database.ask()
        rows = self._database.rows.get(self._name, [])
        if not all(map(wanted, rows)):
            self._database.commit(self._name, [row for row in rows if wanted(row)])


class _LockedTable(LockedJournal[Any]):
    def __init__(self, lines: tuple[Any, ...], declaration: Any, chain: LineChain | None) -> None:
        super().__init__(lines, declaration)
        self.added: list[bytes] = []
        self._chain = chain

    def _write(self, lines: tuple[Any, ...]) -> None:
        encoded = [msgspec.json.encode(line) for line in lines]
        self.added += encoded if self._chain is None else [self._chain.seal(line) for line in encoded]
