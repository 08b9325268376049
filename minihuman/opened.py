"""Whatever a command was pointed at, opened: a log, a session's folder or a study's. Reading changes nothing."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.episode import SessionLog
from minihuman.log.read import open_log

_ENDINGS = (".mcap", ".mcap.part")


@dataclass(frozen=True, slots=True)
class Skipped:
    """A file that was left out, and why, in one sentence."""

    path: Path
    reason: str


def log_files(source: Path) -> list[Path]:
    """List what ``open_log`` takes: the log itself, or every session below a folder, in order of path.

    A session that lies in a folder of its own is named by its folder, so that its segments are read together.

    Raises:
        LogError: if there is no such file or folder.
    """
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise LogError(f"{source} does not exist; name a session log, or a folder of them")
    found: dict[Path, list[Path]] = {}
    for path in sorted(source.rglob("*.mcap*")):
        if path.name.endswith(_ENDINGS) and path.is_file():
            found.setdefault(path.parent, []).append(path)
    return [path for folder, files in found.items() for path in ([folder] if _one_session(files) else files)]


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


def _one_session(files: list[Path]) -> bool:
    return len({path.name.partition(".")[0].partition("_seg-")[0] for path in files}) == 1
