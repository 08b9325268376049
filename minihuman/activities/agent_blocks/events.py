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
    episode: int  # the next episode
    policy: str  # SHA-256 of its file, or the name of an agent that has none; "" where there is none yet
    failure: str  # why the learner or agent failed; "" where it did not


@dataclass(frozen=True, slots=True)
class LearnerAsked(ActivityEvent):
    """A learner was asked for a policy from everything taught so far."""

    part: int
    episode: int  # the first episode that the learner cannot know of


@dataclass(frozen=True, slots=True)
class Advised(ActivityEvent):
    """The action that the policy would take after a step, logged even while the person is in control."""

    episode: int
    step: int  # the step after which it was given, 0 for the reset
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
