"""Planted faults, one of each class: what a programmer might get wrong, and what once was wrong here."""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from minihuman.admin.enrolment_entries import SlotFreed, open_enrolment_log
from minihuman.log.paths import study_folder
from minihuman.log.record.finalization import FinalizedLog, NotPublishedError, recover_log
from minihuman.log.record.session_leases import Lease, SessionLeases
from minihuman.storage.lease import LeaseGrant, LeaseRenewal
from minihuman.storage.system import current_system, now_text
from minihuman.web.connection import Connection
from tests.fault_simulation.database import Database, DatabaseError, LeaseDatabase
from tests.fault_simulation.page import Press, Tab
from tests.fault_simulation.simulation import Parts, ScheduledCommit, Server
from tests.fault_simulation.volume import ProcessDisk


class AcknowledgedBeforeFsync(ProcessDisk):
    """Files are said to be durable, and are not."""

    def sync(self, fd: int) -> None:
        """Make only names durable."""
        path = self.path_of(fd)
        if path.is_dir() or not path.name.endswith(".part"):
            super().sync(fd)


class FsyncErrorSwallowed(ScheduledCommit):
    """A failed fsync is taken for one that did its work."""

    def __init__(self, disk: ProcessDisk) -> None:
        super().__init__(disk)
        sync = self._sync_one

        def quietly(fd: int) -> None:
            try:
                sync(fd)
            except OSError:
                return

        self._sync_one = quietly


class ShortWriteTakenAsWhole(ProcessDisk):
    """How many bytes a write took is not looked at."""

    def write(self, fd: int, data: bytes | memoryview) -> int:
        """Write it, and say that all was."""
        super().write(fd, data)
        return len(data)


class LastChunkDropped(ProcessDisk):
    """A recovery cuts off more than what was torn."""

    def open(self, path: Any, flags: int, mode: int = 0o644) -> int:
        """Cut a chunk off a live file that is opened again."""
        fd = super().open(path, flags, mode)
        if path.suffix == ".part" and flags & os.O_RDWR and not flags & os.O_CREAT:
            size = os.fstat(fd).st_size
            if size > 21_000:
                self.truncate(fd, size - 200)
        return fd


class FolderNotSynced(ProcessDisk):
    """A new file's name is not made durable."""

    def sync(self, fd: int) -> None:
        """Make only files durable."""
        if not self.path_of(fd).is_dir():
            super().sync(fd)


class RenamedBeforeItsContent(ProcessDisk):
    """A finished log takes the live file's place before it is on the disk."""

    def sync(self, fd: int) -> None:
        """Leave finished logs out."""
        if not self.path_of(fd).name.endswith(".finishing"):
            super().sync(fd)


class ResentAsNew(Tab):
    """What was not acknowledged is sent again under new numbers and times, so that nobody knows it again."""

    def resend(self, received: int) -> None:
        """Send keys that the server may have as others."""
        kept = self.storage
        messages, kept["messages"], kept["next"] = kept["messages"], {}, received + 1
        for _, (message, press) in sorted(messages.items()):
            what = message["what"]
            number = self.send(what | {"stamp": self.now_ns()} if "stamp" in what else what, press)
            self._say(kept["messages"][number][0])


class SentTakenForArrived(Tab):
    """A page takes what it sent for what arrived."""

    def send(self, what: dict[str, Any], press: Press | None = None) -> int:
        """Forget a message once it is on its way."""
        number = super().send(what, press)
        if number and self.welcomed:
            self.acknowledge(number)
        return number


class CommitLostUnnoticed(Database):
    """A transaction that was undone is taken for one that was done."""

    def commit(self, name: str, rows: list[bytes]) -> None:
        """Go on as if nothing had been."""
        try:
            super().commit(name, rows)
        except DatabaseError:
            return


class SlotFreedTwice(Server):
    """Whoever is over gives the slot back, although it holds their data."""

    async def _finish_session(self, connection: Connection) -> None:
        await super()._finish_session(connection)
        with open_enrolment_log(self.study_dir).hold() as enrolment:
            enrolment.append(SlotFreed(connection.admission.participant, now_text()))


class TimeFromTheWallClock(Server):
    """A session's time is the wall clock's, which is set now and then."""

    async def _serve_page(self, page: Any, connection: Connection, hello: Any) -> None:
        started_ns = connection.hosted.started_ns
        connection.now_ns = lambda: current_system().clock.wall_ns() - started_ns  # type: ignore[method-assign]
        await super()._serve_page(page, connection, hello)


class TabsMixed(Server):
    """What one tab sent is acknowledged to another, which has the same numbers."""

    async def _serve_page(self, page: Any, connection: Connection, hello: Any) -> None:
        connection.host.begin_stream = lambda settled: None  # type: ignore[method-assign]
        await super()._serve_page(page, connection, hello)


class AcknowledgedBeforeCopied(SessionLeases):
    """A lease acknowledges what is on this machine's disk, and not yet in the database."""

    def acquire(self, session: str) -> Lease:
        """Give a lease that counts every write as copied."""
        lease = super().acquire(session)
        return _Eager(lease.session, lease.grant, lease.renewed_s)


class _Eager(Lease):
    def count_acknowledgeable(self, now_s: float) -> int:
        return -1 if self.lost else self._count_writes()


class ResumedFromOwnFile(SessionLeases):
    """A server resumes what it has itself, whatever another one has recorded since."""

    def restore(self, lease: Lease, folder: Path) -> None:
        """Leave the folder as it is."""


class OutdatedFileKept(SessionLeases):
    """A live file that another server has gone on with is taken for what the session ended with."""

    def recover(self, part: Path, *, only_ended: bool = False) -> FinalizedLog | None:
        """Finish what is here, whatever the database has."""
        return super().recover(part, only_ended=only_ended) if only_ended else recover_log(part)


class NamedBeforeStored(SessionLeases):
    """A finished log has its name and its head in the enrolment log, whether every server can have it or not."""

    def publish(self, lease: Lease, log: Path) -> None:
        """Let it be finished in any case."""
        with suppress(NotPublishedError):
            super().publish(lease, log)


class CopyDroppedBeforeFinished(SessionLeases):
    """What an ended session was is replaced in the database before its live file is finished."""

    def recover(self, part: Path, *, only_ended: bool = False) -> FinalizedLog | None:
        """Store the file that is about to be finished under another name."""
        name = f"{study_folder(part).name}/{part.parent.parent.name}/{part.parent.name}"
        if (lease := self.acquire(name)).grant.ended:
            self.store(lease, part.with_suffix(""))
        self.release(lease)
        return super().recover(part, only_ended=only_ended)


class FenceIgnored(LeaseDatabase):
    """A session is leased to whoever asks, and every holder may write: whose number is the newest is not looked at."""

    def acquire(self, session: str) -> LeaseGrant | None:
        """Give it away at once."""
        self._row(session).until_s = float("-inf")
        return super().acquire(session)

    def renew(self, renewals: Sequence[LeaseRenewal]) -> dict[str, bool]:
        """Take every renewal for the present holder's."""
        return super().renew([replace(each, fence=self._row(each.session).fence) for each in renewals])

    def release(self, session: str, fence: int, *, ended: str = "") -> bool:
        """Take every release for the present holder's."""
        return super().release(session, self._row(session).fence, ended=ended)


PLANTED: dict[str, Parts] = {
    "acknowledged before fsync": Parts(disk=AcknowledgedBeforeFsync),
    "failed fsync swallowed": Parts(commit=FsyncErrorSwallowed),
    "short write taken as whole": Parts(disk=ShortWriteTakenAsWhole),
    "last chunk dropped": Parts(disk=LastChunkDropped),
    "folder not synced": Parts(disk=FolderNotSynced),
    "renamed before its content": Parts(disk=RenamedBeforeItsContent),
    "resent as new": Parts(tab=ResentAsNew),
    "sent taken for arrived": Parts(tab=SentTakenForArrived),
    "lost commit unnoticed": Parts(database=CommitLostUnnoticed),
    "slot freed twice": Parts(server=SlotFreedTwice),
    "time from the wall clock": Parts(server=TimeFromTheWallClock),
    "tabs mixed": Parts(server=TabsMixed),
}
PLANTED_IN_LEASES: dict[str, Parts] = {
    "acknowledged before copied": Parts(leases=AcknowledgedBeforeCopied),
    "resumed from its own file": Parts(leases=ResumedFromOwnFile),
    "outdated file kept": Parts(leases=OutdatedFileKept),
    "fence ignored": Parts(lease_table=FenceIgnored),
}
PLANTED_AT_COMMITS: dict[str, Parts] = {
    "named before stored": Parts(leases=NamedBeforeStored),
    "copy dropped before finished": Parts(leases=CopyDroppedBeforeFinished),
}
FOUND_BY = {  # a seed that finds it on Python 3.11 to 3.13: servers die at turns of asyncio's loop, which differ
    "acknowledged before fsync": 1,
    "failed fsync swallowed": 77,
    "short write taken as whole": 13,
    "last chunk dropped": 59,
    "folder not synced": 0,
    "renamed before its content": 1,
    "resent as new": 0,
    "sent taken for arrived": 0,
    "lost commit unnoticed": 171,
    "slot freed twice": 0,
    "time from the wall clock": 3157,
    "tabs mixed": 145,
}
FOUND_BY_TWO = {
    "acknowledged before copied": 8,
    "resumed from its own file": 0,
    "outdated file kept": 65,
    "fence ignored": 3,
}
FOUND_BY_AT_COMMITS = {
    "named before stored": 39,
    "copy dropped before finished": 16,
}
