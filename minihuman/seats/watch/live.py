"""A running session as its live log has it: who, where, which keys, how fast, what was noted. No files, no page."""

from collections import deque
from dataclasses import dataclass, field

from minihuman.study.events import (
    EpisodeEnded,
    EpisodeStarted,
    Event,
    KeyPressed,
    Linked,
    Noted,
    Paused,
    PointerUsed,
    Resumed,
    SessionEnded,
    SessionStarted,
    Stepped,
    TextTyped,
)
from minihuman.study.plan import SessionPlan

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
_KEYS, _TIMES, _NOTES = 12, 60, 200


@dataclass(slots=True)
class Live:
    """What the events so far amount to; ``take`` them in order."""

    plan: SessionPlan | None = None
    phase: str = "start"
    paused: str = ""  # why, while play is suspended
    t_ns: int = 0  # of the latest event
    episode: EpisodeStarted | None = None
    outcome: str = ""  # of that episode
    actions: list[int] = field(default_factory=list)  # of that episode
    return_: float = 0.0
    completed: int = 0
    presses: int = 0
    acted_ns: int = 0  # when the participant last did something
    link: Linked | None = None  # the line to a participant in a browser, when it was last measured
    window: str = ""  # what they sit at
    keys: deque[KeyPressed] = field(default_factory=lambda: deque(maxlen=_KEYS))
    times_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES))
    notes: deque[tuple[int, str, str]] = field(default_factory=lambda: deque(maxlen=_NOTES))  # t_ns, kind, text
    ended: str = ""

    def take(self, event: Event) -> None:
        """Go on by one event."""
        self.t_ns = event.t_ns
        match event:
            case SessionStarted():
                self.plan = event.plan
                self.window = event.facts.get("window", "")
            case EpisodeStarted():
                self.episode, self.actions, self.outcome, self.return_ = event, [], "", 0.0
            case Stepped():
                self.actions.append(event.action)
                self.return_ = event.return_
                if event.rt_ms is not None:
                    self.times_ms.append(event.rt_ms)
            case EpisodeEnded():
                self.outcome = event.outcome
                self.completed += event.outcome != "abandoned"
            case Linked():
                self.link = event
            case PointerUsed() | TextTyped():
                self.acted_ns = event.t_ns
            case KeyPressed(down=True):
                self.acted_ns = event.t_ns
                self.presses += event.verdict != "repeat"
                self.keys.append(event)
            case Paused():
                self.paused = event.reason
            case Resumed():
                self.paused = ""
            case Noted(kind="phase"):
                self.phase = event.text
            case Noted():
                self.notes.append((event.t_ns, event.kind, event.text))
            case SessionEnded():
                self.ended = f"{event.reason}: {event.detail}" if event.detail else event.reason

    def facts(self, silent_s: float = 0.0) -> dict[str, object]:
        """For the page: plain values, times in seconds or ms; ``silent_s`` is how long ago the latest event was."""
        plan, started = self.plan, self.episode
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
