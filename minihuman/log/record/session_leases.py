"""Leases sessions to the servers that host them, and restores live logs to their last acknowledged state.

The holder renews its lease and, at the same time, copies what it has recorded to the database. It acknowledges no input
that is not copied, and none at all once it has not renewed the lease for a while. A server that finds a session leased
waits until the holder hands it over or the lease runs out. It then takes the copy, and the page resends the inputs that
were not acknowledged.
"""

import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.log.paths import PART_SUFFIX, list_log_files, study_folder
from minihuman.log.record.finalization import (
    UNFINISHED_SUFFIX,
    FinalizedLog,
    NotPublishedError,
    find_leftovers,
    put_aside,
    recover_log,
)
from minihuman.storage.durable_files import replace_durably
from minihuman.storage.lease import (
    TTL_S,
    LeaseGrant,
    LeaseHeldError,
    LeaseLostError,
    LeaseRenewal,
    LeaseTable,
    LogPiece,
)
from minihuman.storage.outside_names import require_name
from minihuman.storage.system import current_system, monotonic_s

SAFETY_MARGIN_S = 2.0  # nothing is acknowledged in the last seconds of a lease
SUPERSEDED = "superseded"  # marks the name of a file that another server has replaced


@dataclass(slots=True, eq=False)
class Lease:
    """A session's lease, as its holder knows it."""

    session: str
    grant: LeaseGrant
    renewed_s: float  # on the holder's clock, before the request to the database
    lost: bool = False
    is_requested: bool = False  # another server wants the session
    copied_writes: int = -1  # the recorder's copied writes; -1 if the copy may lack data of an earlier holder
    _ended: bool = False  # whether its session has ended and cannot be resumed
    _copied: dict[str, int] = field(default_factory=dict)  # number of copied bytes, by file
    _find_part: Callable[[], Path | None] = lambda: None
    _count_writes: Callable[[], int] = lambda: 0

    def count_acknowledgeable(self, now_s: float) -> int:
        """Return how many of the recorder's writes may be acknowledged at ``now_s``, a time on the holder's clock.

        It is -1 if no more may be acknowledged.
        """
        is_held = not self.lost and now_s < self.renewed_s + TTL_S - SAFETY_MARGIN_S
        return self.copied_writes if is_held else -1

    def follow(self, find_part: Callable[[], Path | None], count_writes: Callable[[], int]) -> None:
        """Start to copy a live log.

        Args:
            find_part: returns the live log's path; None before there is one.
            count_writes: returns the number of the recorder's durable writes.
        """
        self._find_part = find_part
        self._count_writes = count_writes
        self._copied = {}  # copy everything again, since a torn end may have been cut off

    def _read_uncopied(self) -> tuple[LogPiece | None, int]:
        """Return the piece of the log that is not copied yet, and the number of durable writes that are then copied.

        The piece is None if there is no log or everything is copied.
        """
        writes = self._count_writes()  # counted first, so that the file contains them
        part = self._find_part()
        if part is None:
            return None, writes
        copied = self._copied.get(part.name, 0)
        with suppress(FileNotFoundError), part.open("rb") as file:
            file.seek(copied)
            recorded = file.read()
            if recorded:
                return LogPiece(part.name, copied, recorded), writes
        return None, writes

    def _note_copied(self, piece: LogPiece | None, writes: int) -> None:
        """Record what has been copied.

        Args:
            piece: the piece of the log that was copied; None if nothing was left to copy.
            writes: the number of the recorder's writes that are copied now.
        """
        self.copied_writes = writes
        if piece is not None:
            self._copied[piece.file] = piece.start + len(piece.data)


class SessionLeases:
    """The session leases of one server. Every method may wait for the database or the disk.

    Args:
        table: the database's table of leases.
        clock: returns the monotonic time in seconds.
    """

    def __init__(self, table: LeaseTable, *, clock: Callable[[], float] = monotonic_s) -> None:
        self._table = table
        self._clock = clock
        self._guard = threading.RLock()  # one call at a time, since copies are appended to

    def acquire(self, session: str) -> Lease:
        """Lease a session, named as in "study/sub-07/ses-01".

        Raises:
            LeaseHeldError: if another server has the lease, or had it within the last ``TTL_S`` seconds.
            OSError: if the database cannot be reached.
        """
        began_s = self._clock()
        grant = self._table.acquire(session)
        if grant is None:
            raise LeaseHeldError(
                f"{session} is running on another server, which has been asked to hand it over; try again in a moment"
            )
        return Lease(session, grant, began_s)

    def restore(self, lease: Lease, folder: Path) -> None:
        """Restore a session's files to the state that the last holder acknowledged; differing files here are put aside.

        Raises:
            OSError: if the database cannot be reached, or the folder cannot be written.
        """
        if not lease.grant.copied:
            return
        copies = {
            require_name(name, f"a file of {lease.session} in the database"): copy
            for name, copy in self._table.read_files(lease.session).items()
        }
        for part in list_log_files(folder, f"*{PART_SUFFIX}"):
            if part.name not in copies:
                put_aside(part, SUPERSEDED)
        for name, copy in copies.items():
            path = folder / name
            log = path.with_suffix("")
            if name.endswith(PART_SUFFIX) and log.name not in copies and log.exists():
                put_aside(log, SUPERSEDED)  # another server resumed the session afterwards
            if _contains_copy(path, copy):
                continue
            if path.exists():
                put_aside(path, SUPERSEDED)
            with replace_durably(path, path.with_name(f".{name}.restored"), new_folders=3) as file:
                file.write(copy)
            copied_ns = current_system().clock.wall_ns() - round(lease.grant.idle_s * 1e9)
            os.utime(path, ns=(copied_ns, copied_ns))

    def recover(self, part: Path, *, only_ended: bool = False) -> FinalizedLog | None:
        """Finish a live file that a killed server left, under the session's lease and with all that was acknowledged.

        Args:
            part: the live file.
            only_ended: whether to leave sessions alone that can still be resumed.

        Returns:
            The finished log; None if there is none to finish, because another server resumed the session and the file
            was put aside, or because the session can be resumed.

        Raises:
            LeaseHeldError: if the session runs on another server.
            OSError: if the database cannot be reached, or a file cannot be read or written; the live file remains.
            LogError: if the log cannot be finished.
        """
        lease = self.acquire(f"{study_folder(part).name}/{part.parent.parent.name}/{part.parent.name}")
        try:
            if lease.grant.ended:
                return self._recover_ended(part, lease)
            if only_ended:
                return None
            return self._recover_resumable(part, lease)
        finally:
            self.release(lease)

    def _recover_ended(self, part: Path, lease: Lease) -> FinalizedLog | None:
        """Finish a live file whose session has ended, and return the finished log.

        A file that differs from the copy in the database, which its last holder acknowledged, is put aside instead, and
        the result is None.
        """
        if self._table.read_files(lease.session).get(part.name) != part.read_bytes():
            put_aside(part, SUPERSEDED)
        if not part.exists():
            return None
        finished = recover_log(part)  # the database's copy is removed only afterwards
        with suppress(OSError):
            self.store(lease, None)
        return finished

    def _recover_resumable(self, part: Path, lease: Lease) -> FinalizedLog | None:
        """Restore a live file to its last holder's state and finish it; return the finished log.

        The result is None if no live file is left to finish, because another server resumed the session.
        """
        self.restore(lease, part.parent)
        if not part.exists():  # the other server's live file has been restored here
            part = next(iter(find_leftovers(part.parent)), part)
        if not part.exists():
            return None
        return recover_log(part, lambda log: self.publish(lease, log))

    def renew(self, leases: Sequence[Lease]) -> None:
        """Renew leases, and copy everything recorded since the last renewal.

        Raises:
            OSError: if the database cannot be reached.
        """
        with self._guard:
            began_s = self._clock()
            pieces = [(lease, *lease._read_uncopied()) for lease in leases if not lease._ended]
            renewals = [LeaseRenewal(lease.session, lease.grant.fence, piece) for lease, piece, _ in pieces]
            wanted_by_session = self._table.renew(renewals)
            for lease, piece, writes in pieces:
                lease.lost = lease.session not in wanted_by_session
                if not lease.lost:
                    lease.renewed_s = began_s
                    lease.is_requested = wanted_by_session[lease.session]
                    lease._note_copied(piece, writes)

    def end(self, lease: Lease, reason: str) -> None:
        """Copy the remaining part of the log, stop copying, and mark the session as ended if it cannot be resumed.

        Args:
            lease: the session's lease.
            reason: the reason why the session ended for good, so that no server resumes it; "" if it can be resumed.

        Raises:
            LeaseLostError: if another server has the session, so that it did not end here.
            OSError: if the database cannot be reached.
        """
        with self._guard:
            self.renew([lease])
            lease.follow(lambda: None, lambda: lease.copied_writes)
            lease._ended = bool(reason) and not lease.lost  # first, since a release without an answer is repeated
            if lease.lost or (reason and not self._table.release(lease.session, lease.grant.fence, ended=reason)):
                lease.lost = True
                raise LeaseLostError(f"{lease.session} now runs on another server")

    def store(self, lease: Lease, log: Path | None) -> None:
        """Replace the database's copies by a finished log; None removes them, if the log is stored elsewhere.

        Raises:
            LeaseLostError: if another server has the session.
            OSError: if the database cannot be reached, or the log cannot be read.
        """
        if log is not None and log.exists():
            files = {log.name.removesuffix(UNFINISHED_SUFFIX): log.read_bytes()}
        else:
            files = {}
        if not self._table.store(lease.session, lease.grant.fence, files):
            lease.lost = True
            raise LeaseLostError(f"{lease.session} now runs on another server")
        lease._copied = {}

    def publish(self, lease: Lease, log: Path) -> None:
        """Replace the copies by a log before it is renamed, so that its session is not resumed elsewhere.

        Raises:
            NotPublishedError: if the database or the log cannot be read, or another server has the session.
        """
        try:
            self.store(lease, log)
        except (OSError, LeaseLostError) as error:
            raise NotPublishedError(
                f"{log.name.removesuffix(UNFINISHED_SUFFIX)} cannot be stored in the database yet: {error}"
            ) from error

    def release(self, lease: Lease) -> bool:
        """Copy the remaining part of the log and release the lease; return False if the database cannot be reached."""
        try:
            if not lease.lost and not lease._ended and not lease.grant.ended:
                self.renew([lease])
                self._table.release(lease.session, lease.grant.fence)
        except OSError:
            return False
        finally:
            lease.lost = True
        return True


def _contains_copy(path: Path, copy: bytes) -> bool:
    """Return whether a file begins with everything that was copied of it; a finished log must be equal to its copy."""
    if not path.exists():
        return False
    content = path.read_bytes()
    if path.name.endswith(PART_SUFFIX):
        return content.startswith(copy)
    return content == copy


def name_session(study: str, participant: str, session: int) -> str:
    """Return the name of a session in the database, such as "study/sub-07/ses-01"."""
    return f"{study}/{participant}/ses-{session:02d}"
