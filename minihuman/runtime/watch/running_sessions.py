"""The running sessions of a study, read from their live logs at each request: facts, and a preview of the screen.

The preview is drawn again from the world, its seed and the logged actions. All work is throttled: expensive results are
cached for a share of the time, and computed in a thread of the idle class, so that a session on the same machine is not
slowed down.
"""

import logging
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from minihuman.errors import LogError
from minihuman.experiment.machine import events
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.observations import encode_png
from minihuman.log.paths import PART_SUFFIX, SegmentPath, require_folder
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.operating_system import make_thread_idle
from minihuman.worlds.adapters.world import World

T = TypeVar("T")
LOG = logging.getLogger("minihuman")
_LATE_S = 0.5  # work that takes so long had to wait for others
_BUSY_S = 30.0  # for so long afterwards the machine is taken to be busy


class IdleWorker:
    """Does work in a thread of the idle class (Linux), which makes room within microseconds when a key comes.

    A thread of that class stands still beside two busy programs. So where work came too late, what follows is done by
    the caller's own thread for a while.

    Args:
        clock: seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._idle = ThreadPoolExecutor(1, "aside", initializer=make_thread_idle)
        self._busy_until_s = 0.0

    def __call__(self, work: Callable[[], T]) -> T:
        """What ``work`` returns or raises, one piece of work after the other."""
        began_s = self._clock()
        if began_s < self._busy_until_s:
            return work()
        try:
            return self._idle.submit(work).result()
        finally:
            ended_s = self._clock()
            if ended_s - began_s > _LATE_S:
                self._busy_until_s = ended_s + _BUSY_S


class ThrottledCall(Generic[T]):
    """Calls ``find``, or returns its last result where calling it again would take too much time.

    Args:
        find: may take long.
        share: of the time, that calling it may take.
        clock: seconds.
    """

    def __init__(
        self, find: Callable[[], T], *, share: float = 0.05, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._find = find
        self._share = share
        self._clock = clock
        self._found: T | None = None
        self._again_s: float | None = None

    def __call__(self) -> T:
        """The latest result of ``find``, which may be called now."""
        began_s = self._clock()
        if self._again_s is None or began_s >= self._again_s:
            self._found = self._find()
            ended_s = self._clock()
            self._again_s = ended_s + (ended_s - began_s) / self._share
        return self._found  # type: ignore[return-value]


NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
_KEYS = 12
_TIMES = 60
_NOTES = 200


@dataclass(slots=True)
class LiveSession:
    """What the events so far amount to; ``take`` them in order."""

    plan: SessionPlan | None = None
    phase: str = "start"
    paused: str = ""  # why, while play is suspended
    t_ns: int = 0  # of the latest event
    episode: events.EpisodeStarted | None = None
    outcome: str = ""  # of that episode
    actions: list[int] = field(default_factory=list)  # of that episode
    return_: float = 0.0
    completed: int = 0
    presses: int = 0
    acted_ns: int = 0  # when the participant last did something
    link: events.Linked | None = None  # the latest measurement of a browser's connection
    window: str = ""  # the participant's window
    keys: deque[events.KeyPressed] = field(default_factory=lambda: deque(maxlen=_KEYS))
    times_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES))
    notes: deque[tuple[int, str, str]] = field(default_factory=lambda: deque(maxlen=_NOTES))  # t_ns, kind, text
    ended: str = ""

    def take(self, event: events.Event) -> None:
        """Go on by one event."""
        self.t_ns = event.t_ns
        match event:
            case events.SessionStarted():
                self.plan = event.plan
                self.window = event.facts.get("window", "")
            case events.EpisodeStarted():
                self.episode = event
                self.actions = []
                self.outcome = ""
                self.return_ = 0.0
            case events.Stepped():
                self.actions.append(event.action)
                self.return_ = event.return_
                if event.rt_ms is not None and self.episode and self.episode.plan.pace != "real_time":
                    self.times_ms.append(event.rt_ms)
            case events.EpisodeEnded():
                self.outcome = event.outcome
                self.completed += event.outcome != "abandoned"
            case events.Linked():
                self.link = event
            case events.PointerUsed() | events.TextTyped() | events.AxisMoved():
                self.acted_ns = event.t_ns
            case events.KeyPressed(down=True):
                self.acted_ns = event.t_ns
                self.presses += event.verdict not in events.UNPRESSED_VERDICTS
                self.keys.append(event)
            case events.Paused():
                self.paused = event.reason
            case events.Resumed():
                self.paused = ""
            case events.Noted(kind="phase"):
                self.phase = event.text
            case events.Noted():
                self.notes.append((event.t_ns, event.kind, event.text))
            case events.SessionEnded():
                if event.detail:
                    self.ended = f"{event.reason}: {event.detail}"
                else:
                    self.ended = event.reason

    def facts(self, silent_s: float = 0.0) -> dict[str, object]:
        """For the page: plain values, times in seconds or ms; ``silent_s`` is how long ago the latest event was."""
        plan = self.plan
        started = self.episode
        if plan is None:
            return {}
        texts = len(plan.texts)
        return {
            "participant": plan.participant.id,
            "group": plan.participant.group,
            "session": plan.session,
            "segment": plan.segment,
            "phase": self.phase.replace("_", " "),
            "paused": self.paused.replace("_", " "),
            "elapsed_s": self.t_ns // NS_PER_S,
            "idle_s": round((self.t_ns - self.acted_ns) / NS_PER_S + silent_s),
            "silent_s": round(silent_s),
            "window": self.window,
            "rtt_ms": None if self.link is None else round(self.link.rtt_ns / NS_PER_MS),
            "least_rtt_ms": None if self.link is None else round(self.link.least_rtt_ns / NS_PER_MS),
            "block": started.plan.block_name if started else "",
            "block_number": started.plan.block + 1 if started else 0,
            "blocks": texts,
            "episode": started.plan.episode_in_block + 1 if started else 0,
            "episodes": started.plan.episodes_in_block if started else 0,
            "done": plan.first_episode + self.completed,
            "planned": len(plan.episodes),
            "world": started.plan.world if started else "",
            "mission": started.mission if started else "",
            "steps": len(self.actions),
            "most_steps": started.plan.max_steps if started else 0,
            "return": round(self.return_, 3),
            "outcome": self.outcome,
            "presses": self.presses,
            "keys": [{"key": key.key, "verdict": key.verdict.replace("_", " ")} for key in self.keys],
            "times_ms": [round(one) for one in self.times_ms],
            "notes": [{"s": t_ns // NS_PER_S, "kind": kind, "text": text} for t_ns, kind, text in self.notes],
            "ended": self.ended,
        }


PREVIEW_SIZE_PX = (480, 360)


class ScreenPreview:
    """Keeps a world beside a live session and steps it as far as the log has come."""

    def __init__(self) -> None:
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._at: tuple[int, int] = (-1, 0)  # episode, steps taken
        self._png = b""

    def png(self, live: LiveSession) -> bytes:
        """The present picture as PNG; b"" where no episode has begun or the world cannot be run here."""
        if live.episode is None:
            return b""
        try:
            return self._drawn(live, live.episode.plan.episode)
        except Exception:  # of a lab's own world: the session logs it itself
            LOG.debug("no picture of a session's world", exc_info=True)
            self.close()
            return b""

    def close(self) -> None:
        """Let go of the world."""
        if self._world is not None:
            with suppress(Exception):
                self._world[1].close()
        self._world = None
        self._at = (-1, 0)
        self._png = b""

    def _drawn(self, live: LiveSession, episode: int) -> bytes:
        assert live.episode is not None
        plan = live.episode.plan
        wanted = (episode, len(live.actions))
        if wanted == self._at:
            return self._png
        key = (plan.world, plan.options)
        if self._world is None or self._world[0] != key:
            self.close()
            self._world = (key, World(plan.world, plan.options))
        world = self._world[1]
        if self._at[0] != episode or self._at[1] > wanted[1]:
            world.reset(plan.seed)
            self._at = (episode, 0)
        for action in live.actions[self._at[1] :]:
            world.step(action)
        self._at, self._png = wanted, encode_png(world.frame(plan.view, PREVIEW_SIZE_PX, plan.palette))
        return self._png


_READ_SHARE = 0.05  # of a core, that reading all of them may take


@dataclass(slots=True)
class _Watched:
    live: LiveSession = field(default_factory=LiveSession)
    picture: ScreenPreview = field(default_factory=ScreenPreview)
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
        self._parts = ThrottledCall(lambda: sorted(study_dir.rglob(f"*{PART_SUFFIX}")))

    def look(self) -> dict[str, dict[str, object]]:
        """Facts of each running session, by the name of its live log relative to the folder."""
        names = {str(part.relative_to(self._study_dir)): part for part in self._parts() if is_being_recorded(part)}
        for gone in self._watched.keys() - names.keys():
            self._watched.pop(gone).picture.close()
        return {name: self._facts(name, part) for name, part in names.items()}

    def picture(self, name: str) -> bytes:
        """What the participant of a running session sees now, as PNG; b"" if it is none."""
        watched = self._watched.get(name)
        if watched:
            return watched.picture.png(watched.live)
        return b""

    def log_of(self, name: str) -> Path | None:
        """The log that a running session will have; None if it is none that was looked at."""
        if name in self._watched:
            return SegmentPath.of_part(self._study_dir / name).log
        return None

    def _facts(self, name: str, part: Path) -> dict[str, object]:
        watched = self._watched.setdefault(name, _Watched())
        now_s = time.monotonic()
        if now_s >= watched.again_s:
            self._read(watched, part)
            watched.again_s = now_s + (time.monotonic() - now_s) / _READ_SHARE * len(self._watched)
        silent_s = max(0.0, time.time() - watched.written_s)
        return {**watched.live.facts(silent_s), "problem": watched.problem}

    @staticmethod
    def _read(watched: _Watched, part: Path) -> None:
        try:
            found = part.stat()
            size = found.st_size
            watched.written_s = found.st_mtime
            if size == watched.size:
                return
            live = LiveSession()
            for event in read_events(part):
                live.take(event)
        except (LogError, OSError) as error:  # finished just now, or nothing whole in it yet
            watched.problem = str(error)
            return
        watched.live = live
        watched.size = size
        watched.problem = ""
