"""How a measure changes over a block's episodes: a line for each person, then a comparison of the people.

The summary-statistics analysis of a random-slopes model: exact where everybody has the same episodes, and at its
nominal error where people's slopes differ, which a random intercept alone is not (with slopes of SD 0.01 around 0,
20 people and a term for the episode, it rejects a true null in a third of studies).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import special

from minihuman.statistics.comparison import LEVEL, Values, compare_means

MIN_EPISODES = 3  # for a line of one's own


@dataclass(frozen=True, slots=True)
class GrowthTerm:
    """One estimate over people, with its t interval and p; NaN where too few people tell it."""

    name: str
    estimate: float
    interval: tuple[float, float]
    p: float
    people: int


@dataclass(frozen=True, slots=True)
class GrowthComparison:
    """A measure at the middle of a block and its change an episode, in the reference group and against it."""

    measure: str
    reference: str  # every other group's terms are its difference from this one
    terms: tuple[GrowthTerm, ...]
    left_out: tuple[str, ...]  # groups with fewer than two people who have a line, and why


def compare_growth(rows: pd.DataFrame, measure: str, *, order: Sequence[str] = ()) -> GrowthComparison | None:
    """Lines of a measure over ``episode_in_block``, compared between groups. None where no group has two people.

    ``rows`` has one row an episode: ``participant``, ``group``, ``episode_in_block`` and the measure. The last group
    of ``order`` (of the alphabet without one) that can be compared is the reference.
    """
    told = rows.dropna(subset=[measure])
    middle = told["episode_in_block"].mean()
    lines: dict[str, list[tuple[float, float]]] = {}
    for (group, _), one in told.groupby(["group", "participant"], sort=True):
        at, values = one["episode_in_block"].to_numpy(float) - middle, one[measure].to_numpy(float)
        if len(np.unique(at)) >= MIN_EPISODES:
            slope, level = np.polyfit(at, values, 1)
            lines.setdefault(str(group), []).append((float(level), float(slope)))
    everyone = list(order) or sorted({str(group) for group in rows["group"]})
    groups = [group for group in everyone if len(lines.get(group, ())) >= 2]
    if not groups:
        return None
    *others, reference = groups
    people = {group: np.array(lines[group]) for group in groups}
    terms = []
    for column, name in enumerate((f"{measure} in the middle of the block", "change an episode")):
        base = people[reference][:, column]
        level = estimate_mean(f"{reference}: {name}", base)
        terms.append(level if column else replace(level, p=math.nan))  # a test of a level against 0 means nothing
        terms += [_difference(f"{group} minus {reference}: {name}", people[group][:, column], base) for group in others]
    left_out = tuple(
        f"{group}: {len(lines.get(group, ()))} with {MIN_EPISODES} episodes or more"
        for group in everyone
        if group not in groups
    )
    return GrowthComparison(measure, reference, tuple(terms), left_out)


def estimate_mean(name: str, values: Values) -> GrowthTerm:
    """A mean over people, with its t interval and the p of its being 0; NaN where they all have one value."""
    mean, n = float(values.mean()), len(values)
    if not np.ptp(values):
        return GrowthTerm(name, mean, (math.nan, math.nan), math.nan, n)
    error = float(values.std(ddof=1)) / math.sqrt(n)
    half = float(special.stdtrit(n - 1, (1 + LEVEL) / 2)) * error
    return GrowthTerm(name, mean, (mean - half, mean + half), float(2 * special.stdtr(n - 1, -abs(mean) / error)), n)


def _difference(name: str, values: Values, base: Values) -> GrowthTerm:
    people = len(values) + len(base)
    if not max(np.ptp(values), np.ptp(base)):
        return GrowthTerm(name, float(values.mean() - base.mean()), (math.nan, math.nan), math.nan, people)
    found = compare_means(values, base)
    return GrowthTerm(name, found.difference, found.interval(), found.p, people)
