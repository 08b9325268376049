"""A log read back: as events, in the order they happened, or as a session of episodes."""

from collections.abc import Iterator
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.paths import PART_SUFFIX, sessions_in
from minihuman.log.read.assemble import Gathering
from minihuman.log.read.file import Reading
from minihuman.log.read.glance import all_clean
from minihuman.log.read.guard import guarded
from minihuman.recorded.episode import SessionLog
from minihuman.study import events as ev


def read_events(path: Path) -> Iterator[ev.Event]:
    """Yield a log's events in the order they were recorded.

    A live or cut-off log (``.mcap.part``) yields what is whole; a finished one must be whole.

    Raises:
        LogError: if the file cannot be opened, is no session log, of another schema version, or damaged.
    """
    return Reading(path).events()


def open_log(path: Path | str) -> SessionLog:
    """Read a session: a finished log, a live or cut-off ``.mcap.part``, or a session's folder with every segment in it.

    Raises:
        LogError: if there is no session log, it is of another schema version, damaged, or holds no plan.
    """
    path = Path(path)
    files = files_of(path)
    readings = [Reading(file) for file in files]
    gathered = Gathering()
    for file, reading in zip(files, readings, strict=True):
        with guarded(file):
            gathered.read(reading)
    if not gathered.started:
        raise LogError(f"{path} holds no session plan; it was cut off before the session started")
    try:
        with guarded(path):
            return _session(path, gathered, readings)
    except LogError as error:
        if str(path) in str(error):
            raise
        raise LogError(f"{path}: {error}") from error


def files_of(path: Path) -> list[Path]:
    """The files of one session: a log, or all of the one session in a folder, in order.

    Raises:
        LogError: if a folder holds none, or more than one.
    """
    if not path.is_dir():
        return [path]
    sessions = sessions_in(path)
    if len(sessions) != 1:
        raise LogError(f"{path} holds {len(sessions)} session logs (*.mcap or *{PART_SUFFIX}), not one; name a file")
    (files,) = sessions.values()
    return files


def _session(path: Path, gathered: Gathering, readings: list[Reading]) -> SessionLog:
    first = gathered.started[0]
    starts = [facts for reading in readings for facts in reading.starts]
    ends = [facts for reading in readings for facts in reading.ends]
    segments, episodes = gathered.session(starts, ends)
    return SessionLog(
        path=path,
        plan=first.plan,
        player=first.facts.get("player", "unknown"),
        started_at=starts[0]["started_at"],
        clean=all_clean(starts, ends),
        end_reason=gathered.end_reason,
        facts=first.facts,
        episodes=episodes,
        segments=segments,
        metadata={"segments": starts, "ends": ends},
    )
