"""The sentences that answer the study's question, at the top of the page."""

import math
from collections.abc import Iterator, Sequence

from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign
from minihuman.reporting.block_measures import phrase_measure
from minihuman.reporting.block_results import BlockResults, SessionChange
from minihuman.reporting.interactions import InteractionResults, state_interaction
from minihuman.reporting.results import Results
from minihuman.reporting.statements import (
    difference_statement,
    equivalence_statement,
    paired_statement,
    state_interval,
    state_verdict,
)
from minihuman.reporting.template import format_difference, format_p_value, format_pair
from minihuman.statistics.comparison import GroupComparison
from minihuman.statistics.permutation import ALPHA

_LIMITED_MEASURES = frozenset(  # that have one value, or nearly so, wherever the goal was not reached
    {"log_excess_steps_mean", "log_steps_ratio_mean", "steps_at_limit_mean", "spl_mean", "reward_mean"}
)
_MOST_AT_LIMIT = 1 / 3  # of a cell's episodes, above which the page warns at the top
_UNKNOWN = (math.nan, math.nan)
_WEIGHT_DIGITS = 9  # after the decimal point: weights such as 1/3 are rounded before they are compared


def state_answers(
    results: Results, interaction_results: InteractionResults | None, design: ExperimentDesign, first_block: str
) -> list[str]:
    """State the answers to the study's question: group differences, equivalence, conditions and interaction.

    If the question is about the interaction, its answer comes first, and conditions pooled over groups are left to
    their table. Where groups were measured in several sessions, their changes come before their means.

    Args:
        results: the study's results.
        interaction_results: the interaction of groups and conditions; None unless the design is mixed.
        design: the experimental design.
        first_block: the block whose group comparison answers the question; "" for none.
    """
    is_about_interaction = interaction_results is not None and design.primary_effect == "interaction"
    statements: list[str] = []
    if first_block:
        statements += _state_differences(results.target_block)
    if results.within and not is_about_interaction:
        roles = results.within.roles
        primary = [comparison for comparison in results.within.comparisons if roles[comparison.measure] == "primary"]
        statements += [paired_statement(comparison) for comparison in primary]
    if interaction_results is not None:
        interaction = list(state_interaction(interaction_results))
        statements = [*interaction, *statements] if is_about_interaction else [*statements, *interaction]
    if statements and design.contrasts:
        statements.append(_define_contrasts(design.contrasts, is_log=_compares_ratios(results, interaction_results)))
    return [*statements, *_state_ceiling(results, interaction_results, design, first_block)]


def _state_differences(target: BlockResults | None) -> Iterator[str]:
    """Yield a sentence for each comparison of groups in the target block; nothing if there is only one group."""
    if target is None or len(target.groups) < 2:
        return
    changes = list(_state_changes(target))
    yield from changes
    over_sessions = "Mean over the sessions. " if changes else ""
    for comparison in target.headline:
        yield f"{over_sessions}{difference_statement(comparison, target.block, target.team_units)}"
    for comparison in target.adjusted:
        statement = difference_statement(comparison, target.block, target.team_units)
        yield f"Adjusted for the covariates. {statement}"
    for equivalence in target.alike:
        yield equivalence_statement(equivalence, target.roles)


def _state_changes(target: BlockResults) -> Iterator[str]:
    """Yield sentences on how the groups' changes of the main measure between sessions differ, then on each change.

    If the groups' changes are compared, the sentences on single groups have no verdict. A change that is significant in
    only one of two groups would not show that the groups differ.
    """
    measures = {comparison.measure for comparison in target.headline}
    for sessions, comparison in target.changes_compared:
        if comparison.measure in measures:
            yield _state_changes_compared(sessions, comparison, target.block)
    for change in target.changes:
        if change.measure in measures:
            yield _state_change(change, target.block, has_verdict=not target.changes_compared)


def _compose_change_opening(measure: str, block: str, sessions: tuple[int, int]) -> str:
    """Return the beginning of a sentence on a change: the measure, the block and the two sessions."""
    words = phrase_measure(measure)
    return f"{words[0].upper()}{words[1:]}, block {block}, from session {sessions[0]} to {sessions[1]}"


def _state_change(change: SessionChange, block: str, *, has_verdict: bool) -> str:
    """State how a group changed between two sessions; ``has_verdict`` adds a sentence on whether a change is shown."""
    estimate = format_difference(change.estimate, _UNKNOWN, is_log=change.is_log, sign="+")
    p = f"paired permutation p {format_p_value(change.p)}"
    if math.isnan(change.p) or not has_verdict:
        verdict = ""
    elif change.p >= ALPHA:
        verdict = " No change is shown."
    else:
        verdict = f" The value {'rises' if change.estimate > 0 else 'falls'}."
    return (
        f"{_compose_change_opening(change.measure, block, change.sessions)}: {change.group} changes by {estimate} "
        f"({state_interval(change.interval, is_log=change.is_log)}; {p}; n {change.n}).{verdict}"
    )


def _state_changes_compared(sessions: tuple[int, int], comparison: GroupComparison, block: str) -> str:
    """State how the changes of two groups between two sessions differ, or why they are not compared."""
    groups = format_pair(comparison.first, comparison.second, is_log=comparison.is_log)
    opening = f"{_compose_change_opening(comparison.measure, block, sessions)}, difference of the changes, {groups}"
    if math.isnan(comparison.p):
        return f"{opening}: not compared ({comparison.reason})."
    estimate = format_difference(comparison.difference, _UNKNOWN, is_log=comparison.is_log, sign="+")
    return (
        f"{opening}: {estimate} ({state_interval(comparison.interval, is_log=comparison.is_log)}; "
        f"permutation p {format_p_value(comparison.p)}; n {comparison.n[0]} and {comparison.n[1]})."
        f"{state_verdict(comparison.difference, comparison.p, comparison.first, comparison.second)}"
    )


def _compares_ratios(results: Results, interaction: InteractionResults | None) -> bool:
    """Return whether the contrasts at the top of the page are of logarithms, and shown as ratios."""
    if interaction is not None:
        return any(compared.groups.is_log for compared in interaction.headline)
    return results.within is not None and any(comparison.is_log for comparison in results.within.headline)


def _define_contrasts(contrasts: Sequence[Contrast], *, is_log: bool) -> str:
    """Return a sentence that defines each contrast as a difference or, for logarithms, as a ratio of conditions."""
    operator = "over" if is_log else "minus"
    definitions = [f"{contrast.name}: {_spell_contrast(contrast, operator)}" for contrast in contrasts]
    return f"Contrasts, in this direction: {'; '.join(definitions)}."


def _spell_contrast(contrast: Contrast, operator: str) -> str:
    """Return a contrast as its positive side, the operator ("minus" or "over") and its negative side."""
    positive = {name: weight for name, weight in contrast.weights if weight > 0}
    negative = {name: -weight for name, weight in contrast.weights if weight < 0}
    return f"{_spell_side(positive)} {operator} {_spell_side(negative)}"


def _spell_side(weights: dict[str, float]) -> str:
    """Return the weighted sum of conditions as text; equal weights that sum to 1 are written as a mean."""
    names = list(weights)
    distinct_weights = {round(weight, _WEIGHT_DIGITS) for weight in weights.values()}
    if len(distinct_weights) == 1 and math.isclose(sum(weights.values()), 1):
        return names[0] if len(names) == 1 else f"the mean of {', '.join(names[:-1])} and {names[-1]}"
    terms = [name if weight == 1 else f"{weight:g} \N{MULTIPLICATION SIGN} {name}" for name, weight in weights.items()]
    return f"({' + '.join(terms)})" if len(terms) > 1 else terms[0]


def _count_failures(results: Results, compared: set[str]) -> Iterator[tuple[str, float]]:
    """Yield the words and the share for each group in a compared block with episodes that did not reach the goal.

    The words name the block, the group if there are several, and the number of such episodes.
    """
    for block in results.blocks:
        for group, times in block.waits.goal.items():
            missed = int((~times.observed).sum())
            if block.block in compared and missed:
                of_group = f" of {group}" if len(results.order) > 1 else ""
                share = missed / len(times.observed)
                yield f"{block.block}{of_group} {missed} of {len(times.observed)}", share


def _state_ceiling(
    results: Results, interaction: InteractionResults | None, design: ExperimentDesign, first_block: str
) -> Iterator[str]:
    """Yield a sentence that counts the episodes of compared cells that did not reach the goal.

    Nothing is yielded if all did, or if no compared measure is limited by failures.
    """
    target = results.target_block
    measures: set[str] = set()
    if first_block and target is not None and len(target.groups) > 1:
        measures.update(comparison.measure for comparison in target.headline)
    if interaction is not None:
        measures.add(interaction.measure)
    if results.within is not None:
        measures.add(results.within.measure)
    if not measures & _LIMITED_MEASURES:
        return
    cells = list(_count_failures(results, {first_block, *dict(design.condition_of_block)}))
    failing = [words for words, _ in cells]
    often_failing = [words for words, share in cells if share > _MOST_AT_LIMIT]
    if often_failing:
        yield (
            f"Many values are at the limit: of the episodes of a cell, more than a third did not reach the goal "
            f"({', '.join(often_failing)}). There the measure cannot tell how far from the goal they were, and "
            "differences from other cells may be larger than shown."
        )
    elif failing:
        yield (
            f"The measure counts an episode that did not reach the goal with its worst value ({', '.join(failing)}): "
            "differences between cells include these failures."
        )
