"""Plans of agent blocks."""

from collections.abc import Container
from typing import ClassVar, Literal

import msgspec

from minihuman.activities.play.plan import PlayPlan

AGENT_HOST = "minihuman.runtime.agent_host:make_policy_host"
LATEST_POLICY = "latest"  # the policy that an earlier part of the session ended with


class AgentPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of ``[blocks.agent]`` in the protocol."""

    policy: str = ""  # a policy file beside the protocol, an agent that is registered, LATEST; "": none yet
    step_ms: float = 600.0  # from the picture of one step to the next step
    acts: Literal["drawn", "likeliest"] = "drawn"  # which of the policy's actions is done
    learner: str = ""  # registered in minihuman.learners, settings behind a colon; "": nothing is learnt
    update_every: int = 1  # episodes
    budget_s: float = 60.0  # after which a learner is given up
    wait_s: float = 10.0  # how long the next episode waits for it at most
    hand_back: str = "space"  # takeover: the key by which the person gives the agent its control back
    good: str = "j"  # rating: the keys for a good and a bad step
    bad: str = "f"


class AgentPlayPlan(PlayPlan, frozen=True):
    """The plan of a block that an agent plays."""

    host: ClassVar[str] = AGENT_HOST
    agent: AgentPlan = AgentPlan()

    @property
    def needs_learner(self) -> bool:
        """Return whether a learner makes new policies during the block."""
        return bool(self.agent.learner)

    def plays_policy_file(self, files: Container[str]) -> bool:
        """Return whether the block plays a policy that a learner makes or that is one of the protocol's ``files``."""
        return bool(self.agent.learner) or self.agent.policy in files
