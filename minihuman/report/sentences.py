"""What the page says in whole sentences: how far groups are apart, whether they are alike, what could be found."""

import math
from collections.abc import Mapping

from minihuman.report.html import interval, number, p_value
from minihuman.report.results import MEASURES, Alike, Role
from minihuman.statistics.compare import Comparison
from minihuman.statistics.power import Power

_FACTORS = {  # of what a difference of logarithms is a factor
    "log_excess_steps_mean": "the steps over the best way, plus one",
    "log_steps_ratio_mean": "the steps",
}
FEW = 5  # participants a group, below which an effect size says little


def difference_statement(one: Comparison, block: str) -> str:
    """How far apart two groups are in a block, in one sentence."""
    name = MEASURES[one.measure]
    said = f"{name[0].upper()}{name[1:]}, block {block}: {one.first} minus {one.second} "
    if one.reason and math.isnan(one.p):
        return f"{said}was not compared ({one.reason})."
    few = " With so few participants the effect size says little." if min(one.n) < FEW else ""
    never = (
        " No difference between groups of these sizes could have come to p < 0.05." if one.smallest_p >= 0.05 else ""
    )
    return (
        f"{said}is {number(one.difference, sign='+')} (95 % interval {interval(one.interval, sign='+')}"
        f"{_as_factor(one)}; permutation p {p_value(one.p)}; Hedges' g {number(one.g, 2)}, "
        f"interval {interval(one.g_interval, 2)}; {one.n[0]} and {one.n[1]} participants).{few}{never}"
    )


def _as_factor(one: Comparison) -> str:
    """What a difference of logarithms of steps means: by how much they are multiplied."""
    of = _FACTORS.get(one.measure)
    if of is None or math.isnan(one.interval[0]):
        return ""
    factor, bounds = math.exp(one.difference), (math.exp(one.interval[0]), math.exp(one.interval[1]))
    return f"; as a factor of {of}: {number(factor, 2)}, {interval(bounds, 2)}"


def alike_statement(one: Alike, roles: Mapping[str, Role]) -> str:
    """Whether two groups are shown to be alike, in one sentence."""
    (primary,) = (name for name, role in roles.items() if role == "primary")
    name = MEASURES[primary]
    shown = "are shown to be alike" if one.test.alike else "are not shown to be alike"
    return (
        f"{name[0].upper()}{name[1:]}: {one.first} and {one.second} {shown} within {one.test.bounds[1]:g}, as the "
        f"protocol says (two one-sided tests, p {p_value(one.test.p)}; 90 % interval of the difference "
        f"{interval(one.test.interval, sign='+')})."
    )


def power_statement(one: Power) -> str:
    """What the sample could show, in one sentence."""
    a, b = one.n
    if math.isnan(one.power_for_large):
        return f"Power: with {a} and {b} participants no difference between groups can be tested."
    return (
        f"Power: with {a} and {b} participants a two-sided t test at 5 %, before any correction, finds a difference of "
        f"0.8 standard deviations with a chance of {100 * one.power_for_large:.0f} %; a chance of 80 % needs one "
        f"of {one.detectable_g:.2f} standard deviations, or {one.needed_for_large} participants a group for one of 0.8."
    )
