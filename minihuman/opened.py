"""Whatever a command was pointed at, opened: a log, a session's folder or a study's. Reading changes nothing."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.episode import SessionLog
from minihuman.log.paths import sessions_in
from minihuman.log.read import open_log


@dataclass(frozen=True, slots=True)
class Skipped:
    """A file that was left out, and why, in one sentence."""

    path: Path
    reason: str


def log_files(source: Path) -> list[Path]:
    """List what ``open_log`` takes: the log itself, or every session below a folder, in order of path.

    A session in several segments is named by its folder, so that they are read together.

    Raises:
        LogError: if there is no such file or folder.
    """
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise LogError(f"{source} does not exist; name a session log, or a folder of them")
    folders = sorted({path.parent for path in source.rglob("*.mcap*")})
    sessions = [(folder, files) for folder in folders for files in sessions_in(folder).values()]
    return [files[0] if len(files) == 1 else folder for folder, files in sessions]


def opened(source: Path) -> Iterator[SessionLog | Skipped]:
    """Open one session after the other; what cannot be read is named with its reason, and the rest goes on.

    Raises:
        LogError: if there is no such file or folder.
    """
    for path in log_files(source):
        yield open_or_skip(path)


def open_or_skip(path: Path) -> SessionLog | Skipped:
    """Open one session, or say why it cannot be."""
    try:
        return open_log(path)
    except (LogError, OSError) as error:
        return Skipped(path, str(error))
