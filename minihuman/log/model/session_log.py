"""A recorded session as values: ``SessionLog``, its segments and its episodes, which all analyses of data read.

A segment lasts from one start of the program to its end; a resumed session has several. All times are session time:
nanoseconds since the session's first segment began, on one clock for all segments. In the log each segment's times
begin at 0. A segment's place in the session follows from the wall clock at its start, and it never begins before the
previous segment ended.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.team.episode import digest_joint_actions
from minihuman.activities.team.events import (
    InputLate,
    JointStepped,
    PictureCorrected,
    SeatSeen,
    SeatsReadied,
    SeatTaken,
    TeamEnded,
    TeamFormed,
)
from minihuman.activities.team.plan import PERSON
from minihuman.experiment.machine.events import (
    ActivityEvent,
    AnswerChanged,
    Answered,
    AxisMoved,
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
    TextChanged,
    TextTyped,
)
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.teaching_events import (
    CorrectionRecord,
    PairComparison,
    TeachingRecord,
    gather_comparisons,
    gather_corrections,
)
from minihuman.worlds.outcomes import parse_outcome_rule
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
    | TextChanged
    | PointerUsed
    | AxisMoved
    | ActivityEvent
    | Linked
)
SegmentNote = Noted | Paused | Resumed
PauseSpans = tuple[tuple[int, int], ...]  # begin and end of each, ns of session time


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A part of a session during which the program ran without interruption."""

    number: int  # 1 for the session's first
    started_at: str  # ISO 8601 UTC, from the wall clock
    started_unix_ns: int  # the same, ns since 1970
    started_monotonic_ns: int | None  # the machine's monotonic clock then; None if not recorded
    monotonic_clock: str  # that clock's name, such as "clock_gettime(CLOCK_MONOTONIC)"; "" if not recorded
    start_ns: int  # session time at which it began; 0 for the first
    end_ns: int  # session time of the last record
    end_reason: str  # an EndReason, or "cut_off"
    clean: bool  # whether it ended by itself; False if it was cut off or is still live
    facts: dict[str, str]  # of the station: versions, platform, display
    notes: tuple[SegmentNote, ...]  # consent, focus, pauses, errors, in order of time
    keys: EventColumns[KeyPressed]  # every press and release, outside episodes too
    part_events: tuple[PartEvent, ...] = ()  # parts, pages, answers, points, in the order logged
    samples: Sequence[Sampled] = ()  # of the protocol's devices, read on access

    @property
    def pauses(self) -> PauseSpans:
        """Return the start and end of every pause in nanoseconds of session time; an open one ends with the segment."""
        spans: list[tuple[int, int]] = []
        began_ns: int | None = None
        for note in self.notes:
            match note:
                case Paused() if began_ns is None:
                    began_ns = note.t_ns
                case Resumed() if began_ns is not None:
                    spans.append((began_ns, note.t_ns))
                    began_ns = None
        if began_ns is None:
            return tuple(spans)
        return (*spans, (began_ns, max(began_ns, self.end_ns)))


def notes_in_session_time(notes: Iterable[SegmentNote], start_ns: int) -> tuple[SegmentNote, ...]:
    """Return a segment's notes with their times shifted to session time, sorted by time.

    Args:
        notes: the notes, with times in nanoseconds since the segment began.
        start_ns: the session time at which the segment began.
    """
    return tuple(sorted((replace(note, t_ns=note.t_ns + start_ns) for note in notes), key=lambda note: note.t_ns))


def part_events_in_session_time(events: Iterable[PartEvent], start_ns: int) -> tuple[PartEvent, ...]:
    """Return a segment's part events, in the same order, with their times shifted to session time.

    Args:
        events: the events, with times in nanoseconds since the segment began.
        start_ns: the session time at which the segment began.
    """
    return tuple(_shift_event(event, start_ns) for event in events)


def _shift_event(event: PartEvent, start_ns: int) -> PartEvent:
    """Return an event with all its known times shifted by ``start_ns``, from its segment's time to session time."""
    if isinstance(event, Linked):  # its other times are durations
        return replace(event, t_ns=event.t_ns + start_ns)
    names = (field.name for field in fields(event) if field.name.endswith("_ns"))
    times = {name: getattr(event, name) for name in names}
    shifted = {name: t_ns + start_ns for name, t_ns in times.items() if t_ns or name == "t_ns"}  # others: 0 if unknown
    return replace(event, **shifted)


CUT_OFF = "cut_off"  # the outcome or end reason if the log ends before there is one


def pose_as_row(pose: Pose | None) -> tuple[float, float, float, float]:
    """Return a pose as a row of ``EpisodeLog.poses``: x, y, z, yaw in radians; all NaN if the world gave no pose."""
    if pose is None:
        return (np.nan,) * 4
    return (pose.x, pose.y, pose.z, pose.yaw_rad)


@dataclass(frozen=True, slots=True, eq=False)
class TeamRecord:
    """A team's episode of n joint steps with b bodies."""

    team: str
    index: int
    seat: int  # of the log's participant
    role: str
    seats: tuple[str, ...]  # by seat: "person", or the agent as the protocol names it
    actions: NDArray[np.int64]  # (n, b)
    rewards: NDArray[np.float64]  # (n, b)
    poses: NDArray[np.float64]  # (n + 1, b, 4) x, y, z, yaw_rad; NaN at a reset that the log lacks
    sources: tuple[tuple[str, ...], ...]  # (n, b) "person", "late" or "agent"
    digest: int  # of the joint actions, as logged with the last step; 0 before the first
    late: int  # inputs of this seat that came too late
    takeovers: int  # how often an agent took a person's seat
    corrected: int  # pictures shown after the own action that others' actions made wrong
    sightings: tuple[SeatSeen, ...] = ()  # changes of what people saw of a seat

    @property
    def partner_seats(self) -> tuple[int, ...]:
        """Return the indices of the other members' seats."""
        return tuple(seat for seat in range(len(self.seats)) if seat != self.seat)

    @property
    def partners(self) -> tuple[str, ...]:
        """Return "person" or the agent's name for each of the other seats, in the order of the seats."""
        return tuple(self.seats[seat] for seat in self.partner_seats)

    @property
    def partner(self) -> str:
        """Return the partners as one word: "person", an agent's name, or several joined by "+"; "" without partners."""
        return "+".join(self.partners)

    @property
    def persons(self) -> tuple[int, ...]:
        """Return the indices of the seats in which people sit."""
        return tuple(seat for seat, kind in enumerate(self.seats) if kind == PERSON)

    @property
    def steps_by_source(self) -> tuple[dict[str, int], ...]:
        """Return, for each seat, the number of joint steps in which "person", "late" or "agent" acted."""
        by_seat = zip(*self.sources, strict=True) if self.sources else ((),) * len(self.seats)
        return tuple(dict(sorted(Counter(sources).items())) for sources in by_seat)

    @property
    def absent_share(self) -> float | None:
        """Return the share of joint steps in which a person's seat idled for lack of input, or an agent acted for it.

        One such seat is enough for a step to count. The result is None if there are no joint steps.
        """
        if not self.sources:
            return None
        n_absent = 0
        for sources in self.sources:
            if any(sources[seat] != "person" for seat in self.persons):
                n_absent += 1
        return n_absent / len(self.sources)

    def find_difference(self, seed: int) -> str:
        """Return how the joint actions contradict their logged digest; "" if they do not or there are none.

        Args:
            seed: the seed with which the episode's world was reset.
        """
        digest = digest_joint_actions(self.team, seed, self.actions.tolist())
        if not len(self.actions) or digest == self.digest:
            return ""
        return f"joint actions have digest {digest:016x}, in the log {self.digest:016x}"


def _measure_lobby_ns(segment: Segment) -> int:
    """Return the nanoseconds in a segment's lobbies, each of which lasts to the next team event or the segment's end.

    A team event is that a team formed, or that one ended for any reason but "declined".
    """
    ends_ns = []
    for event in segment.part_events:
        if isinstance(event, TeamFormed) or (isinstance(event, TeamEnded) and event.reason != "declined"):
            ends_ns.append(event.t_ns)
    waited_ns = 0
    for note in segment.notes:
        if isinstance(note, Noted) and (note.kind, note.text) == ("phase", Phase.LOBBY):
            end_ns = min((t_ns for t_ns in ends_ns if t_ns >= note.t_ns), default=segment.end_ns)
            waited_ns += end_ns - note.t_ns
    return waited_ns


def gather_team(
    formed: TeamFormed | None, ready: SeatsReadied | None, events: Sequence[ActivityEvent], steps: int
) -> TeamRecord | None:
    """Build the record of an episode's team from its events; return None if no team played it.

    Args:
        formed: the event that formed the block's team.
        ready: the event with all poses at the reset.
        events: the episode's events.
        steps: the number of the participant's own steps in the log, which may end between a joint step and the own one.
    """
    if formed is None:
        return None
    joint_steps = [event for event in events if isinstance(event, JointStepped)][:steps]
    seat_changes = [event for event in events if isinstance(event, SeatTaken)]
    n_seats = len(formed.seats)
    return TeamRecord(
        team=formed.team,
        index=formed.index,
        seat=formed.seat,
        role=formed.role,
        seats=formed.seats,
        actions=np.array([event.actions for event in joint_steps], np.int64).reshape(-1, n_seats),
        rewards=np.array([event.rewards for event in joint_steps], np.float64).reshape(-1, n_seats),
        poses=_gather_poses(ready, joint_steps, n_seats),
        sources=tuple(event.sources for event in joint_steps),
        digest=joint_steps[-1].digest if joint_steps else 0,
        late=sum(isinstance(event, InputLate) for event in events),
        takeovers=sum(event.by == "agent" for event in seat_changes),
        corrected=sum(isinstance(event, PictureCorrected) for event in events),
        sightings=tuple(event for event in events if isinstance(event, SeatSeen)),
    )


def _gather_poses(ready: SeatsReadied | None, joint_steps: Sequence[JointStepped], n_seats: int) -> NDArray[np.float64]:
    """Return all seats' poses at the reset and after each joint step, float64[steps + 1, seats, 4]; NaN if unknown.

    Args:
        ready: the event with all poses at the reset; None if the log lacks it.
        joint_steps: the events of the joint steps.
        n_seats: the number of seats.
    """
    unknown = (np.nan,) * 4 * n_seats
    poses = [unknown]
    if ready is not None and ready.poses:
        poses = [ready.poses]
    poses += [event.poses or unknown for event in joint_steps]
    return np.array(poses, np.float64).reshape(-1, n_seats, 4)


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeLog:
    """One played episode. ``n`` steps have ``n + 1`` poses, times and hashes, which is checked on creation."""

    start: EpisodeStarted  # plan, action names, mission, map, initial pose and hashes
    poses: NDArray[np.float64]  # (n + 1, 4) x, y, z, yaw_rad; NaN if unknown
    t_ns: NDArray[np.int64]  # (n + 1,) reset, then each step; session time
    actions: NDArray[np.int64]  # (n,)
    step_keys: Sequence[str]  # (n,) causing key, "" for a tick's no-op
    key_t_ns: NDArray[np.int64]  # (n,) session time
    rewards: NDArray[np.float64]  # (n,)
    terminated: NDArray[np.bool_]  # (n,)
    truncated: NDArray[np.bool_]  # (n,)
    rt_ms: NDArray[np.float64]  # (n,) NaN without a reaction time
    state_hashes: NDArray[np.uint64]  # (n + 1,)
    observation_hashes: NDArray[np.uint64]  # (n + 1,)
    keys: EventColumns[KeyPressed]  # every press and release while it ran
    frames: EventColumns[FrameShown]
    outcome: Outcome | None  # None if the log was cut off in this episode
    observations: Sequence[Any] | None = None  # (n + 1,) read on access; None if not recorded
    segment: int = 1  # the number of the segment in the session
    attempt: int = 1  # higher if an interrupted episode was begun again
    pauses: PauseSpans = ()  # between its reset and its last step, session time
    taught: TeachingRecord | None = None  # control and advice; None if no agent took part
    end_cause: EndCause = ""  # what ended it, such as a time limit, if no step did
    onsets: NDArray[np.bool_] | None = None  # (n + 1,) whether the picture shows a stimulus onset; None if none does
    team: TeamRecord | None = None  # seats and joint actions; None without a team
    action_vectors: NDArray[np.float64] | None = None  # (n, d) if actions are vectors, which ``actions`` then numbers
    successes: NDArray[np.float64] | None = None  # (n,) the world's success, NaN if unknown; None if not recorded
    infos: Sequence[Mapping[str, Any]] | None = None  # (n,) the keys of ``info`` that the plan keeps; None without any

    def __post_init__(self) -> None:
        """Check that each column has as many rows as the number of steps requires.

        Raises:
            ValueError: if a column has another number of rows.
        """
        n_steps = len(self.actions)
        n_states = n_steps + 1
        for name in ("poses", "t_ns", "state_hashes", "observation_hashes"):
            n_rows = len(getattr(self, name))
            if n_rows != n_states:
                raise ValueError(f"episode {self.number}: {name} has {n_rows} rows; one per state makes {n_states}")
        if self.team is not None and len(self.team.actions) != n_steps:
            n_joint = len(self.team.actions)
            raise ValueError(f"episode {self.number}: the team has {n_joint} joint actions; {n_steps} are needed")
        for name in ("step_keys", "key_t_ns", "rewards", "terminated", "truncated", "rt_ms"):
            n_rows = len(getattr(self, name))
            if n_rows != n_steps:
                raise ValueError(f"episode {self.number}: {name} has {n_rows} rows; one per step makes {n_steps}")

    @property
    def plan(self) -> EpisodePlan:
        """Return the episode's plan."""
        return self.start.plan

    @property
    def world_options(self) -> dict[str, Any]:
        """Return the options that recreate the world as played; in a team they include the other bodies' actions."""
        if self.team is None:
            return self.plan.options
        return {**self.plan.options, "script": self.team.actions.tolist()}

    @property
    def shared_options(self) -> dict[str, Any]:
        """Return the options of the world; in a team, only those that all seats share."""
        return {name: value for name, value in self.plan.options.items() if self.team is None or name != "seat"}

    @property
    def actions_taken(self) -> list[int | tuple[float, ...]]:
        """Return the ``n`` actions as a world's ``step`` takes them: numbers, or vectors if the log has vectors."""
        if self.action_vectors is None:
            return [int(action) for action in self.actions]
        return [tuple(vector) for vector in self.action_vectors.tolist()]

    @property
    def number(self) -> int:
        """Return the episode's number in the session, counted from 1 as people do. The log counts from 0."""
        return self.plan.episode + 1

    @property
    def name(self) -> str:
        """Return the episode's name in messages, such as "episode 3" or "episode 3 (attempt 2)"."""
        if self.attempt > 1:
            return f"episode {self.number} (attempt {self.attempt})"
        return f"episode {self.number}"

    @property
    def outcome_word(self) -> str:
        """Return the outcome as it appears in every table, or "cut_off" if the log ends before there was one."""
        return self.outcome or CUT_OFF

    @property
    def success(self) -> bool | None:
        """Return whether the goal was reached.

        None if no rule decides that, or if the world was to report it and did not.
        """
        if self.outcome == "ended":
            return None
        if self.outcome in ("goal", "timeout", "failure"):
            return self.outcome == "goal"
        rule = parse_outcome_rule(self.plan.outcome_rule)  # broken off: no success, if success is defined
        was_reported = self.successes is not None and not np.isnan(self.successes).all()
        if not rule.may_be_unknown or was_reported:
            return False
        return None

    @property
    def return_(self) -> float:
        """Return the sum of the rewards."""
        return float(self.rewards.sum())


def list_partner_seats(episode: EpisodeLog) -> tuple[int, ...]:
    """Return the indices of the other members' seats in an episode's team; empty if no team played it."""
    if episode.team is None:
        return ()
    return episode.team.partner_seats


@dataclass(frozen=True, slots=True, eq=False)
class SessionLog:
    """A recorded session. ``clean`` is False if the log was cut off and recovered, or is still being written."""

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
        """Return the notes of all segments, in order of time."""
        return tuple(note for segment in self.segments for note in segment.notes)

    @property
    def part_events(self) -> tuple[PartEvent, ...]:
        """Return the events of all parts other than play, in order; empty in logs older than session parts."""
        return tuple(event for segment in self.segments for event in segment.part_events)

    @property
    def waited_ns(self) -> int:
        """Return the nanoseconds in lobbies, each from arrival until a team formed, or the wait or segment ended."""
        return sum(_measure_lobby_ns(segment) for segment in self.segments)

    @property
    def stranded(self) -> bool:
        """Return whether one of the session's team blocks ended because no partner came or a partner left."""
        return any(
            isinstance(event, TeamEnded) and event.reason not in ("replaced", "declined") for event in self.part_events
        )

    @property
    def comparisons(self) -> tuple[PairComparison, ...]:
        """Return the pairs of clips that were compared, with the answers."""
        return gather_comparisons(self.part_events)

    @property
    def corrections(self) -> tuple[CorrectionRecord, ...]:
        """Return the participant's corrections, which demonstrate better actions from a step of an episode on."""
        return gather_corrections(self.part_events)

    @property
    def keys(self) -> EventColumns[KeyPressed]:
        """Return every key press and release of the session, including those outside episodes."""
        return EventColumns.joined([segment.keys for segment in self.segments])
