"""Requests of team blocks to the team host, and the inputs that answer them."""

from dataclasses import dataclass
from typing import ClassVar

from minihuman.activities.team.events import ActionSource, GoneReason
from minihuman.activities.team.message_events import MessageShown
from minihuman.activities.team.plan import TeamPlayPlan
from minihuman.experiment.machine.activity import ActivityRequest
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.life_signs import SeatState
from minihuman.experiment.plan.session_plan import EpisodePlan


@dataclass(frozen=True, slots=True)
class Team:
    """The team that a session is in, and its seat there."""

    team: str  # a random id, the same in each member's log
    index: int  # of the team in the study
    seat: int
    seats: tuple[str, ...]  # by seat: "person", or the agent as the protocol names it


class TeamAnswerRequest(ActivityRequest):
    """A request that the team host answers once others have given their inputs."""

    __slots__ = ()
    awaits_others: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class TeamRequest(TeamAnswerRequest):
    """A request for a team, made in the lobby."""

    part: int
    block: str
    plan: TeamPlayPlan
    before: tuple[str, ...]  # the teams that the session was in, the latest last


@dataclass(frozen=True, slots=True)
class ReadyRequest(TeamAnswerRequest):
    """A request to begin an episode, made when this seat is ready for it."""

    team: Team
    plan: EpisodePlan
    rules: TeamPlayPlan


@dataclass(frozen=True, slots=True)
class JointRequest(TeamAnswerRequest):
    """A request for the next joint action, with this seat's input and messages."""

    team: Team
    plan: EpisodePlan
    rules: TeamPlayPlan
    step: int  # that it makes, 1 for the first
    action: int | None  # of this seat; None: its person has given none yet
    is_key: bool = True  # a key gave it; False: the world's idle action at a tick without one
    sent: tuple[MessageShown, ...] = ()  # by this seat, in this block
    received: frozenset[str] = frozenset()  # the digests of messages that it has
    is_held: bool = False  # that key went down for an earlier step
    states: tuple[SeatState, ...] = ()  # of the seats, as it knows them


@dataclass(frozen=True, slots=True)
class TeamJoined(ActivityInput):
    """The answer that the team is complete."""

    team: Team
    salt: str = ""  # of the digests of this seat's words, a secret of its log; "" where nobody writes


@dataclass(frozen=True, slots=True)
class SeatsReady(ActivityInput):
    """The answer that every seat is ready for an episode."""

    episode: int


@dataclass(frozen=True, slots=True)
class JointTaken(ActivityInput):
    """The joint action of a closed step."""

    episode: int
    step: int
    actions: tuple[int, ...]  # by seat
    sources: tuple[ActionSource, ...]
    silent_ms: tuple[int, ...] = ()  # by seat, since the last sign of life of its person


@dataclass(frozen=True, slots=True)
class SeatSighted(ActivityInput):
    """The news that the visible state of a person's seat has changed."""

    seat: int
    state: SeatState
    for_ms: int  # how long it has been so


@dataclass(frozen=True, slots=True)
class TeamLost(ActivityInput):
    """The answer that there is no team to continue with."""

    reason: GoneReason
