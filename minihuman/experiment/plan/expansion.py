"""Expansion of a protocol and a participant into a session plan. It is pure and gives the same plan on every machine.

Groups, orders and sessions become parts, texts become pages, and blocks become episodes with seeds and key maps.
"""

import hashlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec

from minihuman.activities.pages.plan import PagePlan
from minihuman.errors import ProtocolError
from minihuman.experiment.plan import trials
from minihuman.experiment.plan.allocation import AllocationSlot, allocation_sha256, build_allocation_list, find_slot
from minihuman.experiment.plan.key_maps import KeyMapPlanner
from minihuman.experiment.plan.part_names import KEYBOARD, is_block, list_part_names
from minihuman.experiment.plan.part_plans import (
    find_consent_text,
    list_changed_words,
    list_world_options,
    load_study_words,
    plan_parts,
)
from minihuman.experiment.plan.participant_codes import format_participant_code
from minihuman.experiment.plan.random_streams import draw_seeds
from minihuman.experiment.plan.session_plan import BlockText, EpisodePlan, KeyMap, Participant, SessionPlan
from minihuman.experiment.plan.stated_outcomes import find_outcome_rule
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.moved import forward_names
from minihuman.worlds.outcomes import OUTCOME_RULES

MAX_SESSION_EPISODES = 20_000  # since the plan is expanded and logged as a whole


def enrol_participant(
    protocol: Protocol, index: int, group: str | None = None, *, stratum: str | None = None
) -> Participant:
    """Return the participant at an index of the allocation list; ``group`` overrides the list's group.

    In a study with strata, the index refers to the list of ``stratum``, or of the first stratum if it is None.

    Raises:
        AllocationError: if the list is too short or there is no such stratum.
        ProtocolError: if there is no such group.
    """
    slot = find_slot(protocol, index, stratum)
    return assign_slot(protocol, Participant(format_participant_code(index), index, group or ""), slot)


def assign_slot(protocol: Protocol, participant: Participant, slot: AllocationSlot) -> Participant:
    """Return a participant with a slot, and with the slot's group unless the participant already has one.

    Raises:
        ProtocolError: if there is no such group.
    """
    group = protocol.group(participant.group or slot.group).name
    index = slot.index if slot.stratum else None
    return msgspec.structs.replace(participant, group=group, stratum=slot.stratum, slot=index)


def expand_protocol(
    protocol: Protocol,
    participant: Participant,
    *,
    session: int = 1,
    overridden: bool = False,
    first_episode: int = 0,
    segment: int = 1,
    outcome_rules: int = OUTCOME_RULES,
) -> SessionPlan:
    """Return the plan of everything that a participant's session contains, before its first key press.

    A plan made before the participant's group is drawn is valid only up to the draw. ``overridden`` means that the
    participant or the group was chosen by hand. A resumed session begins at the episode of index ``first_episode``, in
    a ``segment`` after the first. ``outcome_rules`` is the version of the rules that define outcomes, 0 in a study that
    began before there were any.
    """
    slots = build_allocation_list(protocol)
    slot = slots[participant.place if participant.group else 0]
    enrolled = participant
    participant = assign_slot(protocol, enrolled, slot)
    names = list_part_names(protocol, slot, participant.group, session)
    blocks = [protocol.block_for(name, participant.group) for name in names if is_block(protocol, name)]
    _require_few_episodes(blocks, session)
    rules = [find_outcome_rule(block, outcome_rules=outcome_rules).rule for block in blocks]
    episodes = [
        _set_outcome_rule(episode, rules[episode.block])
        for episode in _plan_blocks(protocol, blocks, participant, session, slot)
    ]
    parts = tuple(plan_parts(protocol, participant, session, names, blocks, episodes))
    asks_consent = any(isinstance(part.plan, PagePlan) and part.plan.agree for part in parts)
    consent_text = find_consent_text(protocol, participant.group, names) if asks_consent else ""
    return SessionPlan(
        study=protocol.study.name,
        study_version=protocol.study.version,
        protocol_toml=protocol.toml,
        protocol_sha256=protocol.sha256,
        participant=enrolled,
        session=session,
        study_seed=protocol.study.seed,
        allocation_sha256=allocation_sha256(slots),
        overridden=overridden,
        consent_text=consent_text,
        consent_sha256=hashlib.sha256(consent_text.encode()).hexdigest(),
        key_pool=protocol.keys.pool,
        keyboard_check=KEYBOARD in names,
        texts=tuple(_build_block_text(protocol, block) for block in blocks),
        closing_text=_find_closing_text(protocol),
        episodes=tuple(episodes),
        first_episode=first_episode,
        segment=segment,
        parts=parts,
        words=list_changed_words(protocol),
        language=protocol.study.language,
        bonus=protocol.bonus,
        fonts=protocol.study.fonts,
        files=trials.find_files(protocol),
        outcome_rules=outcome_rules,
    )


def _require_few_episodes(blocks: list[BlockSpec], session: int) -> None:
    count = sum(block.episodes for block in blocks)
    if count > MAX_SESSION_EPISODES:
        raise ProtocolError(f"session {session} has {count} episodes; use at most {MAX_SESSION_EPISODES}")


def _set_outcome_rule(episode: EpisodePlan, rule: str) -> EpisodePlan:
    """Return an episode's plan with an outcome rule; unchanged if the rule is ""."""
    if rule:
        return msgspec.structs.replace(episode, outcome_rule=rule)
    return episode


def _find_closing_text(protocol: Protocol) -> str:
    """Return the closing text in [study] (may be ""), or that of the study's language if [study] states none."""
    closing = protocol.study.closing
    if closing is None:
        return load_study_words(protocol)["closing.text"]
    return closing


def _build_block_text(protocol: Protocol, block: BlockSpec) -> BlockText:
    """Return the texts around a block; its feedback is "" if it depends on the outcome."""
    feedback = block.feedback if isinstance(block.feedback, str) else ""
    return BlockText(block.instructions, feedback, block.rest_text, protocol.study.min_rest_s)


def _plan_blocks(
    protocol: Protocol, blocks: list[BlockSpec], participant: Participant, session: int, slot: AllocationSlot
) -> list[EpisodePlan]:
    """Return the plans of the episodes of a session's blocks, in order; ``slot`` is the participant's."""
    key_maps = KeyMapPlanner(protocol, participant, session, slot)
    episodes: list[EpisodePlan] = []
    for number, block in enumerate(blocks):
        draw = _find_draw(protocol, block, number)
        key_map = key_maps.plan(block, draw)
        stimuli = trials.plan_stimuli(protocol, block, f"{block.name}-session-{session}", participant.index)
        seeds = _find_reset_seeds(protocol, block, draw, participant, session)
        episodes += _plan_episodes(block, number, key_map, stimuli, seeds, len(episodes))
    return episodes


def _find_draw(protocol: Protocol, block: BlockSpec, number: int) -> int:
    """Return the index of a block's draw of keys and seeds.

    It is the block's index in its session, ``number``, or its index in the file if the protocol lists parts.
    """
    if not protocol.lists_parts:
        return number
    return [candidate.name for candidate in protocol.blocks].index(block.name)


def _plan_episodes(
    block: BlockSpec,
    number: int,
    key_map: KeyMap,
    stimuli: Sequence[trials.TrialStimulus],
    seeds: Sequence[int],
    first_episode: int,
) -> list[EpisodePlan]:
    """Return the episode plans of a session's block ``number``, one for each seed, numbered from ``first_episode``."""
    return [
        EpisodePlan(
            episode=first_episode + index,
            block=number,
            block_name=block.name,
            episode_in_block=index,
            episodes_in_block=block.episodes,
            world=block.world,
            options=list_world_options(block) | stimuli[index].options,
            labels=stimuli[index].labels,
            seed=seed,
            actions=block.actions,
            key_map=key_map,
            show_keys=block.key_map == "shown" or block.show_keys,
            pace=block.pace,
            step_period_ms=block.step_period_ms,
            noop=block.noop_action,
            auto_repeat=block.auto_repeat,
            max_steps=block.max_steps,
            view=block.view,
            palette=block.palette,
            record_observations=block.record_observations,
            record_info=block.record_info,
            onset_at_reset=block.stimulus_onset == "reset",
            hold=block.hold,
            response_deadline_ms=block.response_deadline_ms,
        )
        for index, seed in enumerate(seeds)
    ]


def _find_reset_seeds(
    protocol: Protocol, block: BlockSpec, draw: int, participant: Participant, session: int
) -> tuple[int, ...]:
    """Return the world's reset seed of each of a block's episodes.

    They are the seeds that the block lists; if it has "new", a drawn seed for each episode; if it has "same", one drawn
    seed for all. ``draw`` is the index of the block's draw of keys and seeds.
    """
    if isinstance(block.seeds, tuple):
        return block.seeds
    purpose = f"layouts-{draw}-{block.name}-session-{session}"
    seeds = draw_seeds(block.episodes, seed=protocol.study.seed, purpose=purpose, index=participant.index)
    if block.seeds == "new":
        return seeds
    return seeds[:1] * block.episodes


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
