"""Withdraw a participant: erase their data or move them to an archive, and record the withdrawal in the enrolment log.

The archive is made first, then the withdrawal is recorded, then the files are deleted. On a full disk, nothing is
changed; once the withdrawal is recorded, the participant is excluded, whatever happens to the files. A mark in the
study's folder stays until everything is erased, so that ``status`` and ``verify`` report an interrupted erasure.
"""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from minihuman.admin.enrolment_entries import NO_NOTE, AuditNote, ParticipantReplaced, ParticipantWithdrawn
from minihuman.admin.enrolment_log import record_departure
from minihuman.admin.erasure_ledger import find_pending_machines
from minihuman.admin.local_copies import erase_local_copy, record_erasure
from minihuman.admin.recorded_outputs import withdraw_from_outputs
from minihuman.admin.remote_logs import delete_remote_logs
from minihuman.admin.unfinished_withdrawals import find_mark
from minihuman.dataset.participants_file import find_participants_file, names_participant
from minihuman.dataset.remote_tables import delete_remote_tables
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.errors import AllocationError, LogError, MinihumanError, name_output_when_full
from minihuman.experiment.plan.participant_codes import parse_participant_code
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.storage.durable_files import UNFINISHED_SUFFIX, hash_file, replace_durably, sync_folder
from minihuman.storage.erasure import erase
from minihuman.storage.remote_store import RemoteStoreError
from minihuman.storage.system import current_system, now_text

MAX_REASONS = 5  # that an error lists


class ErasureError(LogError):
    """The data of a participant who withdrew could not be erased completely."""


@dataclass(frozen=True, slots=True)
class WithdrawalResult:
    """The data that were removed from a study's folder."""

    files: int
    bytes: int
    sealed: Path | None  # the archive that contains them now
    sha256: str  # of the archive, hexadecimal; "" without one
    partitions: int | None = None  # number of table files removed from their remote store; None without one
    left: tuple[str, ...] = ()  # a line about each machine and output that still holds their data

    def line(self) -> str:
        """Describe the result in one line, without naming the participant."""
        if self.sealed:
            end = f"sealed in {self.sealed}, SHA-256 {self.sha256}"
        else:
            end = "erased"
        line = f"{self.files} files, {self.bytes / 1e6:.1f} MB {end}"
        if self.partitions is not None:
            line += f"; {self.partitions} files of tables removed from the remote store"
        return line


def _list_remains(study_dir: Path, code: str) -> Iterator[str]:
    """Yield a line about each machine that still has a copy, and about the laboratory's file.

    The line about the file of participants is yielded only if the file names the participant.
    """
    yield from find_pending_machines(study_dir)
    if names_participant(study_dir, code):
        yield f"{find_participants_file(study_dir)} still has a line about {code}; delete it"


def withdraw_participant(
    study_dir: Path, code: str, *, seal: Path | None, note: AuditNote = NO_NOTE
) -> WithdrawalResult:
    """Remove a participant from a study: erase all their data, or move them into an archive elsewhere.

    A repeated call completes an interrupted withdrawal. Outputs made earlier (figures, reports, exports) are outside
    the study's folder and must be made again.

    Args:
        study_dir: the study's folder.
        code: the participant's code.
        seal: the path of the archive to make, outside the study's folder; None erases the data.
        note: the reason and the experimenter, for the enrolment log.

    Raises:
        AllocationError: if the code is not valid or unknown, a session of the participant is running, or the archive
            cannot be made.
        OSError: if the archive or the record of the withdrawal cannot be written; nothing has then been erased.
        RemoteStoreError: if logs or tables cannot be removed from a remote store; all else has then been done.
        ErasureError: if something else cannot be erased; all that can be has then been erased.
    """
    parse_participant_code(code)  # raises for any other folder's name
    folder = study_dir / code
    if any(is_being_recorded(part) for part in folder.rglob(f"*{PART_SUFFIX}")):
        raise AllocationError(f"a session of {code} is running; end it before withdrawing the participant")
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    size_bytes = sum(path.stat().st_size for path in files)
    if seal is not None:
        _check_archive(seal, study_dir, code, files)
    with _mark_as_begun(study_dir, code), _archive_files(files, seal, study_dir) as sha256:
        disposal: Literal["erased", "sealed"] = "erased" if seal is None else "sealed"
        if code not in read_withdrawn_codes(study_dir):  # otherwise an earlier withdrawal is completed
            record_departure(
                study_dir, ParticipantWithdrawn(code, now_text(), disposal, note.reason, note.experimenter)
            )
    partitions = _erase_everywhere(study_dir, code)
    remains = (*withdraw_from_outputs(study_dir, code), *_list_remains(study_dir, code))
    _remove_mark(study_dir, code)
    return WithdrawalResult(len(files), size_bytes, seal, sha256, partitions, remains)


def _erase_everywhere(study_dir: Path, code: str) -> int | None:
    """Erase a participant's data in every place, even if an earlier place fails, and record this for other machines.

    Returns:
        The number of table files removed from their remote store; None if there is no store for tables.

    Raises:
        RemoteStoreError: if data could not be erased from a remote store; all else has then been erased.
        ErasureError: if other data could not be erased.
    """
    errors = erase_local_copy(study_dir, code)
    for act in (delete_remote_logs, record_erasure):
        try:
            act(study_dir, code)
        except (OSError, MinihumanError) as error:
            errors.append(error)
    partitions = None
    try:
        partitions = delete_remote_tables(study_dir, code)
    except (OSError, MinihumanError) as error:
        errors.append(error)
    if errors:
        raise _build_erasure_error(study_dir, code, errors) from errors[0]
    return partitions


def _build_erasure_error(study_dir: Path, code: str, errors: list[Exception]) -> MinihumanError:
    """Return the error for data that could not be erased, with the reasons and what to do.

    It is a RemoteStoreError if all errors are, and otherwise an ErasureError.
    """
    distinct = list(dict.fromkeys(map(str, errors)))  # one cause can stop several erasures
    n_unlisted = len(distinct) - MAX_REASONS
    reasons = "; ".join(distinct[:MAX_REASONS])
    if n_unlisted > 0:
        reasons += f"; and {n_unlisted} more"
    if all(isinstance(error, RemoteStoreError) for error in errors):
        return RemoteStoreError(
            f"{code} has withdrawn, and their data are gone from {study_dir}, but {reasons}; run the command again "
            "once the remote store can be reached, which removes the rest"
        )
    return ErasureError(
        f"{code} has withdrawn, but not all of their data could be erased: {reasons}; run the command again, which "
        "erases the rest"
    )


@contextmanager
def _mark_as_begun(study_dir: Path, code: str) -> Iterator[None]:
    """Create a file which shows that an erasure has begun; an error before the withdrawal is recorded removes the file.

    If the program is killed, the file stays, so that ``status`` and ``verify`` report the unfinished erasure.
    """
    mark = find_mark(study_dir, code)
    if not study_dir.is_dir():  # there is no study: reading its enrolment log raises
        yield
        return
    try:
        if mark.exists():
            sync_folder(study_dir)  # an earlier call may have been killed before this
        else:
            _write_mark(mark, code)
        yield
    except BaseException:
        with suppress(OSError, MinihumanError):
            if code not in read_withdrawn_codes(study_dir):
                _remove_mark(study_dir, code)
        raise


def _write_mark(mark: Path, code: str) -> None:
    with replace_durably(mark, mark.with_name(f".{mark.name}")) as file:
        file.write(f"If no `minihuman withdraw {code}` is running, run it again: it was cut short.\n".encode())


def _remove_mark(study_dir: Path, code: str) -> None:
    errors = erase(find_mark(study_dir, code))
    if errors:
        raise _build_erasure_error(study_dir, code, [*errors]) from errors[0]


def replace_participant(study_dir: Path, code: str, note: AuditNote = NO_NOTE) -> None:
    """Free the slot of a participant who will not come back; their data are kept and remain included.

    Args:
        study_dir: the study's folder.
        code: the participant's code.
        note: the reason and the experimenter, for the enrolment log.

    Raises:
        AllocationError: if there is no such participant, or they withdrew before.
    """
    record_departure(study_dir, ParticipantReplaced(code, now_text(), note.reason, note.experimenter))


def _check_archive(archive: Path, study_dir: Path, code: str, files: list[Path]) -> None:
    """Check the path of an archive.

    Args:
        archive: the path.
        study_dir: the study's folder.
        code: the code of the participant who withdraws.
        files: the participant's files.

    Raises:
        AllocationError: if it is inside the study's folder, or a file exists there that is not an archive of these
            files.
    """
    if archive.resolve().is_relative_to(study_dir.resolve()):
        raise AllocationError(f"{archive} is inside the study's folder; choose a path outside it with --archive")
    if archive.exists() and not _is_archived(files, archive, study_dir, code):
        raise AllocationError(f"{archive} already exists; name another archive with --archive")


def _is_archived(files: list[Path], archive: Path, study_dir: Path, code: str) -> bool:
    """Return whether an archive holds all these files, with their contents, and only files of this participant.

    False if it cannot be read.
    """
    try:
        with zipfile.ZipFile(archive) as archive_file:
            names = set(archive_file.namelist())
            if not all(name.startswith(f"{code}/") for name in names):
                return False
            paths = {path.relative_to(study_dir).as_posix(): path for path in files}
            return all(name in names and archive_file.read(name) == path.read_bytes() for name, path in paths.items())
    except (OSError, zipfile.BadZipFile):
        return False


@contextmanager
def _archive_files(files: list[Path], archive: Path | None, study_dir: Path) -> Iterator[str]:
    """Write files durably into an archive and yield its SHA-256, or "" without an archive.

    An error here or in the context removes the archive. An existing archive, which an earlier withdrawal made of these
    files, is kept as it is.

    Args:
        files: the participant's files.
        archive: the path of the archive; None for no archive.
        study_dir: the study's folder, to which the names in the archive are relative.
    """
    if archive is None:
        yield ""
        return
    if archive.exists():
        sync_folder(archive.parent)  # an earlier call may have been killed before this
        yield hash_file(archive)
        return
    try:
        with (
            name_output_when_full(archive),
            replace_durably(archive, archive.with_name(archive.name + UNFINISHED_SUFFIX)) as file,
            zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive_file,
        ):
            for path in files:
                archive_file.write(path, path.relative_to(study_dir))
        yield hash_file(archive)
    except BaseException:
        with suppress(OSError):
            current_system().disk.unlink(archive)
        raise
