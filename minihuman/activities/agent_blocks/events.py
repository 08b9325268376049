"""Events of agent blocks."""

from dataclasses import dataclass
from typing import Literal

from minihuman.experiment.machine.events import ActivityEvent

Controller = Literal["agent", "person"]
ControlReason = Literal["start", "key", "hand_back", "no_policy", "agent_failed"]


@dataclass(frozen=True, slots=True)
class PolicyGiven(ActivityEvent):
    """A policy was received that plays from the next episode onwards, or a learner or agent failed."""

    part: int
    episode: int  # the next one
    policy: str  # SHA-256 of its file, or the name of an agent that has none; "" where there is none yet
    failure: str  # why a learner gave none; "" where it did


@dataclass(frozen=True, slots=True)
class LearnerAsked(ActivityEvent):
    """A learner was asked for a policy from everything taught so far."""

    part: int
    episode: int  # the first that it cannot know of


@dataclass(frozen=True, slots=True)
class Advised(ActivityEvent):
    """The action that the policy would take after a step, logged even while the person is in control."""

    episode: int
    step: int  # that it follows, 0 for the reset
    action: int  # the world's; drawn from the probabilities, or the likeliest
    probabilities: tuple[float, ...]  # by the world's action number


@dataclass(frozen=True, slots=True)
class ControlChanged(ActivityEvent):
    """Control passed to the agent or to the person."""

    episode: int
    step: int  # that it follows
    who: Controller
    reason: ControlReason
    pressed_ns: int  # when the key for it went down; t_ns where none did
