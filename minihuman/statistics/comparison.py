"""Comparisons of two groups: differences with permutation tests and effect sizes, equivalence tests, and the power of
such a comparison. States the reason where a test cannot be made.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

LEVEL = 0.95
RESAMPLES = 9_999
_AT_ONCE = 200_000  # values permuted at a time
SEED = 20_230_613  # of the permutations, so that the same data give the same p
LARGEST_G = 10  # above it a standardised difference says only that a spread is next to nothing
_TIES = 100 * np.finfo(np.float64).eps  # by so much may two that are equal come out apart
_NOTHING = (math.nan, math.nan)
_LARGEST_T = 1e9  # finite, as regroupings are told apart by subtraction

Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GroupComparison:
    """Two groups on one measure; differences are first minus second. NaN where the data do not tell."""

    measure: str
    first: str
    second: str
    n: tuple[int, int]  # participants that tell the measure
    means: tuple[float, float]
    difference: float
    interval: tuple[float, float]  # Welch's t interval of the difference
    p: float  # permutation test of |Welch's t|, two-sided
    p_holm: float  # corrected for all the comparisons made together
    smallest_p: float  # that groups of these sizes could have come to
    g: float  # Hedges' g
    g_interval: tuple[float, float]
    reason: str = ""  # why the two were not compared, or not in every way; "" where they were


def compare_groups(
    rows: pd.DataFrame, measures: Sequence[str], *, order: Sequence[str] = ()
) -> tuple[GroupComparison, ...]:
    """Compare every two groups on every measure; ``rows`` has one row a participant, with ``group`` and the measures.

    Of a pair, the group that is earlier in ``order`` comes first; without an order, the earlier in the alphabet. A pair
    that cannot be compared has its reason. p is corrected over all (Holm, 1979).
    """
    groups = list(order) or sorted({str(group) for group in rows["group"]})
    theirs = {group: rows.loc[rows["group"].astype(str) == group, list(measures)] for group in groups}
    told = {
        (group, measure): part[measure].dropna().to_numpy(float)
        for group, part in theirs.items()
        for measure in measures
    }
    pairs = [(measure, a, b) for measure in measures for a, b in combinations(groups, 2)]
    ps = permutation_ps([(told[a, measure], told[b, measure]) for measure, a, b in pairs])
    return correct_comparisons(
        [
            _compared(measure, (a, told[a, measure]), (b, told[b, measure]), p)
            for (measure, a, b), p in zip(pairs, ps, strict=True)
        ]
    )


def _compared(measure: str, first: tuple[str, Values], second: tuple[str, Values], p: float) -> GroupComparison:
    """Two groups, each a name and one value a participant, and the p of their difference."""
    (first_name, a), (second_name, b) = first, second
    n = len(a), len(b)
    means = tuple(float(values.mean()) if len(values) else math.nan for values in (a, b))
    one = GroupComparison(
        measure, first_name, second_name, n, (means[0], means[1]), means[0] - means[1], _NOTHING, math.nan, math.nan,
        math.nan, math.nan, _NOTHING,
    )  # fmt: skip
    if min(n) < 2:
        few = first_name if n[0] <= n[1] else second_name
        return replace(one, reason=f"{min(n)} in {few}: two a group are the least")
    one = replace(one, p=p, smallest_p=smallest_p(n))
    spreads = a.std(ddof=1), b.std(ddof=1)
    if max(spreads) == 0:
        return replace(one, reason="nobody in either group differs from the others")
    one = replace(one, interval=compare_means(a, b).interval(LEVEL))
    if min(spreads) == 0:
        alike, at = (first_name, means[0]) if spreads[0] == 0 else (second_name, means[1])
        return replace(one, reason=f"everybody in {alike} is at {at:g}: no standardised difference")
    g, half = hedges_g(a, b)
    if abs(g) > LARGEST_G:
        return replace(one, reason="spreads are next to nothing: no standardised difference")
    return replace(one, g=g, g_interval=(g - half, g + half))


@dataclass(frozen=True, slots=True)
class Welch:
    """A difference of two means with Welch's (1947) standard error and degrees of freedom."""

    difference: float
    error: float
    freedom: float

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """The t interval."""
        half = float(special.stdtrit(self.freedom, (1 + level) / 2)) * self.error
        return self.difference - half, self.difference + half

    @property
    def p(self) -> float:
        """Two-sided, of no difference."""
        return float(2 * special.stdtr(self.freedom, -abs(self.difference) / self.error))


def compare_means(a: Values, b: Values) -> Welch:
    """Two groups of two or more, not both without any spread."""
    parts = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(a) - 1) + parts[1] ** 2 / (len(b) - 1))
    return Welch(float(a.mean() - b.mean()), math.sqrt(sum(parts)), float(freedom))


def permutation_p(a: Values, b: Values) -> float:
    """The two-sided p of |Welch's t| over regroupings: all of them where there are fewer than RESAMPLES.

    Studentised (Janssen, 1997), so that a test of means stays one where spreads and sizes differ: of the plain
    difference, 5 against 25 with SDs 3 to 1 reject a true null in 27 to 29 % of studies.
    """
    return permutation_ps([(a, b)])[0]


def permutation_ps(pairs: Sequence[tuple[Values, Values]]) -> list[float]:
    """The p of each pair of groups, as ``permutation_p``; NaN where a group has fewer than two.

    Pairs of the same sizes are regrouped in the same ways, which are then made once.
    """
    found = [math.nan] * len(pairs)
    sizes = [(len(a), len(b)) for a, b in pairs]
    for n, m in sorted({size for size in sizes if min(size) > 1}):
        places = [place for place, size in enumerate(sizes) if size == (n, m)]
        together = {place: np.concatenate(pairs[place]) for place in places}
        least = {place: float(_welch(*pairs[place], axis=-1)) * (1 - _TIES) for place in places}
        as_far = dict.fromkeys(places, 0)
        regroupings = 0
        for orders in _regroupings(n, m):
            regroupings += len(orders)
            for place, values in together.items():
                regrouped = values[orders]
                as_far[place] += int((_welch(regrouped[:, :n], regrouped[:, n:], axis=-1) >= least[place]).sum())
        drawn = int(special.comb(n + m, n, exact=True) > RESAMPLES)  # the groups as they were are one more of them
        for place in places:
            found[place] = (as_far[place] + drawn) / (regroupings + drawn)
    return found


def _regroupings(n: int, m: int) -> Iterator[NDArray[np.int32]]:
    """Orders of all members, the first ``n`` of which are the first group: every one, or RESAMPLES drawn ones."""
    total, at_once = n + m, max(1, _AT_ONCE // (n + m))
    if special.comb(total, n, exact=True) <= RESAMPLES:
        chosen = combinations(range(total), n)
        while some := list(islice(chosen, at_once)):
            yield np.array([[*one, *sorted({*range(total)} - {*one})] for one in some], np.int32)
        return
    rng = np.random.default_rng(SEED)
    for begin in range(0, RESAMPLES, at_once):
        in_order = np.tile(np.arange(total, dtype=np.int32), (min(at_once, RESAMPLES - begin), 1))
        yield rng.permuted(in_order, axis=1, out=in_order)


def smallest_p(n: tuple[int, int]) -> float:
    """The smallest p that the permutation test can come to with groups of these sizes."""
    regroupings = special.comb(sum(n), n[0], exact=True)
    if regroupings > RESAMPLES:
        return 1 / (RESAMPLES + 1)
    return (2 if n[0] == n[1] else 1) / regroupings


def hedges_g(a: Values, b: Values) -> tuple[float, float]:
    """Hedges' g and half the width of its 95 % interval (Hedges and Olkin, 1985)."""
    n, m = len(a), len(b)
    pooled = math.sqrt(((n - 1) * a.var(ddof=1) + (m - 1) * b.var(ddof=1)) / (n + m - 2))
    g = float((a.mean() - b.mean()) / pooled) * (1 - 3 / (4 * (n + m) - 9))
    variance = (n + m) / (n * m) + 0.5 * g**2 / (n + m - 3.94)
    return g, float(special.ndtri(0.5 + LEVEL / 2)) * math.sqrt(variance)


def correct_comparisons(found: Sequence[GroupComparison]) -> tuple[GroupComparison, ...]:
    """The same with p corrected for how many there are; those that have none count as none."""
    return tuple(
        replace(one, p_holm=p) for one, p in zip(found, holm_correction([one.p for one in found]), strict=True)
    )


def holm_correction(ps: Sequence[float]) -> list[float]:
    """p values corrected for how many there are (Holm, 1979); NaN stays NaN and counts as none."""
    found = [math.nan] * len(ps)
    known = sorted((p, place) for place, p in enumerate(ps) if not math.isnan(p))
    largest = 0.0
    for rank, (p, place) in enumerate(known):
        largest = max(largest, min(1.0, p * (len(known) - rank)))
        found[place] = largest
    return found


def _welch(a: Values, b: Values, axis: int) -> Values:
    """|Welch's t|; very large where groups without any spread differ, 0 where they do not."""
    apart = np.abs(a.mean(axis=axis) - b.mean(axis=axis))
    error = np.sqrt(a.var(axis=axis, ddof=1) / a.shape[axis] + b.var(axis=axis, ddof=1) / b.shape[axis])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(apart < 1e-12, 0.0, np.minimum(apart / error, _LARGEST_T))


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Two one-sided tests (Schuirmann, 1987) of whether a difference lies within bounds, with Welch's t."""

    bounds: tuple[float, float]
    difference: float  # first minus second
    interval: tuple[float, float]  # of 90 %: it lies within the bounds where p is below 0.05
    p: float  # the larger of the two

    @property
    def alike(self) -> bool:
        """Whether the two are shown to be as near as the bounds say."""
        return self.p < 0.05


def check_equivalence(a: Values, b: Values, bounds: tuple[float, float]) -> Equivalence | None:
    """Whether the means of two groups differ by something within the bounds; None where nothing varies or too few tell.

    Raises:
        ValueError: if the bounds do not lie around 0.
    """
    low, high = bounds
    if not low < 0 < high:
        raise ValueError(f"equivalence bounds are {low:g} and {high:g}; use one below 0 and one above")
    if min(len(a), len(b)) < 2 or max(np.ptp(a), np.ptp(b)) == 0:
        return None
    found = compare_means(a, b)
    above = special.stdtr(found.freedom, -(found.difference - low) / found.error)
    below = special.stdtr(found.freedom, (found.difference - high) / found.error)
    return Equivalence(bounds, found.difference, found.interval(0.9), float(max(above, below)))


_LARGE_G = 0.8
_LIKELY = 0.8
_ONE_SIDED = 5.0  # standard errors
_LARGEST_G = 30.0
_NEAR_ENOUGH = 1e-9  # standard deviations


@dataclass(frozen=True, slots=True)
class PowerAnalysis:
    """What a comparison of two groups of these sizes could show, by a two-sided t test at 5 %."""

    n: tuple[int, int]
    power_for_large: float  # chance to find a difference of 0.8 standard deviations
    detectable_g: float  # the difference found with a chance of 80 %, in standard deviations
    needed_for_large: int  # participants per group for a chance of 80 % at 0.8 standard deviations


def compute_power(n: tuple[int, int]) -> PowerAnalysis:
    """What two groups of ``n`` participants could show. NaN for a group with fewer than two."""
    needed = next(size for size in range(2, 1000) if t_test_power(_LARGE_G, (size, size)) >= _LIKELY)
    if min(n) < 2:
        return PowerAnalysis(n, math.nan, math.nan, needed)
    return PowerAnalysis(n, t_test_power(_LARGE_G, n), _found_with(_LIKELY, n), needed)


def _found_with(chance: float, n: tuple[int, int]) -> float:
    """The difference in standard deviations that is found with such a chance, by halving what it lies between."""
    low, high = 0.0, _LARGEST_G
    while high - low > _NEAR_ENOUGH:
        middle = (low + high) / 2
        low, high = (middle, high) if t_test_power(middle, n) < chance else (low, middle)
    return (low + high) / 2


def t_test_power(d: float, n: tuple[int, int], *, level: float = LEVEL) -> float:
    """The chance that a two-sided t test finds a difference of ``d`` standard deviations (Cohen, 1988)."""
    freedom = sum(n) - 2
    shift = d * math.sqrt(n[0] * n[1] / sum(n))
    critical = float(special.stdtrit(freedom, (1 + level) / 2))
    above = 1.0 - float(special.nctdtr(freedom, shift, critical))
    # the other tail is nothing by then, and SciPy's is NaN
    below = float(special.nctdtr(freedom, shift, -critical)) if shift < _ONE_SIDED else 0.0
    return above + below
