"""The interaction of groups and conditions on a report's page, computed a second time from the logs' blocks.

The Wald-type statistic is written with the groups' means stacked and one matrix of contrasts between them, and its
permutations one at a time.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import scipy

MINUS = "\N{MINUS SIGN}"
PERMUTATIONS = 1_999
Frame = pd.DataFrame
Estimate = tuple[float, float]  # with its error


def tabulate_cells(rows: Sequence[Mapping[str, Any]], measure: str, conditions: Sequence[str]) -> Frame:
    """A row for each participant, a column for each condition: the mean over sessions."""
    people: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in rows:
        if row["block"] in conditions and row[measure] is not None and not math.isnan(row[measure]):
            person = people.setdefault((row["group"], row["participant"]), {})
            person.setdefault(row["block"], []).append(float(row[measure]))
    return Frame(
        [
            {"group": group, "participant": code}
            | {name: float(np.mean(values[name])) if name in values else math.nan for name in conditions}
            for (group, code), values in sorted(people.items())
        ]
    )


def wald(groups: Sequence[Any]) -> float:
    """The statistic of equal mean differences between conditions in two groups."""
    scores = [values[:, 1:] - values[:, :-1] for values in groups]
    apart = scores[0].mean(axis=0) - scores[1].mean(axis=0)
    spread = sum(np.atleast_2d(np.cov(values.T)) / len(values) for values in scores)
    return float(apart @ np.linalg.pinv(spread) @ apart)


def limit(groups: Sequence[Any]) -> tuple[float, Any]:
    """Krishnamoorthy and Yu's approximation of Hotelling's test without equal covariances: a factor, and the F."""
    scores = [values[:, 1:] - values[:, :-1] for values in groups]
    parts = [np.cov(values.T) / len(values) for values in scores]
    inverse = np.linalg.inv(parts[0] + parts[1])
    size = len(inverse)
    traces = 0.0
    for values, part in zip(scores, parts, strict=True):
        share = part @ inverse
        traces += (np.trace(share @ share) + np.trace(share) ** 2) / (len(values) - 1)
    freedom = (size + size**2) / traces
    return (freedom - size + 1) / (freedom * size), scipy.stats.f(size, freedom - size + 1)


def explain(groups: Sequence[Any], observed: float, others: Sequence[float]) -> tuple[Estimate, ...]:
    """The share of variance with its 90 % interval: F is scaled by what it takes for p = 0.05, which was drawn."""
    factor, f = limit(groups)
    effect, residual = f.args
    people = sum(map(len, groups))

    def shares(alpha: float) -> list[float]:
        critical = max(float(np.quantile(others, 1 - alpha)), f.isf(0.05) / factor)
        value = observed / critical * f.isf(0.05)
        found = [max(0.0, value * effect * (residual - 2) / residual - effect)]
        for chance in (0.95, 0.05):
            free = scipy.stats.ncf.cdf(value, effect, residual, 0) <= chance
            end = 0.0
            if not free:
                end = scipy.optimize.brentq(
                    lambda shift, chance=chance: scipy.stats.ncf.cdf(value, effect, residual, shift) - chance,
                    0,
                    50 * (value * effect + 10),
                )
            found.append(float(end))
        return [one / (one + people) for one in found]

    slack = 5 * math.sqrt(2 * 0.05 * 0.95 / PERMUTATIONS)
    ends = zip(*(shares(alpha) for alpha in (0.05 - slack, 0.05, 0.05 + slack)), strict=True)
    return tuple((middle, max(abs(a - middle), abs(b - middle)) + 1e-6) for a, middle, b in ends)


def omnibus(groups: Sequence[Any]) -> tuple[float, float, tuple[Estimate, ...]]:
    """The statistic, its p by permutations of participants and no less than the limit, and the share of variance."""
    observed = wald(groups)
    whole, first = np.concatenate(groups), len(groups[0])
    rng = np.random.default_rng(2)
    others = []
    for _ in range(PERMUTATIONS):
        order = rng.permutation(len(whole))
        others.append(wald((whole[order[:first]], whole[order[first:]])))
    as_far = 1 + sum(other >= observed * (1 - 1e-9) for other in others)
    factor, f = limit(groups)
    p = max(as_far / (PERMUTATIONS + 1), float(f.sf(observed * factor)))
    return observed, p, explain(groups, observed, others)


class Interaction:
    """A primary measure in two groups and several conditions."""

    def __init__(self, cells: Frame, order: Sequence[str], conditions: Sequence[str], label: str) -> None:
        self.cells, self.order, self.conditions, self.label = cells, order, conditions, label
        self.whole = cells.dropna()
        self.values = [self.whole.loc[self.whole["group"] == group, conditions].to_numpy(float) for group in order]
        self.n = [len(values) for values in self.values]
        self.reason = ""
        least = max(8, len(conditions) + 1)
        if min(self.n) < least:
            self.reason = f"{min(self.n)} in the smallest group: {len(conditions)} conditions need {least} per group"
        self.statistic, self.p = math.nan, math.nan
        self.explained: tuple[Estimate, ...] = ()
        if not self.reason:
            self.statistic, self.p, self.explained = omnibus(self.values)
        self.freedom = len(conditions) - 1

    def contrasts(self, compare: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
        """Each difference between two conditions, and the groups compared on it."""
        for a, b in combinations(range(len(self.conditions)), 2):
            first, second = (values[:, a] - values[:, b] for values in self.values)
            name = f"{self.conditions[a]} {MINUS} {self.conditions[b]}"
            yield name, compare(self.label, (self.order[0], self.order[1]), first, second)

    def pairs(self) -> Iterator[tuple[str, Any]]:
        """Each two conditions, and the values of the participants who have both."""
        for a, b in combinations(self.conditions, 2):
            yield f"{a} {MINUS} {b}", self.cells[[a, b]].dropna().to_numpy(float)


def join(names: Collection[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}"
