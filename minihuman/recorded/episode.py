"""The read side: a session log as values. Everything that looks at data looks at these.

Every time is session time, ns since the session's first segment began; see ``Segment``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.recorded.columns import EventColumns
from minihuman.recorded.compared import Compared, comparisons
from minihuman.recorded.corrected import Corrected, corrections
from minihuman.recorded.segment import Note, PartEvent, Pauses, Segment
from minihuman.recorded.taught import Taught
from minihuman.study.events import EpisodeStarted, FrameShown, KeyPressed, Outcome
from minihuman.study.plan import EpisodePlan, SessionPlan
from minihuman.worlds.pose import Pose

CUT_OFF = "cut_off"  # instead of an outcome or an end reason, where the log broke off before one was said


def pose_row(pose: Pose | None) -> tuple[float, float, float, float]:
    """A pose as a row of ``Episode.poses``: NaN where the world could not tell."""
    return (np.nan,) * 4 if pose is None else (pose.x, pose.y, pose.z, pose.yaw_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One played episode. ``n`` steps have ``n + 1`` poses, times and hashes; checked when made."""

    start: EpisodeStarted  # plan, action names, mission, map, initial pose and hashes
    poses: NDArray[np.float64]  # (n + 1, 4) x, y, z, yaw_rad; NaN where the world cannot tell
    t_ns: NDArray[np.int64]  # (n + 1,) reset, then each step; session time
    actions: NDArray[np.int64]  # (n,)
    step_keys: Sequence[str]  # (n,) causing key, "" for a tick's no-op
    key_t_ns: NDArray[np.int64]  # (n,) session time
    rewards: NDArray[np.float64]  # (n,)
    terminated: NDArray[np.bool_]  # (n,)
    truncated: NDArray[np.bool_]  # (n,)
    rt_ms: NDArray[np.float64]  # (n,) NaN where there is none
    state_hashes: NDArray[np.uint64]  # (n + 1,)
    observation_hashes: NDArray[np.uint64]  # (n + 1,)
    keys: EventColumns[KeyPressed]  # every press and release while it ran
    frames: EventColumns[FrameShown]
    outcome: Outcome | None  # None: the log was cut off inside this episode
    observations: Sequence[Any] | None = None  # (n + 1,) read when looked at; None where the log holds none
    segment: int = 1  # of the session: one more after each resume
    attempt: int = 1  # more where an interrupted episode was begun again
    pauses: Pauses = ()  # that lay between its reset and its last step, session time
    taught: Taught | None = None  # who steered, and what a policy would have done; None where no agent had a part in it

    def __post_init__(self) -> None:
        """Refuse lengths that do not belong together."""
        n = len(self.actions)
        for name in ("poses", "t_ns", "state_hashes", "observation_hashes"):
            if len(getattr(self, name)) != n + 1:
                raise ValueError(f"episode {self.number}: {name} has {len(getattr(self, name))} rows, not {n + 1}")
        for name in ("step_keys", "key_t_ns", "rewards", "terminated", "truncated", "rt_ms"):
            if len(getattr(self, name)) != n:
                raise ValueError(f"episode {self.number}: {name} has {len(getattr(self, name))} rows, not {n}")

    @property
    def plan(self) -> EpisodePlan:
        """What was to be played."""
        return self.start.plan

    @property
    def number(self) -> int:
        """The session's episode as a person counts it: 1 for the first. The log counts from 0."""
        return self.plan.episode + 1

    @property
    def name(self) -> str:
        """The episode in words, as messages name it: "episode 3", "episode 3 (attempt 2)"."""
        return f"episode {self.number}" + (f" (attempt {self.attempt})" if self.attempt > 1 else "")

    @property
    def outcome_word(self) -> str:
        """The outcome, or "cut_off" where the log broke off before there was one: the word in every table."""
        return self.outcome or CUT_OFF

    @property
    def return_(self) -> float:
        """Sum of rewards."""
        return float(self.rewards.sum())


@dataclass(frozen=True, slots=True, eq=False)
class SessionLog:
    """A session, read. ``clean`` is False if the log was cut off and recovered or is still live."""

    path: Path
    plan: SessionPlan
    player: str  # "human", "human-like", "optimal", "random", "policy:..."
    started_at: str  # ISO 8601 UTC, the wall clock when session time was 0
    clean: bool
    end_reason: str  # an EndReason, or "cut_off"
    facts: dict[str, str]
    episodes: tuple[Episode, ...]
    segments: tuple[Segment, ...]
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What was noted in all segments, in order of time."""
        return tuple(note for segment in self.segments for note in segment.notes)

    @property
    def part_events(self) -> tuple[PartEvent, ...]:
        """What happened in the session's parts beside play, in order; nothing in logs from before there were parts."""
        return tuple(event for segment in self.segments for event in segment.part_events)

    @property
    def comparisons(self) -> tuple[Compared, ...]:
        """The pairs of stretches that were compared, and what was said of them."""
        return comparisons(self.part_events)

    @property
    def corrections(self) -> tuple[Corrected, ...]:
        """What should have been done instead, shown after the fact from a step of an episode on."""
        return corrections(self.part_events)

    @property
    def keys(self) -> EventColumns[KeyPressed]:
        """Every press and release of the session, outside episodes too."""
        return EventColumns.joined([segment.keys for segment in self.segments])
