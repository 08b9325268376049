"""What was asked for, as the protocol in a log says it: a world's actions and limits, the facts about the study."""

from functools import lru_cache

from minihuman.data.chosen import Chosen
from minihuman.errors import ProtocolError
from minihuman.study.about import About
from minihuman.study.devices import Device
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Block, Protocol, decode_logged


def about_of(item: Chosen) -> About:
    """The facts about the study; empty where the log's protocol says none or cannot be read here."""
    return about_of_plan(item.log.plan)


def about_of_plan(plan: SessionPlan) -> About:
    """The same, of a session."""
    protocol = _protocol(plan.protocol_toml)
    return About() if protocol is None else protocol.about


def devices_of_plan(plan: SessionPlan) -> dict[str, Device]:
    """The devices of a session's protocol, by name."""
    protocol = _protocol(plan.protocol_toml)
    return {} if protocol is None else {device.name: device for device in protocol.devices}


def called(item: Chosen) -> str:
    """The episode in words: "sub-07 session 1 episode 3"."""
    plan = item.log.plan
    return f"{plan.participant.id} session {plan.session} {item.episode.name}"


def actions_of(item: Chosen) -> tuple[str, ...]:
    """The names of the actions that participants could take in the episode's world, in the world's own order."""
    plan = item.episode.plan
    asked = {*plan.key_map.keys.values(), *plan.actions} | ({plan.noop} if plan.noop else set())
    for block in _blocks(item):
        asked |= {*block.actions, *block.distractors} | ({block.noop} if block.noop else set())
    return tuple(name for name in item.episode.start.action_names if name in asked)


def most_steps_of(item: Chosen) -> int:
    """The largest step limit that the protocol gives an episode in this world."""
    return max([item.episode.plan.max_steps, *(block.max_steps for block in _blocks(item))])


def _blocks(item: Chosen) -> tuple[Block, ...]:
    plan = item.episode.plan
    protocol = _protocol(item.log.plan.protocol_toml)
    blocks = () if protocol is None else protocol.blocks
    return tuple(block for block in blocks if (block.world, block.options) == (plan.world, plan.options))


@lru_cache(maxsize=8)
def _protocol(toml: bytes) -> Protocol | None:
    try:
        return decode_logged(toml)
    except ProtocolError:
        return None
