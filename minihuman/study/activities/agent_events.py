"""What a session with an agent hears from outside and says: policies, what they would do, who steers, what was pressed.

Times are ns of the session, as everywhere; steps count from 0 for the reset.
"""

from dataclasses import dataclass
from typing import Literal

from minihuman.study.activities.agent_plan import AgentPlan
from minihuman.study.activities.port import Want
from minihuman.study.events import KindEvent
from minihuman.study.inputs import ForPart

Who = Literal["agent", "person"]
ControlReason = Literal["start", "key", "hand_back", "no_policy"]


@dataclass(frozen=True, slots=True)
class WantsPolicy(Want):
    """The part has begun, or its learner was asked: which policy plays from the next episode on?"""

    part: int
    name: str  # of the part
    agent: AgentPlan
    learning: bool  # a learner was asked for one, and has not answered; else it is the first that is asked for
    episode: int  # the first that the learner cannot know of
    policy: str  # that plays now; before the first, what the protocol calls it


@dataclass(frozen=True, slots=True)
class WantsAdvice(Want):
    """What would the policy do in the world as it is now?"""

    policy: str  # SHA-256 of its file, or its name
    step: int


@dataclass(frozen=True, slots=True)
class NewPolicy(ForPart):
    """A policy is there, or a learner failed: then the one before stays."""

    policy: str  # SHA-256 of its file, or the name of an agent that has none
    failure: str = ""  # why there is none


@dataclass(frozen=True, slots=True)
class Advice(ForPart):
    """How likely the policy thinks each of the world's actions to be best; float32 numbers."""

    step: int  # the step that the world was in
    probabilities: tuple[float, ...]  # by the world's action number


@dataclass(frozen=True, slots=True)
class PolicyGiven(KindEvent):
    """From the next episode on this policy plays."""

    part: int
    episode: int  # the next one
    policy: str  # SHA-256 of its file, or the name of an agent that has none; "" where there is none yet
    failure: str  # why a learner gave none; "" where it did


@dataclass(frozen=True, slots=True)
class LearnerAsked(KindEvent):
    """A learner is to make a policy of all that was shown so far."""

    part: int
    episode: int  # the first that it cannot know of


@dataclass(frozen=True, slots=True)
class Advised(KindEvent):
    """What the policy would do after a step, whoever steers."""

    episode: int
    step: int  # that it follows, 0 for the reset
    action: int  # the world's; drawn from the probabilities, or the likeliest
    probabilities: tuple[float, ...]  # by the world's action number


@dataclass(frozen=True, slots=True)
class ControlChanged(KindEvent):
    """Who steers from now on."""

    episode: int
    step: int  # that it follows
    who: Who
    reason: ControlReason
    pressed_ns: int  # when the key for it went down; t_ns where none did


@dataclass(frozen=True, slots=True)
class Rated(KindEvent):
    """A press that says good or bad. What it is about is nobody's business here: ``FrameShown`` says what was seen."""

    episode: int
    step: int  # the world's when the session took the press
    value: float  # 1 good, -1 bad
    pressed_ns: int
