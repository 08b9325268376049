"""The running sessions of a study, read from their live logs at each request: facts, and a preview of the screen.

The preview is drawn again from the world, its seed and the logged actions. All work is throttled: expensive results are
cached so that they take only a share of the time, and are computed in a thread of low priority, so that a session on
the same machine is not slowed down.
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
from minihuman.operating_system import lower_thread_priority
from minihuman.worlds.adapters.world import World

T = TypeVar("T")
LOG = logging.getLogger("minihuman")


class LowPriorityWorker:
    """Runs functions one after the other in a thread that has low priority on Linux, so that sessions come first.

    The thread keeps a share of a busy machine. A thread of the idle class would have none while two programs run, and
    while it waits for a core inside Python code it holds the interpreter, so that the whole process would stand still.
    """

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(1, "low-priority", initializer=lower_thread_priority)

    def __call__(self, work: Callable[[], T]) -> T:
        """Call ``work`` and return its result or raise its error."""
        return self._threads.submit(work).result()


class ThrottledCall(Generic[T]):
    """Calls a function, or returns its last result if calls have taken more than a share of the time.

    Args:
        find: the function, which may take long.
        share: the share of the time that calls of the function may take.
        clock: returns the time in seconds.
    """

    def __init__(
        self, find: Callable[[], T], *, share: float = 0.05, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._find = find
        self._share = share
        self._clock = clock
        self._latest: T | None = None
        self._next_call_s: float | None = None

    def __call__(self) -> T:
        """Return the latest result of the function, after calling it if it is due."""
        began_s = self._clock()
        if self._next_call_s is None or began_s >= self._next_call_s:
            self._latest = self._find()
            ended_s = self._clock()
            self._next_call_s = ended_s + (ended_s - began_s) / self._share
        return self._latest  # type: ignore[return-value]


NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
_KEYS = 12  # of the latest keys, reaction times and notes, how many are kept
_TIMES = 60
_NOTES = 200


@dataclass(slots=True)
class LiveSession:
    """The state of a session after the events so far, which ``take`` receives in order."""

    plan: SessionPlan | None = None
    phase: str = "start"
    paused: str = ""  # why play is suspended; "" while it is not
    t_ns: int = 0  # time of the latest event
    episode: events.EpisodeStarted | None = None
    outcome: str = ""  # the latest episode's; "" while it is running
    actions: list[int] = field(default_factory=list)  # taken in the latest episode
    return_: float = 0.0  # of the latest episode so far
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
        """Update the state with one event."""
        self.t_ns = event.t_ns
        match event:
            case events.SessionStarted():
                self.plan = event.plan
                self.window = event.facts.get("window", "")
            case events.EpisodeStarted() | events.Stepped() | events.EpisodeEnded():
                self._take_episode_event(event)
            case events.Linked():
                self.link = event
            case events.PointerUsed() | events.TextTyped() | events.TextChanged() | events.AxisMoved():
                self.acted_ns = event.t_ns
            case events.KeyPressed(down=True):
                self._take_press(event)
            case events.Paused():
                self.paused = event.reason
            case events.Resumed():
                self.paused = ""
            case events.Noted():
                self._take_note(event)
            case events.SessionEnded():
                self.ended = f"{event.reason}: {event.detail}" if event.detail else event.reason

    def _take_press(self, press: events.KeyPressed) -> None:
        self.acted_ns = press.t_ns
        if press.verdict not in events.UNPRESSED_VERDICTS:
            self.presses += 1
        self.keys.append(press)

    def _take_note(self, note: events.Noted) -> None:
        if note.kind == "phase":
            self.phase = note.text
        else:
            self.notes.append((note.t_ns, note.kind, note.text))

    def _take_episode_event(self, event: events.EpisodeStarted | events.Stepped | events.EpisodeEnded) -> None:
        """Update what is known of the latest episode: that it began, took a step or ended."""
        match event:
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
                if event.outcome != "abandoned":
                    self.completed += 1

    def facts(self, silent_s: float = 0.0) -> dict[str, object]:
        """Return what the experimenter's page shows about the session, by name; empty before the session's start.

        Names that end in ``_s`` are times in seconds, those in ``_ms`` in milliseconds.

        Args:
            silent_s: the time since the latest event, in seconds.
        """
        plan = self.plan
        if plan is None:
            return {}
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
            **self._connection_facts(),
            **self._episode_facts(),
            "blocks": len(plan.texts),
            "done": plan.first_episode + self.completed,
            "planned": len(plan.episodes),
            "steps": len(self.actions),
            "return": round(self.return_, 3),
            "outcome": self.outcome,
            "presses": self.presses,
            "keys": [{"key": key.key, "verdict": key.verdict.replace("_", " ")} for key in self.keys],
            "times_ms": [round(time_ms) for time_ms in self.times_ms],
            "notes": [{"s": t_ns // NS_PER_S, "kind": kind, "text": text} for t_ns, kind, text in self.notes],
            "ended": self.ended,
        }

    def _connection_facts(self) -> dict[str, object]:
        """Return the round-trip times of the session's page in ms, by name; None where no page is measured."""
        if self.link is None:
            return {"rtt_ms": None, "least_rtt_ms": None}
        return {
            "rtt_ms": round(self.link.rtt_ns / NS_PER_MS),
            "least_rtt_ms": round(self.link.least_rtt_ns / NS_PER_MS),
        }

    def _episode_facts(self) -> dict[str, object]:
        """Return the facts about the present episode and its block."""
        if self.episode is None:
            names = {"block": "", "world": "", "mission": ""}
            return {**names, "block_number": 0, "episode": 0, "episodes": 0, "most_steps": 0}
        plan = self.episode.plan
        return {
            "block": plan.block_name,
            "world": plan.world,
            "mission": self.episode.mission,
            "block_number": plan.block + 1,
            "episode": plan.episode_in_block + 1,
            "episodes": plan.episodes_in_block,
            "most_steps": plan.max_steps,
        }


PREVIEW_SIZE_PX = (480, 360)


class ScreenPreview:
    """Keeps a world for a live session, and steps it up to the log's last step."""

    def __init__(self) -> None:
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._at: tuple[int, int] = (-1, 0)  # the world's episode, and the steps taken in it
        self._png = b""

    def png(self, live: LiveSession) -> bytes:
        """Return the present picture as PNG; b"" if no episode has begun or the world cannot be run here."""
        if live.episode is None:
            return b""
        try:
            return self._draw_picture(live, live.episode.plan.episode)
        except Exception:  # any error of a laboratory's own world, which its session logs
            LOG.debug("no picture of a session's world", exc_info=True)
            self.close()
            return b""

    def close(self) -> None:
        """Close the world."""
        if self._world is not None:
            with suppress(Exception):
                self._world[1].close()
        self._world = None
        self._at = (-1, 0)
        self._png = b""

    def _draw_picture(self, live: LiveSession, episode: int) -> bytes:
        """Step the preview's world up to the log's last step, and return its picture as PNG."""
        assert live.episode is not None
        plan = live.episode.plan
        n_steps = len(live.actions)
        if self._at == (episode, n_steps):
            return self._png
        key = (plan.world, plan.options)
        if self._world is None or self._world[0] != key:
            self.close()
            self._world = (key, World(plan.world, plan.options))
        _, world = self._world
        drawn_episode, n_drawn_steps = self._at
        if drawn_episode != episode or n_drawn_steps > n_steps:
            world.reset(plan.seed)
            n_drawn_steps = 0
            self._at = (episode, 0)
        for action in live.actions[n_drawn_steps:]:
            world.step(action)
        self._at = (episode, n_steps)
        self._png = encode_png(world.frame(plan.view, PREVIEW_SIZE_PX, plan.palette))
        return self._png


_READ_SHARE = 0.05  # of a core, for reading all running sessions


@dataclass(slots=True)
class _Watched:
    """A running session with its preview, and when its log was and will be read."""

    live: LiveSession = field(default_factory=LiveSession)
    picture: ScreenPreview = field(default_factory=ScreenPreview)
    size: int = -1
    written_s: float = 0.0  # the wall clock at the log's last write
    again_s: float = 0.0  # the monotonic time from which the log is read again
    problem: str = ""  # why the log cannot be read


class RunningSessions:
    """All sessions below a folder that a process is writing now.

    A log is read from its beginning, and less often the longer that takes: reading never takes more than a twentieth of
    the time, however many sessions there are.
    """

    def __init__(self, study_dir: Path) -> None:
        require_folder(study_dir)
        self._study_dir = study_dir
        self._watched: dict[str, _Watched] = {}
        self._parts = ThrottledCall(lambda: sorted(study_dir.rglob(f"*{PART_SUFFIX}")))

    def look(self) -> dict[str, dict[str, object]]:
        """Return the facts of each running session, by the path of its live log relative to the folder."""
        names = {str(part.relative_to(self._study_dir)): part for part in self._parts() if is_being_recorded(part)}
        for ended in self._watched.keys() - names.keys():
            self._watched.pop(ended).picture.close()
        return {name: self._collect_facts(name, part) for name, part in names.items()}

    def picture(self, name: str) -> bytes:
        """Return the preview of a running session's screen as PNG; b"" if there is no such session or no picture.

        ``name`` is the name that `look` has for the session.
        """
        watched = self._watched.get(name)
        if watched:
            return watched.picture.png(watched.live)
        return b""

    def log_of(self, name: str) -> Path | None:
        """Return the path of the log that a running session will have; None if ``look`` did not report the session."""
        if name in self._watched:
            return SegmentPath.of_part(self._study_dir / name).log
        return None

    def _collect_facts(self, name: str, part: Path) -> dict[str, object]:
        """Return the facts of a running session, after reading its log again if that is due."""
        watched = self._watched.setdefault(name, _Watched())
        now_s = time.monotonic()
        if now_s >= watched.again_s:
            self._read_part(watched, part)
            watched.again_s = now_s + (time.monotonic() - now_s) / _READ_SHARE * len(self._watched)
        silent_s = max(0.0, time.time() - watched.written_s)
        return {**watched.live.facts(silent_s), "problem": watched.problem}

    @staticmethod
    def _read_part(watched: _Watched, part: Path) -> None:
        """Read a live log again if it has grown."""
        try:
            status = part.stat()
            size = status.st_size
            watched.written_s = status.st_mtime
            if size == watched.size:
                return
            live = LiveSession()
            for event in read_events(part):
                live.take(event)
        except (LogError, OSError) as error:  # it has just been finished, or has no complete record yet
            watched.problem = str(error)
            return
        watched.live = live
        watched.size = size
        watched.problem = ""
