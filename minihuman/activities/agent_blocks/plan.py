"""Plans of blocks that an agent plays."""

from typing import Literal

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.keys import BUTTON_NAMES, RESERVED_KEYS

LATEST_POLICY = "latest"  # the policy that an earlier part of the session ended with


class AgentPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[blocks.agent]`` in the protocol."""

    policy: str = ""  # a policy file beside the protocol, an agent that is registered, LATEST; "": none yet
    step_ms: float = 600.0  # from the picture of one step to the next step
    acts: Literal["drawn", "likeliest"] = "drawn"  # which of the policy's actions is done
    learner: str = ""  # registered in minihuman.learners, settings behind a colon; "": nothing is learnt
    update_every: int = 1  # episodes
    budget_s: float = 60.0  # after which a learner is given up
    wait_s: float = 10.0  # how long the next episode waits for it at most
    hand_back: str = "space"  # takeover: the key by which the person gives the agent its control back
    good: str = "j"  # rating
    bad: str = "f"


class AgentPlayPlan(PlayPlan, frozen=True):
    """A block that an agent plays."""

    agent: AgentPlan = AgentPlan()


def check_agent(agent: AgentPlan, pool: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every (field, complaint) about values that make no agent; ``pool`` is the keys that may have an action."""
    own = [(name, getattr(agent, name)) for name in ("hand_back", "good", "bad")]
    waits = [(name, getattr(agent, name)) for name in ("budget_s", "wait_s")]
    updates, choose = agent.update_every, "which {}; choose another"
    checks = [
        (20 <= agent.step_ms <= 60_000, "step_ms", f"is {agent.step_ms:g}; an agent steps every 20 to 60000 ms"),
        (1 <= updates <= 10_000, "update_every", f"is {updates}; use 1 to 10000 episodes"),
        *((0 <= wait_s <= 86_400, name, f"is {wait_s:g}; use 0 to 86400 s") for name, wait_s in waits),
        *((key in BUTTON_NAMES, name, f"is {key!r}, which is not a key") for name, key in own),
        *(
            (key not in RESERVED_KEYS, name, f"is {key!r}, {choose.format('the session itself uses')}")
            for name, key in own
        ),
        *(
            (key not in pool, name, f"is {key!r}, {choose.format('may have an action ($.keys.pool)')}")
            for name, key in own
        ),
    ]
    return [(name, complaint) for is_valid, name, complaint in checks if not is_valid]
