"""The table ``[design]`` of a protocol file: the study's question, its primary effect, conditions and contrasts."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, Literal

import msgspec

from minihuman.experiment.protocol.validation_errors import FieldError

PrimaryEffect = Literal["", "groups", "conditions", "interaction"]
OPTION_PREFIX = "option:"
_ROUNDING = 1e-9  # the largest distance from 0 of the sum of weights such as 1/3


class ContrastSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A weighted sum of conditions, computed for each participant."""

    name: str
    weights: dict[str, float]  # condition -> weight; they sum to 0


class StudyDesignSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The parts of the design that do not follow from groups, blocks and sessions."""

    question: str = ""  # a sentence, which the report and the preregistration repeat
    primary_effect: PrimaryEffect = ""  # "" for the interaction if there are both groups and conditions
    condition: str = ""  # "option:NAME" if blocks with equal values of an option are one condition; "" for each block
    contrasts: tuple[ContrastSpec, ...] = ()


def name_conditions(
    condition: str, blocks: Iterable[str], options_by_block: Mapping[str, Mapping[str, Any]]
) -> dict[str, str]:
    """Return the condition of each block, by the block's name.

    Args:
        condition: "option:NAME" if a block's value of an option is its condition; "" if its own name is.
        blocks: the names of the blocks that are compared.
        options_by_block: the options of each block; a block without the option is left out of the result.
    """
    if not condition:
        return {block: block for block in blocks}
    option = condition.removeprefix(OPTION_PREFIX)
    return {
        block: str(options_by_block[block][option]) for block in blocks if option in options_by_block.get(block, {})
    }


def check_study_design(
    design: StudyDesignSpec,
    *,
    compared_blocks: tuple[str, ...],
    condition_label: str,
    options_by_block: Mapping[str, Mapping[str, Any]],
    has_groups: bool,
) -> Iterator[FieldError]:
    """Yield a (path, message) for each field of the table [design] that does not fit the study.

    If conditions are the levels of a label, the conditions in contrasts are not checked here: the levels are in tables
    of stimuli, with which ``check_stimuli`` compares them.

    Args:
        design: the table [design].
        compared_blocks: the names of the blocks whose conditions are compared.
        condition_label: the label of trials whose levels are the conditions; "" if blocks are the conditions.
        options_by_block: the options of each block.
        has_groups: whether the study has two or more groups.
    """
    needs_groups = design.primary_effect in ("groups", "interaction")
    needs_conditions = design.primary_effect in ("conditions", "interaction") or design.contrasts or design.condition
    if needs_groups and not has_groups:
        yield "$.design.primary_effect", f"is {design.primary_effect!r}, but the study has one group; add another"
    if condition_label:
        if design.condition:
            yield (
                "$.design.condition",
                f"is {design.condition!r}, but conditions are the levels of label {condition_label!r}; remove one",
            )
        yield from _check_contrasts(design.contrasts, None)
        return
    if needs_conditions and not compared_blocks:
        yield "$.design", "is about conditions; name the blocks, or a label of trials, in [analysis] conditions"
        return
    yield from _check_condition(design.condition, compared_blocks, options_by_block)
    conditions = set(name_conditions(design.condition, compared_blocks, options_by_block).values())
    yield from _check_contrasts(design.contrasts, conditions)


def _check_contrasts(contrasts: tuple[ContrastSpec, ...], conditions: set[str] | None) -> Iterator[FieldError]:
    """Yield the errors of contrasts; if ``conditions`` is None, names of conditions are not checked."""
    names = [contrast.name for contrast in contrasts]
    for number, contrast in enumerate(contrasts):
        path = f"$.design.contrasts[{number}]"
        if not contrast.name.strip() or contrast.name in names[:number]:
            yield f"{path}.name", f"is {contrast.name!r}; give each contrast its own name"
        if conditions is not None:
            yield from check_weighted_conditions(f"{path}.weights", contrast.weights, conditions)
        yield from _check_weights(f"{path}.weights", contrast.weights)


def _check_condition(
    condition: str, blocks: tuple[str, ...], options_by_block: Mapping[str, Mapping[str, Any]]
) -> Iterator[FieldError]:
    if not condition:
        return
    option = condition.removeprefix(OPTION_PREFIX)
    if option == condition or not option:
        yield "$.design.condition", f"is {condition!r}; write option:NAME, an option of the blocks that are compared"
        return
    unset = [block for block in blocks if option not in options_by_block.get(block, {})]
    if unset:
        yield "$.design.condition", f"is {condition!r}, which block {unset[0]!r} does not set; add it to its options"
    elif len(set(name_conditions(condition, blocks, options_by_block).values())) < 2:
        yield "$.design.condition", f"is {condition!r}, which is the same in all blocks that are compared; name another"


def check_weighted_conditions(
    path: str, weights: Mapping[str, float], conditions: Collection[str]
) -> Iterator[FieldError]:
    """Yield a (path, message) for each name in a contrast's weights that is not a condition; ``path`` is theirs."""
    for name in weights:
        if name not in conditions:
            yield path, f"has {name!r}, which is not a condition; conditions: {', '.join(sorted(conditions))}"


def _check_weights(path: str, weights: Mapping[str, float]) -> Iterator[FieldError]:
    if not all(map(math.isfinite, weights.values())) or not any(weights.values()):
        yield path, "has no finite weight other than 0; weigh two conditions or more"
    elif abs(math.fsum(weights.values())) > _ROUNDING:
        yield path, f"sum to {math.fsum(weights.values()):g}; the weights of a contrast sum to 0"
