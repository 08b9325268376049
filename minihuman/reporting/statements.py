"""The sentences that state a comparison on the page: differences, equivalence and power."""

import math
from collections.abc import Mapping
from types import MappingProxyType

from minihuman.reporting.block_measures import Role, phrase_measure
from minihuman.reporting.block_results import EquivalenceResult
from minihuman.reporting.template import (
    format_interval,
    format_number,
    format_p_value,
)
from minihuman.statistics.comparison import ALL_ALIKE, GroupComparison
from minihuman.statistics.paired import PairedComparison
from minihuman.statistics.t_tests import PowerAnalysis

_RATIO_OF = {  # of what a difference of logarithms is the logarithm of a ratio
    "log_excess_steps_mean": "excess steps + 1",
    "log_steps_ratio_mean": "steps",
}
_ALPHA = 0.05
_SMALLEST_SHOWN = 0.001  # below which every p is printed alike


def _begin_with_measure(name: str) -> str:
    """Return a measure's name with an initial capital letter, for the beginning of a sentence."""
    words = phrase_measure(name)
    return f"{words[0].upper()}{words[1:]}"


def difference_statement(
    comparison: GroupComparison, block: str, team_units: Mapping[str, str] = MappingProxyType({})
) -> str:
    """State in one sentence how much two groups differ in a block.

    Args:
        comparison: the comparison of the two groups.
        block: the block's name.
        team_units: by group, the words for its units if they are not participants alone.
    """
    operator = "over" if comparison.is_log else "minus"
    groups = f"{comparison.first} {operator} {comparison.second}"
    sizes = _count_units(comparison, team_units)
    opening = f"{_begin_with_measure(comparison.measure)}, block {block}: {groups} "
    if comparison.reason and math.isnan(comparison.p):
        return f"{opening}was not compared ({comparison.reason})."
    if comparison.reason == ALL_ALIKE and comparison.difference == 0:
        return f"{opening}is 0, and was not tested ({comparison.reason}; {sizes})."
    caveat = ""
    if comparison.smallest_p >= _ALPHA:
        caveat = " Groups of these sizes cannot reach p < 0.05, whatever the difference."
    if comparison.caution:
        caveat += f" With care: {comparison.caution}."
    size = ""
    if not math.isnan(comparison.g):
        interval = format_interval(comparison.g_interval, 2)
        size = f"; standardised difference g {format_number(comparison.g, 2)}, interval {interval}"
    estimate = f"{_state_estimate(comparison)}{_state_ratio(comparison)}"
    p = state_p(comparison.p, comparison.smallest_p)
    verdict = state_verdict(
        comparison.difference, comparison.p, comparison.first, comparison.second, p_holm=comparison.p_holm
    )
    return f"{opening}is {estimate}; permutation {p}{size}; {sizes}).{caveat}{verdict}"


def state_verdict(difference: float, p: float, first: str, second: str, *, p_holm: float = math.nan) -> str:
    """State which of two groups or conditions is larger, or that no difference is shown; "" if p is NaN.

    Args:
        difference: the first minus the second.
        p: the p value that the sentence states.
        first: the name of the first group or condition.
        second: the name of the second.
        p_holm: the p value after Holm's correction, if the verdict must add that it is no longer significant.
    """
    if math.isnan(p):
        return ""
    if p >= _ALPHA:
        return " No difference is shown."
    larger, smaller = (first, second) if difference > 0 else (second, first)
    verdict = f" The value is larger in {larger} than in {smaller}"
    if p_holm >= _ALPHA:
        return f"{verdict}, but not after Holm's correction (as in the tables)."
    return f"{verdict}."


def state_p(p: float, smallest_p: float) -> str:
    """State a p value, and whether it is the smallest that a test with so few participants or teams can yield."""
    words = f"p {format_p_value(p)}"
    if smallest_p >= _SMALLEST_SHOWN and math.isclose(p, smallest_p):
        return f"{words}, the smallest possible with so few"
    return words


def state_interval(interval: tuple[float, float], *, is_log: bool) -> str:
    """State a 95 % interval of a difference, or of a ratio if ``is_log``; or that there is none, and why."""
    if math.isnan(interval[0]):
        return "too few for a 95 % interval"
    if is_log:
        return f"95 % interval {format_interval((math.exp(interval[0]), math.exp(interval[1])))}"
    return f"95 % interval {format_interval(interval, sign='+')}"


def _count_units(comparison: GroupComparison, team_units: Mapping[str, str]) -> str:
    """State how many teams or participants the two groups have."""
    first, second = (team_units.get(group, "participants") for group in (comparison.first, comparison.second))
    if first == second:
        return f"{comparison.n[0]} and {comparison.n[1]} {second}"
    return f"{comparison.n[0]} {first} and {comparison.n[1]} {second}"


def _state_estimate(comparison: GroupComparison | PairedComparison) -> str:
    """State the difference, or the ratio of geometric means, with its interval; the caller closes the parenthesis."""
    if comparison.is_log:
        ratio = format_number(math.exp(comparison.difference))
        return f"{ratio} (ratio of geometric means; {state_interval(comparison.interval, is_log=True)}"
    difference = format_number(comparison.difference, sign="+")
    return f"{difference} ({state_interval(comparison.interval, is_log=False)}"


def _state_ratio(comparison: GroupComparison | PairedComparison) -> str:
    """State a difference of log steps as a ratio of steps; "" for other measures, or without an interval."""
    quantity = _RATIO_OF.get(comparison.measure)
    if quantity is None or math.isnan(comparison.interval[0]):
        return ""
    ratio = math.exp(comparison.difference)
    bounds = (math.exp(comparison.interval[0]), math.exp(comparison.interval[1]))
    return f"; as a ratio of {quantity}: {format_number(ratio)}, {format_interval(bounds)}"


def paired_statement(comparison: PairedComparison) -> str:
    """State in one sentence how much two conditions differ within participants."""
    caveat = ""
    if comparison.smallest_p >= _ALPHA:
        caveat = " So few participants cannot reach p < 0.05, whatever the difference."
    operator = "over" if comparison.is_log else "minus"
    conditions = f"{comparison.first} {operator} {comparison.second}"
    if not comparison.second:
        conditions = f"contrast {comparison.first}"
    p = state_p(comparison.p, comparison.smallest_p)
    ps = f"paired permutation {p}, Holm {format_p_value(comparison.p_holm)}"
    verdict = state_verdict(comparison.difference, comparison.p_holm, comparison.first, comparison.second)
    if not comparison.second:
        verdict = state_contrast_verdict(comparison.difference, comparison.p_holm)
    if comparison.p < _ALPHA <= comparison.p_holm:
        verdict = " After Holm's correction no difference is shown."
    return (
        f"{_begin_with_measure(comparison.measure)}, within participants: {conditions} is "
        f"{_state_estimate(comparison)}{_state_ratio(comparison)}; {ps}; {comparison.n} participants).{caveat}{verdict}"
    )


def state_contrast_verdict(difference: float, p: float) -> str:
    """State which side of a contrast is larger, or that no difference is shown; "" if p is NaN."""
    if math.isnan(p):
        return ""
    if p >= _ALPHA:
        return " No difference is shown."
    return f" The {'positive' if difference > 0 else 'negative'} side of the contrast is larger."


def equivalence_statement(equivalence: EquivalenceResult, roles: Mapping[str, Role]) -> str:
    """State in one sentence whether two groups are shown to be equivalent.

    ``roles`` are those of the block's measures, exactly one of which is primary: the one that was tested.
    """
    (primary,) = (name for name, role in roles.items() if role == "primary")
    test = equivalence.test
    groups = f"{equivalence.first} and {equivalence.second}"
    if test.reason:
        return f"{_begin_with_measure(primary)}: equivalence of {groups} was not tested ({test.reason})."
    verdict = "are equivalent" if test.alike else "are not shown to be equivalent"
    return (
        f"{_begin_with_measure(primary)}: {groups} {verdict} within {test.bounds[1]:g}, the protocol's margin "
        f"(two one-sided permutation tests, p {format_p_value(test.p)}; 90 % interval of "
        f"the difference {format_interval(test.interval, sign='+')})."
    )


def power_statement(power: PowerAnalysis, units: str = "participants") -> str:
    """State in one sentence which differences the sample could detect; ``units`` is the plural noun for its units."""
    sizes = f"{power.n[0]} and {power.n[1]} {units}"
    if math.isnan(power.power_for_large):
        return f"Power: with {sizes} no difference between groups can be tested."
    return (
        f"Power: with {sizes} a two-sided t test at 5 %, before any correction, detects a "
        f"difference of 0.8 standard deviations with a power of {100 * power.power_for_large:.0f} %; a power of 80 % "
        f"needs one of {power.detectable_g:.2f} standard deviations, or {power.needed_for_large} {units} per "
        f"group for one of 0.8."
    )
