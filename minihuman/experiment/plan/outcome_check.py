"""Checks of a protocol's outcome rules: who states them, and that nothing needs an unknown success."""

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.designs import make_design, make_enrolment_design
from minihuman.experiment.plan.part_plans import list_world_options
from minihuman.experiment.plan.stated_outcomes import (
    HOW_TO_STATE_A_RULE,
    StatedRule,
    find_outcome_rule,
    is_of_catalogue,
)
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import apply_overrides
from minihuman.worlds.adapters.success import can_keep, find_info, has_info, read_success
from minihuman.worlds.adapters.world import World
from minihuman.worlds.outcomes import WORLD_RULE, parse_outcome_rule

_N_EXAMPLE_KEYS = 3
N_TRIED_STEPS = 100  # in which a world's ``info`` is collected
_N_REPETITIONS = 3  # of each action in a row, so that the world changes
SUCCESS_MEASURES = frozenset(
    {
        *("success", "spl_mean", "steps_at_limit_mean"),
        *("log_excess_steps_mean", "log_steps_ratio_mean", "excess_steps_mean"),
    }
)


@dataclass(frozen=True, slots=True)
class TriedWorld:
    """The contents of a world's ``info`` during the steps in which it was tried."""

    is_own: bool  # whether the world is written with our classes, whose rewards define success
    values: Mapping[str, Any] = field(default_factory=dict)  # the first value of each key

    def can_know_success(self, rule: StatedRule) -> bool:
        """Return whether success can be known under an outcome rule in the world.

        A key of ``info`` that was not there during these steps may still come, as at an episode's end.
        """
        parsed = parse_outcome_rule(rule.rule)
        if not parsed.may_be_unknown:
            return True
        if not parsed.conditions:
            return False
        if parsed.info_key:
            return not has_info(self.values, parsed.info_key) or read_success(self.values, parsed.info_key) is not None
        return self.is_own or read_success(self.values) is not None


def check_outcome_rules(protocol: Protocol, source: str) -> tuple[str, ...]:
    """Check the outcome rules of a protocol's blocks; return lines that describe them and the ``info`` that is kept.

    ``source`` names the protocol's file in errors.

    Raises:
        ProtocolError: if something needs success in a block in which it is unknown, or a rule reads a key of ``info``
            that is no yes or no.
    """
    lines: list[str] = []
    for block in _list_variants(protocol):
        rule = find_outcome_rule(block)
        tried = try_world_info(block)
        if not tried.can_know_success(rule):
            _refuse_unknown_success(protocol, block, rule, tried, source)
        lines.append(f"outcome of block {block.name!r}: {_describe_rule(rule, tried)}")
        lines += _describe_info(block, rule, tried)
    return tuple(dict.fromkeys(lines))  # each once, as groups' variants of a block may have equal lines


def _refuse_unknown_success(
    protocol: Protocol, block: BlockSpec, rule: StatedRule, tried: TriedWorld, source: str
) -> None:
    """Refuse a block whose success is unknown, unless nothing needs it.

    Raises:
        ProtocolError: if the rule's key of ``info`` holds no yes or no, or if something in the protocol needs success.
    """
    location = f"{source}: block {block.name!r}"
    key = parse_outcome_rule(rule.rule).info_key
    if key:
        content = _describe_content(find_info(tried.values, key))
        raise ProtocolError(
            f"{location}: success is info[{key!r}], which is {content}; name a key, or KEY.PART of a dictionary, that "
            "is one yes or no"
        )
    if needs := list_success_needs(protocol, block):
        raise ProtocolError(
            f"{location}: {needs[0]} needs success, but no rule says what success is in {block.world}; "
            f"{HOW_TO_STATE_A_RULE}"
        )


def _describe_rule(rule: StatedRule, tried: TriedWorld) -> str:
    if rule.rule.startswith(WORLD_RULE) and tried.is_own:
        return "success if terminated and reward > 0, as its reward_and_done says; info['is_success'] overrides it"
    if rule.rule.startswith(WORLD_RULE) and not tried.can_know_success(rule):
        return f"unknown: every end is 'ended', success is empty; {HOW_TO_STATE_A_RULE}"
    return rule.describe()


def _describe_info(block: BlockSpec, rule: StatedRule, tried: TriedWorld) -> Iterator[str]:
    """Yield notices about keys of ``info``: those that are missing, cannot be logged, or are not recorded."""
    prefix = f"block {block.name!r}"
    success_key = parse_outcome_rule(rule.rule).info_key
    if success_key and not has_info(tried.values, success_key):
        yield f"{prefix}: info[{success_key!r}] was not there in {N_TRIED_STEPS} steps; {_describe_keys(tried)}"
    for key in block.record_info:
        if not has_info(tried.values, key):
            yield f"{prefix}: record_info names {key!r}, which the world did not say; {_describe_keys(tried)}"
            continue
        content = find_info(tried.values, key)
        if not can_keep(content):
            yield f"{prefix}: info[{key!r}] is {_describe_content(content)}, of which a log keeps null"
    recorded = {key.partition(".")[0] for key in block.record_info}
    unrecorded_keys = [key for key in tried.values if key not in recorded]
    if unrecorded_keys:
        names = ", ".join(unrecorded_keys)
        example = msgspec.json.encode(unrecorded_keys[:_N_EXAMPLE_KEYS]).decode()
        yield f"{prefix}: not kept of the world's info: {names}; record_info = {example} keeps them"


def _describe_keys(tried: TriedWorld) -> str:
    """Return a clause with the keys that a world's ``info`` had."""
    if tried.values:
        return f"info had {', '.join(tried.values)}"
    return "info was empty"


def _describe_content(content: Any) -> str:
    """Return a few words that describe a value of ``info``, such as "an array of shape (3,)"."""
    shape = getattr(content, "shape", None)
    if shape is not None:
        return f"an array of shape {tuple(shape)}"
    if isinstance(content, Mapping):
        return f"a dictionary of {len(content)}"
    return f"{content!r:.60}"


def list_success_needs(protocol: Protocol, block: BlockSpec) -> list[str]:
    """Return the names of what needs success in a block: stop criterion, points, designs, analysis; empty if none."""
    needs: list[str] = []
    if block.stop_criterion is not None:
        needs.append("stop_criterion")
    if block.points is not None and block.points.needs_success:
        needs.append("points" if protocol.bonus is None else "bonus, by its points,")
    if block.design is not None and make_design(block.design).needs_success:
        needs.append(f"design {block.design.name!r}")
    for spec in (protocol.allocation.design, protocol.allocation.stopping):
        if spec is None:
            continue
        design = make_enrolment_design(spec)
        if design.outcome == "success" and design.block in ("", block.name):
            needs.append(f"allocation by {spec.name!r}")
    analysis = protocol.analysis
    is_analysed = block.analysed and analysis.block in ("", block.name)
    measures = (analysis.primary_measure, *analysis.secondary_measures)
    success_measures = [measure for measure in measures if measure in SUCCESS_MEASURES]
    if is_analysed and success_measures:
        needs.append(f"analysis of {success_measures[0]!r}")
    return needs


def try_world_info(block: BlockSpec) -> TriedWorld:
    """Play a block's world for `N_TRIED_STEPS` steps, with all its actions in turn, and return the ``info`` seen.

    A world of the catalogue is not played if the block states no rule for success and records no ``info``.
    """
    is_well_known = is_of_catalogue(block.world)
    if is_well_known and not block.record_info and block.success is None:
        return TriedWorld(is_own=False)
    values: dict[str, Any] = {}
    with closing(World(block.world, list_world_options(block))) as world:
        is_own = world.reward_means_success
        world.name_actions(block.actions)
        names = dict.fromkeys((*block.actions, *filter(None, (block.noop_action,))))
        numbers = [world.action_names.index(name) for name in names]
        world.reset(0)
        for step in range(N_TRIED_STEPS):
            turn = step // _N_REPETITIONS % len(numbers)
            transition = world.step(numbers[turn])
            values = {**transition.info, **values}  # the first value of each key is kept
            if transition.terminated or transition.truncated:
                world.reset(step + 1)
    return TriedWorld(is_own, {key: content for key, content in values.items() if isinstance(key, str)})


def _list_variants(protocol: Protocol) -> list[BlockSpec]:
    """Return the blocks with the overrides of each group, each variant of a block once."""
    variants: list[BlockSpec] = []
    for block in protocol.blocks:
        for group in protocol.groups:
            variant = apply_overrides(block, group.name)
            if variant not in variants:
                variants.append(variant)
    return variants
