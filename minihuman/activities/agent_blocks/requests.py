"""What blocks that an agent plays ask of the session host, and the inputs that answer."""

from dataclasses import dataclass

from minihuman.activities.agent_blocks.plan import AgentPlan
from minihuman.experiment.machine.activity import ActivityRequest
from minihuman.experiment.machine.inputs import ActivityInput


@dataclass(frozen=True, slots=True)
class PolicyRequest(ActivityRequest):
    """The part has begun, or its learner was asked: which policy plays from the next episode on?"""

    part: int
    name: str  # of the part
    agent: AgentPlan
    learning: bool  # a learner was asked for one, and has not answered; else it is the first that is asked for
    episode: int  # the first that the learner cannot know of
    policy: str  # that plays now; before the first, what the protocol calls it

    @property
    def takes_long(self) -> bool:
        """Whether a learner makes the policy."""
        return self.learning


@dataclass(frozen=True, slots=True)
class AdviceRequest(ActivityRequest):
    """A request for the policy's action in the world as it is now."""

    policy: str  # SHA-256 of its file, or its name
    step: int


@dataclass(frozen=True, slots=True)
class NewPolicy(ActivityInput):
    """A new policy, or the failure of a learner: then the policy before stays."""

    policy: str  # SHA-256 of its file, or the name of an agent that has none
    failure: str = ""  # why there is none


@dataclass(frozen=True, slots=True)
class Advice(ActivityInput):
    """The policy's probabilities of the world's actions, as float32 numbers."""

    step: int  # the step that the world was in
    probabilities: tuple[float, ...]  # by the world's action number
