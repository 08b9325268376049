"""Study metadata for exports, from the protocol in a log, which describes the study, its worlds and devices."""

import json
from typing import Any

from minihuman.dataset.included_episodes import IncludedEpisode
from minihuman.dataset.study_facts import decode_plan_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import BlockSpec
from minihuman.experiment.protocol.specs import AboutSpec, DeviceSpec, apply_overrides


def get_doi_url(study_facts: AboutSpec) -> str:
    """Return the URL of a study's DOI; "" if the study has none."""
    if not study_facts.doi:
        return ""
    return f"https://doi.org/{study_facts.doi}"


def get_licence_id(study_facts: AboutSpec) -> str:
    """Return a study's licence as the Hugging Face Hub names it; "unknown" for a URL or no licence."""
    if not study_facts.licence or "://" in study_facts.licence:
        return "unknown"
    return study_facts.licence.lower()


def get_plan_devices(plan: SessionPlan) -> dict[str, DeviceSpec]:
    """Return the devices in a session's protocol, by name."""
    protocol = decode_plan_protocol(plan.protocol_toml)
    if protocol is None:
        return {}
    return {device.name: device for device in protocol.devices}


def describe_episode(item: IncludedEpisode) -> str:
    """Name an episode in words, e.g. "sub-07 session 1 episode 3"."""
    plan = item.log.plan
    return f"{plan.participant.id} session {plan.session} {item.episode.name}"


def get_action_names(item: IncludedEpisode) -> tuple[str, ...]:
    """Return the actions that participants could take in the episode's world, in the world's order."""
    plan = item.episode.plan
    offered = {*plan.key_map.keys.values(), *plan.actions, plan.noop}
    for block in _list_blocks(item):
        offered |= {*block.actions, *block.distractors, block.noop_action}
    return tuple(name for name in item.episode.start.action_names if name in offered)


def get_step_limit(item: IncludedEpisode) -> int:
    """Return the largest step limit that the protocol sets for an episode in this world."""
    return max([item.episode.plan.max_steps, *(block.max_steps for block in _list_blocks(item))])


def get_plain_facts(item: IncludedEpisode) -> dict[str, str | int]:
    """Return the episode's facts in types that file attributes can hold; mappings and lists become JSON text."""
    return {name: _flatten(fact) for name, fact in item.facts.items()}


def _flatten(fact: Any) -> str | int:
    """Return texts and whole numbers unchanged, and anything else as JSON text."""
    if isinstance(fact, str | int):
        return fact
    return json.dumps(fact)


def get_shared_options(item: IncludedEpisode) -> str | dict[str, Any]:
    """Return the world options shared by all episodes of a dataset; the block's name if they differ by episode."""
    plan = item.episode.plan
    block = next((block for block in _list_variants(item) if block.name == plan.block_name), None)
    if block is None or isinstance(_shared_options(block), dict):
        return plan.options
    return block.name


def _shared_options(block: BlockSpec) -> str | dict[str, Any]:
    """Return the options that a block's episodes share; its name if a design or a table sets each episode's own."""
    if block.design is None and block.stimuli is None:
        return block.options
    return block.name


def _list_blocks(item: IncludedEpisode) -> list[BlockSpec]:
    """List the blocks whose episodes share a dataset with this one, with each group's overrides applied."""
    shared = item.episode.plan.world, get_shared_options(item)
    return [block for block in _list_variants(item) if (block.world, _shared_options(block)) == shared]


def _list_variants(item: IncludedEpisode) -> list[BlockSpec]:
    protocol = decode_plan_protocol(item.log.plan.protocol_toml)
    if protocol is None:
        return []
    return [apply_overrides(block, group.name) for block in protocol.blocks for group in protocol.groups]
