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
    """Return the devices in a session's protocol, by name; {} if the plan has no protocol."""
    protocol = decode_plan_protocol(plan.protocol_toml)
    if protocol is None:
        return {}
    return {device.name: device for device in protocol.devices}


def describe_episode(included: IncludedEpisode) -> str:
    """Name an episode in words, e.g. "sub-07 session 1 episode 3"."""
    plan = included.log.plan
    return f"{plan.participant.id} session {plan.session} {included.episode.name}"


def get_action_names(included: IncludedEpisode) -> tuple[str, ...]:
    """Return the actions that participants could take in the episode's world, in the world's order."""
    plan = included.episode.plan
    offered = {*plan.key_map.keys.values(), *plan.actions, plan.noop}
    for block in _list_blocks(included):
        offered |= {*block.actions, *block.distractors, block.noop_action}
    return tuple(name for name in included.episode.start.action_names if name in offered)


def get_step_limit(included: IncludedEpisode) -> int:
    """Return the largest step limit that the protocol sets for an episode in this world."""
    return max([included.episode.plan.max_steps, *(block.max_steps for block in _list_blocks(included))])


def get_plain_facts(included: IncludedEpisode) -> dict[str, str | int]:
    """Return the episode's facts in types that file attributes can hold; mappings and lists become JSON text."""
    return {name: _to_plain(fact) for name, fact in included.facts.items()}


def _to_plain(fact: Any) -> str | int:
    """Return texts and whole numbers unchanged, and anything else as JSON text."""
    if isinstance(fact, str | int):
        return fact
    return json.dumps(fact)


def get_shared_options(included: IncludedEpisode) -> str | dict[str, Any]:
    """Return the world options that all episodes of the episode's dataset share; its block's name if they differ."""
    plan = included.episode.plan
    block = next((block for block in _list_variants(included) if block.name == plan.block_name), None)
    if block is None or isinstance(_get_block_options(block), dict):
        return plan.options
    return block.name


def _get_block_options(block: BlockSpec) -> str | dict[str, Any]:
    """Return the options that a block's episodes share; the block's name if each episode has its own."""
    if block.design is None and block.stimuli is None:
        return block.options
    return block.name


def _list_blocks(included: IncludedEpisode) -> list[BlockSpec]:
    """List the blocks whose episodes share a dataset with this one, with each group's overrides applied."""
    shared = included.episode.plan.world, get_shared_options(included)
    return [block for block in _list_variants(included) if (block.world, _get_block_options(block)) == shared]


def _list_variants(included: IncludedEpisode) -> list[BlockSpec]:
    """List each block of the episode's protocol as each group plays it; empty without a protocol in the log."""
    protocol = decode_plan_protocol(included.log.plan.protocol_toml)
    if protocol is None:
        return []
    return [apply_overrides(block, group.name) for block in protocol.blocks for group in protocol.groups]
