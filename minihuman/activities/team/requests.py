"""What a team's block asks of the team host, and the inputs that answer."""

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
    """Which team a session is in, and where it sits."""

    team: str  # a random id, the same in each member's log
    index: int  # of the team in the study
    seat: int
    seats: tuple[str, ...]  # by seat: "person", or the agent as the protocol names it


class TeamAnswerRequest(ActivityRequest):
    """A request that others' inputs answer."""

    __slots__ = ()
    awaits_others: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class TeamRequest(TeamAnswerRequest):
    """Which team is this session in?"""

    part: int
    block: str
    plan: TeamPlayPlan
    before: tuple[str, ...]  # the teams that the session was in, the latest last


@dataclass(frozen=True, slots=True)
class ReadyRequest(TeamAnswerRequest):
    """This seat is ready for an episode: may it begin?"""

    team: Team
    plan: EpisodePlan
    rules: TeamPlayPlan


@dataclass(frozen=True, slots=True)
class JointRequest(TeamAnswerRequest):
    """The next joint action."""

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
    """The team is complete."""

    team: Team
    salt: str = ""  # of the digests of this seat's words, a secret of its log; "" where nobody writes


@dataclass(frozen=True, slots=True)
class SeatsReady(ActivityInput):
    """Every seat is ready for an episode."""

    episode: int


@dataclass(frozen=True, slots=True)
class JointTaken(ActivityInput):
    """A joint action is closed."""

    episode: int
    step: int
    actions: tuple[int, ...]  # by seat
    sources: tuple[ActionSource, ...]


@dataclass(frozen=True, slots=True)
class SeatSighted(ActivityInput):
    """A person's seat is seen otherwise than before."""

    seat: int
    state: SeatState
    for_ms: int  # how long it has been so


@dataclass(frozen=True, slots=True)
class TeamLost(ActivityInput):
    """There is no team to go on with."""

    reason: GoneReason
