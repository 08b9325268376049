"""Withdrawal: a participant's data out of the study, erased or sealed, and a tombstone that keeps them out.

The tombstone, a line of the register, comes first: from then on nothing counts them, whatever happens to the files.
"""

import hashlib
import os
import shutil
import zipfile
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from minihuman.data.caches import caches_in
from minihuman.errors import AllocationError
from minihuman.lab.recruits import Recruits
from minihuman.lab.register import leave
from minihuman.lab.register_lines import Replaced, Withdrawn
from minihuman.lab.shelf import take_away
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.record.claim import is_live, sync_folder
from minihuman.study.expand import participant_index


@dataclass(frozen=True, slots=True)
class Gone:
    """What was taken out of a study's folder."""

    files: int
    bytes: int
    sealed: Path | None  # the archive that holds them now
    sha256: str  # the archive's, hexadecimal; "" without one

    def line(self) -> str:
        """Say so, naming nobody."""
        what = f"{self.files} files, {self.bytes / 1e6:.1f} MB"
        return f"{what} sealed in {self.sealed}, SHA-256 {self.sha256}" if self.sealed else f"{what} erased"


def withdraw(study_dir: Path, code: str, *, seal: Path | None) -> Gone:
    """Take a participant out of a study: erase what there is of them, or move it into one archive elsewhere.

    Done twice it does the rest of what was cut short. What was made of the data before (figures, reports, exports) lies
    elsewhere and is to be made again.

    Args:
        study_dir: the study's folder.
        code: "sub-07".
        seal: a ZIP archive to be made, outside of the study's folder; None erases.

    Raises:
        AllocationError: if that is no code or nobody's, a session of theirs is running, or the archive cannot be made.
    """
    participant_index(code)  # nothing but a participant's folder is ever taken out
    folder = study_dir / code
    if any(is_live(part) for part in folder.rglob(f"*{PART_SUFFIX}")):
        raise AllocationError(f"a session of {code} is running; end it first, then withdraw")
    if seal is not None:
        _check_archive(seal, study_dir)
    at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    try:
        leave(study_dir, Withdrawn(code, at, "erased" if seal is None else "sealed"))
    except AllocationError:
        if not folder.is_dir():
            raise
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    gone = Gone(len(files), sum(path.stat().st_size for path in files), seal, "")
    if seal is not None:
        gone = Gone(gone.files, gone.bytes, seal, _seal(files, seal, study_dir))
    if folder.is_dir():
        shutil.rmtree(folder)
    for cache in caches_in(study_dir):  # free pages remember
        shutil.rmtree(cache) if cache.is_dir() else cache.unlink()
    Recruits(study_dir).forget(code)
    take_away(study_dir.absolute().parent, f"{study_dir.name}/{code}/")
    sync_folder(study_dir)
    return gone


def replace(study_dir: Path, code: str) -> None:
    """Offer the slot of somebody who does not come back to the next; what they did stays, and counts.

    Raises:
        AllocationError: if there is no such participant.
    """
    leave(study_dir, Replaced(code, datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")))


def _check_archive(seal: Path, study_dir: Path) -> None:
    if seal.exists():
        raise AllocationError(f"{seal} already exists; name another archive with --seal")
    if seal.resolve().is_relative_to(study_dir.resolve()):
        raise AllocationError(f"{seal} is inside the study's folder; seal the data elsewhere")


def _seal(files: list[Path], archive: Path, study_dir: Path) -> str:
    """Put files into an archive and make it last; give its SHA-256."""
    with archive.open("xb") as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as sealed:
            for path in files:
                sealed.write(path, path.relative_to(study_dir))
        file.flush()
        os.fsync(file.fileno())
    sync_folder(archive.parent)
    with archive.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
