"""Withdraw a participant: erase their data or move them to an archive, and leave a tombstone in the enrolment log.

The archive is made first, then the tombstone, then the files are deleted: on a full disk nothing is changed, and from
the tombstone on the participant is excluded, whatever happens to the files.
"""

import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from minihuman.admin.enrolment_entries import NO_NOTE, AuditNote, ParticipantReplaced, ParticipantWithdrawn
from minihuman.admin.enrolment_log import now_text, record_departure
from minihuman.admin.recruitment import Recruitment
from minihuman.admin.remote_logs import delete_remote_logs
from minihuman.dataset.caches import list_caches
from minihuman.dataset.log_files import read_withdrawn_codes
from minihuman.dataset.remote_tables import delete_remote_tables
from minihuman.errors import AllocationError, name_output_when_full
from minihuman.experiment.plan.expansion import parse_participant_code
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.operating_system import hash_file, sync_file, sync_folder
from minihuman.storage.lease import open_lease_table
from minihuman.storage.remote_store import RemoteStoreError


@dataclass(frozen=True, slots=True)
class WithdrawalResult:
    """What was taken out of a study's folder."""

    files: int
    bytes: int
    sealed: Path | None  # the archive that holds them now
    sha256: str  # the archive's, hexadecimal; "" without one
    partitions: int | None = None  # of tables, removed from their remote store; None: there is none

    def line(self) -> str:
        """Say so, naming nobody."""
        what = f"{self.files} files, {self.bytes / 1e6:.1f} MB"
        what = f"{what} sealed in {self.sealed}, SHA-256 {self.sha256}" if self.sealed else f"{what} erased"
        stored = f"{self.partitions} files of tables removed from the remote store"
        return what if self.partitions is None else f"{what}; {stored}"


def withdraw_participant(
    study_dir: Path, code: str, *, seal: Path | None, note: AuditNote = NO_NOTE
) -> WithdrawalResult:
    """Take a participant out of a study: erase what there is of them, or move it into one archive elsewhere.

    Done twice it does the rest of what was cut short. What was made of the data before (figures, reports, exports) lies
    elsewhere and is to be made again.

    Args:
        study_dir: the study's folder.
        code: "sub-07".
        seal: a ZIP archive to be made, outside of the study's folder; None erases.
        note: why, and who does it, for the enrolment log.

    Raises:
        AllocationError: if that is no code or nobody's, a session of theirs is running, or the archive cannot be made.
        RemoteStoreError: if logs or tables cannot be removed from a remote store; all else is done.
    """
    parse_participant_code(code)  # nothing but a participant's folder is ever taken out
    folder = study_dir / code
    if any(is_being_recorded(part) for part in folder.rglob(f"*{PART_SUFFIX}")):
        raise AllocationError(f"a session of {code} is running; end it before withdrawing the participant")
    if seal is not None:
        _check_archive(seal, study_dir)
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    size_bytes = sum(path.stat().st_size for path in files)
    with _archive_files(files, seal, study_dir) as sha256:
        kept: Literal["erased", "sealed"] = "erased" if seal is None else "sealed"
        if code not in read_withdrawn_codes(study_dir):  # else the rest of an earlier withdrawal
            record_departure(study_dir, ParticipantWithdrawn(code, now_text(), kept, note.reason, note.experimenter))
    if folder.is_dir():
        shutil.rmtree(folder)
    for cache in list_caches(study_dir):  # free pages remember
        shutil.rmtree(cache) if cache.is_dir() else cache.unlink()
    Recruitment(study_dir).forget(code)
    leases = open_lease_table(study_dir)
    if leases is not None:
        leases.forget(f"{study_dir.name}/{code}/")
    sync_folder(study_dir)
    try:
        delete_remote_logs(study_dir.absolute().parent, f"{study_dir.name}/{code}/")
        partitions = delete_remote_tables(study_dir, code)
    except RemoteStoreError as error:
        raise RemoteStoreError(
            f"{code} has withdrawn, and their data are gone from {study_dir}, but {error}; run the command again once "
            "the remote store can be reached, which removes the rest"
        ) from error
    return WithdrawalResult(len(files), size_bytes, seal, sha256, partitions)


def replace_participant(study_dir: Path, code: str, note: AuditNote = NO_NOTE) -> None:
    """Offer the slot of a participant who does not come back to the next; what they did stays, and counts.

    Raises:
        AllocationError: if there is no such participant.
    """
    record_departure(study_dir, ParticipantReplaced(code, now_text(), note.reason, note.experimenter))


def _check_archive(seal: Path, study_dir: Path) -> None:
    if seal.exists():
        raise AllocationError(f"{seal} already exists; name another archive with --archive")
    if seal.resolve().is_relative_to(study_dir.resolve()):
        raise AllocationError(f"{seal} is inside the study's folder; choose a path outside it with --archive")


@contextmanager
def _archive_files(files: list[Path], archive: Path | None, study_dir: Path) -> Iterator[str]:
    """Put files into an archive, durable, and give its SHA-256; an error, here or inside, takes the archive away."""
    if archive is None:
        yield ""
        return
    with name_output_when_full(archive):
        file = archive.open("xb")  # one that another program made since stays
    try:
        with name_output_when_full(archive), file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as sealed:
                for path in files:
                    sealed.write(path, path.relative_to(study_dir))
            file.flush()
            sync_file(file.fileno())
        sync_folder(archive.parent)
        yield hash_file(archive)
    except BaseException:
        archive.unlink(missing_ok=True)
        raise
