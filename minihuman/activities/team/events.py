"""Events of team blocks."""

from dataclasses import dataclass
from typing import Literal

from minihuman.experiment.machine.events import ActivityEvent
from minihuman.experiment.machine.life_signs import SeatState

ActionSource = Literal["person", "late", "agent"]  # late: the idle action, since no input came in time
SeatHolder = Literal["person", "agent"]
# replaced: the seat is an agent's for good; declined: one of the team left before its first step
GoneReason = Literal["no_partner", "partner_left", "replaced", "declined"]


@dataclass(frozen=True, slots=True)
class TeamFormed(ActivityEvent):
    """Records that the team of a block is complete, with the seats and roles that the plan left open."""

    part: int
    team: str
    index: int
    seat: int
    role: str  # of this seat; "" where the protocol names none
    seats: tuple[str, ...]
    salt: str = ""


@dataclass(frozen=True, slots=True)
class SeatsReadied(ActivityEvent):
    """Every seat was ready for an episode."""

    episode: int
    poses: tuple[float, ...]  # at the reset, by seat: x, y, z and yaw_rad of each


@dataclass(frozen=True, slots=True)
class JointStepped(ActivityEvent):
    """A joint step was made: every body's action and reward. It precedes the event of the seat's own step."""

    episode: int
    step: int
    actions: tuple[int, ...]
    rewards: tuple[float, ...]
    sources: tuple[str, ...]
    digest: int  # of the episode's joint actions so far: see digest_joint_actions
    poses: tuple[float, ...]  # after it, by seat: x, y, z and yaw_rad of each
    silent_ms: tuple[int, ...] = ()  # by seat, by the server's clock: since its person's last sign of life


@dataclass(frozen=True, slots=True)
class InputLate(ActivityEvent):
    """Records an input of this seat that arrived after its step was closed, and so had no effect."""

    episode: int
    step: int
    action: int
    key: str
    key_t_ns: int


@dataclass(frozen=True, slots=True)
class PictureCorrected(ActivityEvent):
    """A picture reached the display that showed a step before it was closed.

    It showed this seat's action with the others idle; the others' actions then changed the step.
    """

    episode: int
    step: int
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class SeatTaken(ActivityEvent):
    """A different holder acts in a person's seat from this step on: an agent, or the person who has returned."""

    episode: int
    step: int
    seat: int
    by: SeatHolder


@dataclass(frozen=True, slots=True)
class SeatSeen(ActivityEvent):
    """The visible state of a person's seat changed: its page or its person is away, or is here again."""

    episode: int
    step: int  # that was open then
    seat: int
    state: SeatState
    for_ms: int  # how long it had been so; of one that is here again, since its last sign of life


@dataclass(frozen=True, slots=True)
class TeamEnded(ActivityEvent):
    """The block ended before its last episode, or the team before its first step.

    It ends because no partner came, or because one left.
    """

    part: int
    reason: GoneReason
