"""Validation rules of ``[blocks.agent]``: each is a function that yields the errors it finds."""

from collections.abc import Iterator
from typing import Protocol

from minihuman.activities.agent_blocks.plan import AgentPlan
from minihuman.experiment.keys import BUTTON_NAMES, RESERVED_KEYS

RuleErrors = Iterator[tuple[str, str]]  # a field, and what is wrong with it
_KEY_FIELDS = ("hand_back", "good", "bad")


class AgentBlock(Protocol):
    """The fields of a protocol's block that the rules read."""

    kind: str
    pace: str
    agent: AgentPlan | None


def check_block(block: AgentBlock, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of an agent block in a protocol, each as a field's name and what is wrong with it.

    Args:
        block: the block, as the protocol has it.
        pool: the keys that may have an action.
    """
    if block.pace != "on_key":
        yield "pace", f"is {block.pace!r}, but the agent of a {block.kind} block has its own pace; leave it out"
    for field, error in check_agent(block.agent or AgentPlan(), pool):
        yield f"agent.{field}", error


def check_agent(agent: AgentPlan, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of an agent's settings, each as a field's name and what is wrong with it.

    Args:
        agent: the settings, as the protocol has them.
        pool: the keys that may have an action.
    """
    yield from _check_times(agent)
    for name in _KEY_FIELDS:
        yield from _check_key(name, getattr(agent, name), pool)


def _check_times(agent: AgentPlan) -> RuleErrors:
    """Yield an error for each period or time limit that is outside its limits."""
    if not 20 <= agent.step_ms <= 60_000:
        yield "step_ms", f"is {agent.step_ms:g}; an agent steps every 20 to 60000 ms"
    if not 1 <= agent.update_every <= 10_000:
        yield "update_every", f"is {agent.update_every}; use 1 to 10000 episodes"
    for name in ("budget_s", "wait_s"):
        wait_s = getattr(agent, name)
        if not 0 <= wait_s <= 86_400:
            yield name, f"is {wait_s:g}; use 0 to 86400 s"


def _check_key(name: str, key: str, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of the key in a field of the settings.

    A key is wrong if it is not the name of a key, if the session itself uses it, or if the pool of keys that may have
    an action contains it.
    """
    if key not in BUTTON_NAMES:
        yield name, f"is {key!r}, which is not a key"
    if key in RESERVED_KEYS:
        yield name, f"is {key!r}, which the session itself uses; choose another"
    if key in pool:
        yield name, f"is {key!r}, which may have an action ($.keys.pool); choose another"
