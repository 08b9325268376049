"""Requests of agent blocks to the session host, and the inputs that answer them."""

from dataclasses import dataclass

from minihuman.activities.agent_blocks.plan import AgentPlan
from minihuman.experiment.machine.activity import ActivityRequest
from minihuman.experiment.machine.inputs import ActivityInput


@dataclass(frozen=True, slots=True)
class PolicyRequest(ActivityRequest):
    """A request for the policy of the next episodes, made as the part begins or after a learner was asked."""

    part: int
    name: str  # of the part
    agent: AgentPlan
    learning: bool  # a learner was asked for one, and has not answered; else it is the first that is asked for
    episode: int  # the first that the learner cannot know of
    policy: str  # the policy that plays now; before there is one, its name in the protocol

    @property
    def takes_long(self) -> bool:
        """Return whether the answer may take long, because a learner makes the policy."""
        return self.learning


@dataclass(frozen=True, slots=True)
class AdviceRequest(ActivityRequest):
    """A request for the policy's action probabilities in the world's present state."""

    policy: str  # SHA-256 of its file, or its name
    step: int


@dataclass(frozen=True, slots=True)
class NewPolicy(ActivityInput):
    """A new policy, or the failure of a learner or of the agent that plays.

    After a learner's failure, the previous policy stays in force.
    """

    policy: str  # SHA-256 of its file, or the name of an agent that has none
    failure: str = ""  # why there is none


@dataclass(frozen=True, slots=True)
class Advice(ActivityInput):
    """The policy's probabilities of the world's actions, as float32 numbers."""

    step: int  # the step that the world was in
    probabilities: tuple[float, ...]  # by the world's action number
