"""The agent that plays in a block beside a person: its first policy, its pace, and what learns between episodes."""

from typing import Literal

import msgspec

from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.keys import KEY_NAMES, RESERVED

LATEST = "latest"  # the policy that an earlier part of the session ended with


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


def complaints(agent: AgentPlan, pool: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every (field, complaint) about values that make no agent; ``pool`` is the keys that may have an action."""
    found = []
    if not 20 <= agent.step_ms <= 60_000:
        found.append(("step_ms", f"is {agent.step_ms:g}; an agent steps every 20 to 60000 ms"))
    if not 1 <= agent.update_every <= 10_000:
        found.append(("update_every", f"is {agent.update_every}; use 1 to 10000 episodes"))
    for name in ("budget_s", "wait_s"):
        if not 0 <= getattr(agent, name) <= 86_400:
            found.append((name, f"is {getattr(agent, name):g}; use 0 to 86400 s"))
    for name in ("hand_back", "good", "bad"):
        key = getattr(agent, name)
        if key not in KEY_NAMES:
            found.append((name, f"is {key!r}, which is no key"))
        elif key in RESERVED or key in pool:
            whose = "the session itself uses" if key in RESERVED else "may have an action ($.keys.pool)"
            found.append((name, f"is {key!r}, which {whose}; choose another"))
    return found
