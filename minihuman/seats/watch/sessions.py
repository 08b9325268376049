"""The running sessions of a study, read from their live logs whenever somebody looks."""

import time
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.paths import PART_SUFFIX, SegmentPath, require_folder
from minihuman.log.read.open_log import read_events
from minihuman.log.record.claim import is_live
from minihuman.seats.watch.live import Live
from minihuman.seats.watch.picture import Picture
from minihuman.seats.watch.seldom import Seldom

_SHARE = 0.05  # of a core, that reading all of them may take


@dataclass(slots=True)
class _Watched:
    live: Live = field(default_factory=Live)
    picture: Picture = field(default_factory=Picture)
    size: int = -1
    written_s: float = 0.0  # the wall clock when it was written last
    again_s: float = 0.0
    problem: str = ""


class RunningSessions:
    """All sessions below a folder that a process is writing now.

    A log is read from its beginning, and the seldomer the longer that takes: never for over a twentieth of the time,
    however many there are.
    """

    def __init__(self, study_dir: Path) -> None:
        require_folder(study_dir)
        self._study_dir = study_dir
        self._watched: dict[str, _Watched] = {}
        self._parts = Seldom(lambda: sorted(study_dir.rglob(f"*{PART_SUFFIX}")))

    def look(self) -> dict[str, dict[str, object]]:
        """Facts of each running session, by the name of its live log relative to the folder."""
        names = {str(part.relative_to(self._study_dir)): part for part in self._parts() if is_live(part)}
        for gone in self._watched.keys() - names.keys():
            self._watched.pop(gone).picture.close()
        return {name: self._facts(name, part) for name, part in names.items()}

    def picture(self, name: str) -> bytes:
        """What the participant of a running session sees now, as PNG; b"" if it is none."""
        watched = self._watched.get(name)
        return watched.picture.png(watched.live) if watched else b""

    def log_of(self, name: str) -> Path | None:
        """The log that a running session will have; None if it is none that was looked at."""
        return SegmentPath.of_part(self._study_dir / name).log if name in self._watched else None

    def _facts(self, name: str, part: Path) -> dict[str, object]:
        watched = self._watched.setdefault(name, _Watched())
        now_s = time.monotonic()
        if now_s >= watched.again_s:
            self._read(watched, part)
            watched.again_s = now_s + (time.monotonic() - now_s) / _SHARE * len(self._watched)
        silent_s = max(0.0, time.time() - watched.written_s)
        return {**watched.live.facts(silent_s), "problem": watched.problem}

    @staticmethod
    def _read(watched: _Watched, part: Path) -> None:
        try:
            found = part.stat()
            size, watched.written_s = found.st_size, found.st_mtime
            if size == watched.size:
                return
            live = Live()
            for event in read_events(part):
                live.take(event)
        except (LogError, OSError) as error:  # finished just now, or nothing whole in it yet
            watched.problem = str(error)
            return
        watched.live, watched.size, watched.problem = live, size, ""
