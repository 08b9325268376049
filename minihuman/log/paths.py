"""Locates session logs and opens them safely, without interpreting their content.

A session's log is ``<data>/<study>/sub-07/ses-01/sub-07_ses-01.mcap``. While a segment is live it is
``sub-07_ses-01.mcap.part``, or ``sub-07_ses-01_seg-02.mcap.part`` after a resume. Other programs may keep companion
files beside it, MCAP files too. A pipe or a device with a log's name is not opened, because that could block forever.
"""

import os
import re
import stat
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from minihuman.errors import LogError, MinihumanError
from minihuman.operating_system import open_without_waiting
from minihuman.portable_names import explain_unportable_name
from minihuman.storage.outside_names import is_system_companion, require_name

if TYPE_CHECKING:
    from minihuman.experiment.plan.session_plan import SessionPlan


def open_regular_file(path: Path) -> BinaryIO:
    """Open a file for reading.

    Raises:
        LogError: if it cannot be opened, or is a pipe, a device or anything else that is not a regular file.
    """
    try:
        fd = open_without_waiting(path)
        if stat.S_ISREG(os.fstat(fd).st_mode):
            return os.fdopen(fd, "rb")
        os.close(fd)
    except OSError as error:
        raise LogError(f"{path} cannot be opened: {error.strerror}") from error
    raise LogError(f"{path} is not a regular file; name a session log")


MAGIC = b"\x89MCAP0\r\n"  # every MCAP file's first bytes
LOG_SUFFIX = ".mcap"
PART_SUFFIX = ".mcap.part"
SYSTEM_COMPANION = "another system keeps it beside a file for itself; delete it"
MODELS_FOLDER = "models"  # the subfolder of a data folder for models' studies, apart from people's
_SEGMENT = re.compile(r"_seg-(\d+)$")
_LOG_NAME = re.compile(r"_ses-\d+(_seg-\d+)?\.mcap(\.part)?$")
_HEADER = struct.Struct("<BQI")  # after the magic bytes: opcode, record length, and length of the profile
_START_BYTES = 64  # enough for the magic bytes, the header and the profile
_MAX_REASON_LENGTH = 300  # characters of another library's error in a message
_PROFILE = b"minihuman"
_SAFE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
LogFolders = Iterable[tuple[Path, list[str]]]  # each with all its file names


def require_folder(study: Path, *, instead: str = "a study's folder") -> None:
    """Check that a path is a folder.

    Args:
        study: the path.
        instead: what the error tells the user to name.

    Raises:
        LogError: if it is not.
    """
    if not study.is_dir():
        problem = "is not a folder" if study.exists() else "does not exist"
        raise LogError(f"{study} {problem}; name {instead}")


@dataclass(frozen=True, slots=True)
class SegmentPath:
    """The path of a live segment's file, and of the log that it becomes part of."""

    part: Path
    log: Path
    segment: int  # 1 for the first

    @classmethod
    def of_plan(cls, data: Path, plan: "SessionPlan") -> "SegmentPath":
        """Return the paths of a new segment under the data folder.

        Raises:
            LogError: if the study's or participant's name cannot be a folder's name.
        """
        for kind, name in (("study", plan.study), ("participant", plan.participant.id)):
            if not _SAFE_NAME.fullmatch(name):
                raise LogError(
                    f"{kind} {name!r} cannot be used as a folder name; "
                    "use letters, digits, '-', '_' and '.', with a letter or a digit first"
                )
            if reason := explain_unportable_name(name):
                raise LogError(
                    f"{kind} {name!r} cannot be a folder name on every system: {reason}; choose another name"
                )
        folder = session_folder(data, plan.study, plan.participant.id, plan.session)
        stem = f"{plan.participant.id}_ses-{plan.session:02d}"
        tag = "" if plan.segment == 1 else f"_seg-{plan.segment:02d}"
        return cls(folder / f"{stem}{tag}{PART_SUFFIX}", folder / f"{stem}{LOG_SUFFIX}", plan.segment)

    @classmethod
    def of_part(cls, part: Path) -> "SegmentPath":
        """Return the paths of a segment from the path of its live file.

        Raises:
            LogError: if the name does not end in ``.mcap.part``.
        """
        if not part.name.endswith(PART_SUFFIX):
            raise LogError(f"{part} is not a cut-off log; name a file that ends in {PART_SUFFIX}")
        stem = part.name.removesuffix(PART_SUFFIX)
        tag = _SEGMENT.search(stem)
        log = part.with_name(_SEGMENT.sub("", stem) + LOG_SUFFIX)
        segment = int(tag[1]) if tag else 1
        return cls(part, log, segment)


def is_plain_log_name(name: str) -> bool:
    """Return whether a file name is one that minihuman gives a finished session log."""
    return name.endswith(LOG_SUFFIX) and bool(_LOG_NAME.search(name)) and not is_system_companion(name)


def is_companion_file(path: Path) -> bool:
    """Return whether an MCAP file is another program's, such as an eye tracker's, judging by its name and profile.

    A file that cannot be read, or does not begin as an MCAP file does, counts as a log.
    """
    if _LOG_NAME.search(path.name):
        return False
    try:
        with open_regular_file(path) as file:
            start = file.read(_START_BYTES)
    except (OSError, LogError):
        return False
    begin = len(MAGIC) + _HEADER.size
    return start.startswith(MAGIC) and not start[begin:].startswith(_PROFILE)


def session_folder(data: Path, study: str, participant: str, session: int) -> Path:
    """Return the path of a session's folder.

    Raises:
        OutsideNameError: if the name of the study or the participant, which may come from a database or a log, cannot
            be a folder's name.
    """
    study_dir = data / require_name(study, "the study")
    return study_dir / require_name(participant, "the participant") / f"ses-{session:02d}"


def study_folder(log: Path) -> Path:
    """Return the folder of the study to which a log belongs, also for a relative path from inside it."""
    return log.absolute().parent.parent.parent  # above the folders of the session and the participant


def find_log_folders(top: Path) -> Iterator[tuple[Path, list[str]]]:
    """Yield each folder that has an MCAP file, ``top`` included, with all its file names; do not follow links."""
    pending_folders = [os.fspath(top)]
    while pending_folders:
        folder = pending_folders.pop()
        names: list[str] = []
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    if not entry.is_dir():
                        names.append(entry.name)
                    elif not entry.is_symlink():
                        pending_folders.append(entry.path)
        except OSError:  # deleted meanwhile, or not readable
            continue
        if any(LOG_SUFFIX in name for name in names):
            yield Path(folder), names


def list_sessions(folder: Path) -> dict[Path, list[Path]]:
    """Return a folder's sessions: the files that hold each session so far, by the path of the session's log.

    A session without a finished log has the path that its log will get.
    """
    return group_sessions(folder, os.listdir(folder))


def group_sessions(folder: Path, names: Iterable[str]) -> dict[Path, list[Path]]:
    """Return a folder's sessions as ``list_sessions`` does, given the folder's file names."""
    mcap_names = (name for name in sorted(names) if name.endswith((LOG_SUFFIX, PART_SUFFIX)))
    mcap_paths = [folder / name for name in mcap_names if not is_system_companion(name)]
    log_paths = [path for path in mcap_paths if not is_companion_file(path)]
    sessions = {path: [path] for path in log_paths if path.name.endswith(LOG_SUFFIX)}
    segments = [SegmentPath.of_part(path) for path in log_paths if path.name.endswith(PART_SUFFIX)]
    for segment in sorted(segments, key=lambda segment: (segment.log, segment.segment)):
        sessions.setdefault(segment.log, []).append(segment.part)
    return sessions


def list_log_files(folder: Path, pattern: str) -> list[Path]:
    """Return the files in a folder that match a pattern, sorted, without the companions that other systems create."""
    return sorted(path for path in folder.glob(pattern) if not is_system_companion(path.name))


def find_system_companions(folders: LogFolders) -> list[Path]:
    """Return the files that another operating system keeps beside logs, such as ``._sub-07_ses-01.mcap``.

    No command reads them, but ``status``, ``verify`` and all readers of a study's logs mention them.
    """
    endings = (LOG_SUFFIX, PART_SUFFIX, ".jsonl")
    companions = []
    for folder, names in folders:
        companions += [folder / name for name in sorted(names) if is_system_companion(name) and name.endswith(endings)]
    return companions


@contextmanager
def raise_as_log_error(path: Path, doing: str = "read") -> Iterator[None]:
    """Convert any error that a log's content causes to a LogError that names the file; our own errors pass unchanged.

    Args:
        path: the log.
        doing: the participle for the message "PATH cannot be ...", such as "read".

    Raises:
        LogError: instead of any other error, except an OSError.
    """
    try:
        yield
    except (MinihumanError, OSError):
        raise
    except Exception as error:  # a foreign, changed or newer log can make any parser raise anything
        first_line = str(error).partition("\n")[0]
        reason = f"{type(error).__name__}: {first_line[:_MAX_REASON_LENGTH]}"
        raise LogError(f"{path} cannot be {doing}: {reason}") from error
