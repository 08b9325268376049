"""Where a session's log lies: ``<data>/<study>/sub-07/ses-01/sub-07_ses-01.mcap``, and its names while it is live.

While a segment is live it is ``sub-07_ses-01.mcap.part``, or ``sub-07_ses-01_seg-02.mcap.part`` after a resume.
When it ends it becomes, or is merged into, the session's one ``sub-07_ses-01.mcap``. Beside it other programs may keep
companions of theirs, MCAP files too.
"""

import os
import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.errors import LogError
from minihuman.log.regular import open_regular

if TYPE_CHECKING:
    from minihuman.study.plan import SessionPlan

MAGIC = b"\x89MCAP0\r\n"  # every MCAP file's first bytes
LOG_SUFFIX = ".mcap"
PART_SUFFIX = ".mcap.part"
_SEGMENT = re.compile(r"_seg-(\d+)$")
_OURS = re.compile(r"_ses-\d+(_seg-\d+)?\.mcap(\.part)?$")
_HEADER = struct.Struct("<BQI")  # behind the magic bytes: opcode, length, and how long the profile is
_PROFILE = b"minihuman"
_SAFE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def require_folder(study: Path, *, instead: str = "a study's folder") -> None:
    """Make sure that there is a folder.

    Raises:
        LogError: if there is none; it says what to name instead.
    """
    if not study.is_dir():
        wrong = "is not a folder" if study.exists() else "does not exist"
        raise LogError(f"{study} {wrong}; name {instead}")


@dataclass(frozen=True, slots=True)
class SegmentPath:
    """A live segment's file and the log it becomes part of."""

    part: Path
    log: Path
    segment: int  # 1 for the first

    @classmethod
    def of_plan(cls, data: Path, plan: "SessionPlan") -> "SegmentPath":
        """Name a new segment's files under the data folder.

        Raises:
            LogError: if the study's or participant's name cannot be a folder's.
        """
        for what, name in (("study", plan.study), ("participant", plan.participant.id)):
            if not _SAFE.fullmatch(name):
                raise LogError(
                    f"{what} {name!r} cannot name a folder; "
                    "use letters, digits, '-', '_' and '.', the first a letter or a digit"
                )
        folder = session_folder(data, plan.study, plan.participant.id, plan.session)
        stem = f"{plan.participant.id}_ses-{plan.session:02d}"
        tag = "" if plan.segment == 1 else f"_seg-{plan.segment:02d}"
        return cls(folder / f"{stem}{tag}{PART_SUFFIX}", folder / f"{stem}{LOG_SUFFIX}", plan.segment)

    @classmethod
    def of_part(cls, part: Path) -> "SegmentPath":
        """Find out from a live file's name which log it belongs to.

        Raises:
            LogError: if the name does not end in ``.mcap.part``.
        """
        if not part.name.endswith(PART_SUFFIX):
            raise LogError(f"{part} is not a cut-off log; one is named *{PART_SUFFIX}")
        stem = part.name.removesuffix(PART_SUFFIX)
        tag = _SEGMENT.search(stem)
        log = part.with_name(_SEGMENT.sub("", stem) + LOG_SUFFIX)
        return cls(part, log, int(tag[1]) if tag else 1)


def is_guest(path: Path) -> bool:
    """Whether an MCAP file is another program's companion of a session, an eye tracker's say, by name and profile."""
    if _OURS.search(path.name):
        return False
    try:
        with open_regular(path) as file:
            start = file.read(64)
    except (OSError, LogError):
        return False
    begin = len(MAGIC) + _HEADER.size
    return start.startswith(MAGIC) and not start[begin:].startswith(_PROFILE)


def session_folder(data: Path, study: str, participant: str, session: int) -> Path:
    """Name the folder of one session."""
    return data / study / participant / f"ses-{session:02d}"


def study_folder(log: Path) -> Path:
    """Name the folder of the study that a log lies in, also where the log is named from inside of it."""
    return log.absolute().parent.parent.parent  # behind session and participant


def folders_with_logs(top: Path) -> Iterator[tuple[Path, list[str]]]:
    """Yield every folder from one down that has an MCAP file in it, with the names of all its files; links are left."""
    waiting = [os.fspath(top)]
    while waiting:
        folder = waiting.pop()
        names: list[str] = []
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    if entry.is_dir():
                        waiting += [] if entry.is_symlink() else [entry.path]
                    else:
                        names.append(entry.name)
        except OSError:  # gone since, or not ours to read
            continue
        if any(LOG_SUFFIX in name for name in names):
            yield Path(folder), names


def sessions_in(folder: Path) -> dict[Path, list[Path]]:
    """List a folder's sessions by the log each has or will have: that log, then live or cut-off segments in order."""
    return sessions_among(folder, os.listdir(folder))


def sessions_among(folder: Path, names: Iterable[str]) -> dict[Path, list[Path]]:
    """As ``sessions_in``, for a folder whose names are already known."""
    paths = [folder / name for name in sorted(names) if name.endswith((LOG_SUFFIX, PART_SUFFIX))]
    ours = [path for path in paths if not is_guest(path)]
    found = {path: [path] for path in ours if path.name.endswith(LOG_SUFFIX)}
    parts = [SegmentPath.of_part(path) for path in ours if path.name.endswith(PART_SUFFIX)]
    for part in sorted(parts, key=lambda part: (part.log, part.segment)):
        found.setdefault(part.log, []).append(part.part)
    return found
