"""A recorded session as values: ``SessionLog``, its segments and its episodes. Everything that analyses data reads
these.

A segment runs from one start of the program to its end; a resumed session has several. Every time is session time: ns
since the session's first segment began, on one clock over all segments. In the log each segment's times begin at 0;
where a segment lies in the session follows from the wall clock at its start, and it never begins before the previous
one ended.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import (
    ActivityEvent,
    AnswerChanged,
    Answered,
    ClauseDone,
    EndCause,
    EpisodesSkipped,
    EpisodeStarted,
    FrameShown,
    KeyPressed,
    Linked,
    Noted,
    Outcome,
    PageShown,
    PartEnded,
    PartStarted,
    Paused,
    PointerUsed,
    Resumed,
    Sampled,
    Scored,
    TextTyped,
)
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.teaching_events import (
    CorrectionRecord,
    PairComparison,
    TeachingRecord,
    gather_comparisons,
    gather_corrections,
)
from minihuman.worlds.pose import Pose

PartEvent = (
    PartStarted
    | PartEnded
    | PageShown
    | EpisodesSkipped
    | Scored
    | ClauseDone
    | AnswerChanged
    | Answered
    | TextTyped
    | PointerUsed
    | ActivityEvent
    | Linked
)
SegmentNote = Noted | Paused | Resumed
PauseSpans = tuple[tuple[int, int], ...]  # begin and end of each, ns of session time


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """One stretch of a session in which the program ran, as it was logged."""

    number: int  # 1 for the session's first
    started_at: str  # ISO 8601 UTC, from the wall clock
    started_unix_ns: int  # the same, ns since 1970
    started_monotonic_ns: int | None  # the machine's monotonic clock then; None in logs that do not say
    monotonic_clock: str  # that clock's name, such as "clock_gettime(CLOCK_MONOTONIC)"; "" where the log does not say
    start_ns: int  # session time at which it began; 0 for the first
    end_ns: int  # session time of the last that is known of it
    end_reason: str  # an EndReason, or "cut_off"
    clean: bool  # whether it ended by itself; False if it was cut off or is still live
    facts: dict[str, str]  # of the station: versions, platform, display
    notes: tuple[SegmentNote, ...]  # consent, focus, pauses, errors, in order of time
    keys: EventColumns[KeyPressed]  # every press and release, outside episodes too
    part_events: tuple[PartEvent, ...] = ()  # parts, pages, answers, points, in the order logged
    samples: Sequence[Sampled] = ()  # of the protocol's devices, read when looked at

    @property
    def pauses(self) -> PauseSpans:
        """Begin and end of every pause, ns of session time; an open one ends with the segment."""
        found: list[tuple[int, int]] = []
        began_ns: int | None = None
        for note in self.notes:
            match note:
                case Paused() if began_ns is None:
                    began_ns = note.t_ns
                case Resumed() if began_ns is not None:
                    found.append((began_ns, note.t_ns))
                    began_ns = None
        return tuple(found) if began_ns is None else (*found, (began_ns, max(began_ns, self.end_ns)))


def notes_in_session_time(notes: Iterable[SegmentNote], start_ns: int) -> tuple[SegmentNote, ...]:
    """A segment's notes in session time, sorted."""
    return tuple(sorted((replace(note, t_ns=note.t_ns + start_ns) for note in notes), key=lambda note: note.t_ns))


def part_events_in_session_time(events: Iterable[PartEvent], start_ns: int) -> tuple[PartEvent, ...]:
    """A segment's part events in session time."""
    return tuple(_moved(event, start_ns) for event in events)


def _moved(event: PartEvent, start_ns: int) -> PartEvent:
    if isinstance(event, Linked):  # whose other times are how long something took
        return replace(event, t_ns=event.t_ns + start_ns)
    names = (field.name for field in fields(event) if field.name.endswith("_ns"))
    times = {name: getattr(event, name) for name in names}
    known = {name: t_ns + start_ns for name, t_ns in times.items() if t_ns or name == "t_ns"}  # 0: unknown
    return replace(event, **known)


CUT_OFF = "cut_off"  # instead of an outcome or an end reason, where the log broke off before there was one


def pose_as_row(pose: Pose | None) -> tuple[float, float, float, float]:
    """A pose as a row of ``Episode.poses``: NaN where the world could not tell."""
    return (np.nan,) * 4 if pose is None else (pose.x, pose.y, pose.z, pose.yaw_rad)


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeLog:
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
    pauses: PauseSpans = ()  # that lay between its reset and its last step, session time
    taught: TeachingRecord | None = None  # control and advice; None where no agent took part
    end_cause: EndCause = ""  # the time limit that ended it, where no step did
    onsets: NDArray[np.bool_] | None = None  # (n + 1,) whose picture shows a stimulus onset; None: no step's

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
    episodes: tuple[EpisodeLog, ...]
    segments: tuple[Segment, ...]
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[SegmentNote, ...]:
        """What was noted in all segments, in order of time."""
        return tuple(note for segment in self.segments for note in segment.notes)

    @property
    def part_events(self) -> tuple[PartEvent, ...]:
        """What happened in the session's parts beside play, in order; nothing in logs from before there were parts."""
        return tuple(event for segment in self.segments for event in segment.part_events)

    @property
    def comparisons(self) -> tuple[PairComparison, ...]:
        """The pairs of clips that were compared, and the answers."""
        return gather_comparisons(self.part_events)

    @property
    def corrections(self) -> tuple[CorrectionRecord, ...]:
        """What should have been done instead, shown after the fact from a step of an episode on."""
        return gather_corrections(self.part_events)

    @property
    def keys(self) -> EventColumns[KeyPressed]:
        """Every press and release of the session, outside episodes too."""
        return EventColumns.joined([segment.keys for segment in self.segments])
