"""Comparisons of two groups: differences with permutation tests and effect sizes, equivalence tests, and the power of
such a comparison. States the reason where a test cannot be made.

What members of one team did is not independent, so a team has one value, the mean over its members, and tests over
participants become tests over teams: the permutation of |Welch's t| then regroups whole teams.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

LEVEL = 0.95
RESAMPLES = 9_999
ALPHA = 0.05
LEAST_PER_GROUP = 5  # participants per group, below whom nothing is standardised
LEAST_ESTIMATED = 4  # below whom a difference has no interval: of 2 against 18 it would hold the truth in 0.994
LEAST_FREEDOM = 5  # residual degrees of freedom, below which nothing is adjusted for covariates
_SMALL = 10  # participants in the smaller of unequal groups, below whom t floors p
_AT_ONCE = 200_000  # values permuted at a time
LARGEST_REGROUPED = 5_000  # values; of more, in large groups, the limit of the regroupings is drawn instead of them
LEAST_LARGE = 500  # participants in the smaller group, from whom on that limit holds for skewed values, too
_ALWAYS_DRAWN = 30  # participants; more in groups above three have more regroupings than RESAMPLES
_KEPT_SIZE = 200  # participants, up to whom regroupings are kept for the next measure: 16 MB
SEED = 20_230_613  # of the permutations, so that the same data give the same p
LARGEST_G = 10  # above it a standardised difference says only that a spread is next to nothing
_TIES = 1e-9  # by so much, relative, may two squared t that are equal come out apart
_NO_SPREAD = 1e-13  # of the squared deviations, a share that rounding leaves where there are none
_NOTHING = (math.nan, math.nan)
_LARGEST_T = 1e18  # squared

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
    interval: tuple[float, float]  # 95 %, of the differences that the permutation test does not reject
    p: float  # permutation test of |Welch's t|, two-sided
    p_holm: float  # corrected for all the comparisons made together
    smallest_p: float  # that groups of these sizes could have come to
    g: float  # of the average SD; NaN below five a group
    g_interval: tuple[float, float]
    reason: str = ""  # why the two were not compared, or not in every way; "" where they were
    is_log: bool = False  # the difference is one of natural logarithms, and the means are geometric


def compare_groups(
    rows: pd.DataFrame,
    measures: Sequence[str],
    *,
    order: Sequence[str] = (),
    log_measures: Collection[str] = (),
    intervals: bool = True,
) -> tuple[GroupComparison, ...]:
    """Compare every two groups on every measure; ``rows`` has one row a participant, with ``group`` and the measures.

    Of a pair, the group that is earlier in ``order`` comes first; without an order, the earlier in the alphabet. A pair
    that cannot be compared has its reason. p is corrected over all (Holm, 1979). ``log_measures`` hold natural
    logarithms: their means are reported as geometric means.
    Without ``intervals``, which take most of the time, nothing but p and means is computed.
    """
    groups = list(order) or sorted({str(group) for group in rows["group"]})
    values = {
        (group, measure): rows.loc[rows["group"].astype(str) == group, measure].dropna().to_numpy(float)
        for group in groups
        for measure in measures
    }
    pairs = [(measure, a, b) for measure in measures for a, b in combinations(groups, 2)]
    tests = permutation_tests([(values[a, measure], values[b, measure]) for measure, a, b in pairs])
    comparisons = [
        compare_pair(
            measure,
            (a, values[a, measure]),
            (b, values[b, measure]),
            test,
            is_log=measure in log_measures,
            intervals=intervals,
        )
        for (measure, a, b), test in zip(pairs, tests, strict=True)
    ]
    return correct_comparisons(comparisons)


def compare_pair(
    measure: str,
    first: tuple[str, Values],
    second: tuple[str, Values],
    test: "PermutationTest | AdjustedTest | None",
    *,
    is_log: bool,
    intervals: bool = True,
) -> GroupComparison:
    """Compare two groups, each a name and one value a participant."""
    (first_name, a), (second_name, b) = first, second
    n = len(a), len(b)
    means = tuple(float(values.mean()) if len(values) else math.nan for values in (a, b))
    reported_means = tuple(map(math.exp, means)) if is_log else means
    comparison = GroupComparison(
        measure, first_name, second_name, n, (reported_means[0], reported_means[1]), means[0] - means[1], _NOTHING, math.nan, math.nan,
        math.nan, math.nan, _NOTHING, is_log=is_log,
    )  # fmt: skip
    if test is None:
        smaller_group = first_name if n[0] <= n[1] else second_name
        return replace(comparison, reason=f"{min(n)} in {smaller_group}: two a group are the least")
    comparison = replace(comparison, p=test.p(), smallest_p=smallest_p(n))
    if not intervals:
        return comparison
    spreads = a.std(ddof=1), b.std(ddof=1)
    if max(spreads) == 0:
        return replace(comparison, reason="nobody in either group differs from the others")
    comparison = replace(comparison, interval=test.interval())
    if min(spreads) == 0:
        alike, at = (first_name, reported_means[0]) if spreads[0] == 0 else (second_name, reported_means[1])
        return replace(comparison, reason=f"everybody in {alike} is at {at:g}: no standardised difference")
    if min(n) < LEAST_ESTIMATED:
        smaller_group = first_name if n[0] <= n[1] else second_name
        return replace(comparison, reason=f"{min(n)} in {smaller_group}: an interval needs {LEAST_ESTIMATED} per group")
    if min(n) < LEAST_PER_GROUP:
        return comparison
    g, interval = standardise(a, b, comparison.interval)
    if abs(g) > LARGEST_G:
        return replace(comparison, reason="spreads are next to nothing: no standardised difference")
    return replace(comparison, g=g, g_interval=interval)


@dataclass(frozen=True, slots=True)
class Welch:
    """A difference of two means with Welch's (1947) standard error and degrees of freedom."""

    difference: float
    error: float
    freedom: float

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """The t interval."""
        half = float(scipy.special.stdtrit(self.freedom, (1 + level) / 2)) * self.error
        return self.difference - half, self.difference + half

    @property
    def p(self) -> float:
        """Two-sided, of no difference."""
        return float(2 * scipy.special.stdtr(self.freedom, -abs(self.difference) / self.error))


def compare_means(a: Values, b: Values) -> Welch:
    """Two groups of two or more, not both without any spread."""
    parts = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(a) - 1) + parts[1] ** 2 / (len(b) - 1))
    return Welch(float(a.mean() - b.mean()), math.sqrt(sum(parts)), float(freedom))


@dataclass(frozen=True, slots=True, eq=False)
class PermutationTest:
    """The permutation test of |Welch's t| of two groups, for any shift between their means.

    Studentised (Janssen, 1997), so that a test of means stays one where spreads and sizes differ: of the plain
    difference, 5 against 25 with SDs 3 to 1 reject a true null in 27 to 29 % of studies. The interval holds the shifts
    that the same regroupings do not reject at 5 %, so that it never contradicts p.
    """

    n: tuple[int, int]
    difference: float
    error: float  # of the difference, Welch's
    freedom: float  # and its degrees of freedom
    sum_of_squares: float  # within groups
    members: Values  # (regroupings,) how many of the first group stay in it
    sums: Values  # (regroupings,) in the first group, of deviations from the own group's mean
    own_sums: Values  # (regroupings,) the same, over those who stay
    squares: Values  # (regroupings,) of those deviations
    extra: int  # 1 where regroupings were drawn: the groups as they were are one more of them

    def p(self, shift: float = 0.0) -> float:
        """The two-sided p of a difference of ``shift``.

        Groups of unequal sizes, of which one is below ten, make regroupings reject a true null too often if the small
        one varies more, so there p is no smaller than Welch's t has it; below four participants, than a t with the
        smaller group's degrees of freedom, which is never too small for normal values (Mickey and Brown, 1966).
        """
        p = self.regrouped_p(shift)
        if self.error > 0 and smallest_p(self.n) < ALPHA and (freedom := floor_freedom(self.n, self.freedom)):
            p = max(p, float(2 * scipy.special.stdtr(freedom, -abs(self.difference - shift) / self.error)))
        return p

    def regrouped_p(self, shift: float = 0.0) -> float:
        """The share of regroupings that are at least as far apart as the groups, once the first is moved by -shift."""
        (n, m), d = self.n, self.difference - shift
        sums = self.sums + d * self.members
        squares = self.squares + d * (2 * self.own_sums + d * self.members)
        total = n * d
        total_squares = self.sum_of_squares + n * d * d
        scale = total_squares / (n + m)
        other_sums = total - sums
        apart = (sums / n - other_sums / m) ** 2
        error = _squared_error(squares - sums**2 / n, n, scale)
        error += _squared_error(total_squares - squares - other_sums**2 / m, m, scale)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(apart <= _NO_SPREAD * scale, 0.0, np.minimum(apart / error, _LARGEST_T))
        least = 0.0 if d * d <= _NO_SPREAD * scale else _LARGEST_T
        if least and self.error**2 > _NO_SPREAD * scale:
            least = min((d / self.error) ** 2, _LARGEST_T)
        as_far = int(np.count_nonzero(t >= least * (1 - _TIES)))
        return (as_far + self.extra) / (len(t) + self.extra)

    @property
    def has_interval(self) -> bool:
        """Whether values vary, and groups are large enough for an interval and for p < 0.05."""
        return self.error > 0 and min(self.n) >= LEAST_ESTIMATED and smallest_p(self.n) < ALPHA

    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the difference; NaN where it has none."""
        if self.has_interval:
            return invert_test(self.p, self.difference, self.error)
        return _NOTHING


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedTest:
    """The permutation test of a difference of two groups at equal covariates (an analysis of covariance).

    Residuals of the model without groups are permuted and the whole model is fitted to them again (Freedman and Lane,
    1983), so that p counts the error of the slopes. Studentised by HC3 (DiCiccio and Romano, 2017); p is no smaller
    than its t has it where sizes differ, as in the test of means. The interval inverts the same test.
    """

    n: tuple[int, int]
    difference: float
    error: float  # HC3
    freedom: float  # Welch's, of the values at equal covariates, less a degree per covariate
    shifts: Values  # (permutations,) what each permutation estimates of the residuals
    own_shifts: Values  # (permutations,) and of the groups less what covariates predict of them
    squares: Values  # (3, permutations) squared error: of a shift of 0, and its first and second power's coefficients

    def p(self, shift: float = 0.0) -> float:
        """The two-sided p of an adjusted difference of ``shift``."""
        observed = abs(self.difference - shift) / self.error
        d = -shift
        error = self.squares[0] + 2 * d * self.squares[1] + d * d * self.squares[2]
        apart = np.abs(self.shifts + d * self.own_shifts) / np.sqrt(np.maximum(error, 1 / _LARGEST_T))
        regrouped = (int(np.count_nonzero(apart >= observed * (1 - _TIES))) + 1) / (len(apart) + 1)
        floor = floor_freedom(self.n, self.freedom)
        if floor:
            return max(regrouped, float(2 * scipy.special.stdtr(floor, -observed)))
        return regrouped

    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the adjusted difference."""
        return invert_test(self.p, self.difference, self.error)


def adjust_groups(a: tuple[Values, Values], b: tuple[Values, Values]) -> tuple[Values, Values, AdjustedTest] | None:
    """Two groups' values at the covariates' means, and the test of their difference.

    Args:
        a: values (n,) and covariates (n, covariates) of the first group.
        b: of the second group.

    Returns:
        None where fewer than LEAST_FREEDOM residual degrees of freedom are left, a group has fewer than
        LEAST_ESTIMATED, or the covariates leave nothing to compare.
    """
    n = len(a[0])
    m = len(b[0])
    values, covariates = (np.concatenate(arrays) for arrays in zip(a, b, strict=True))
    freedom = n + m - 2 - covariates.shape[1]
    if freedom < LEAST_FREEDOM or min(n, m) < LEAST_ESTIMATED:
        return None
    centred = covariates - covariates.mean(axis=0)
    basis = np.linalg.qr(np.column_stack([np.ones(n + m), centred]))[0]
    groups = (np.arange(n + m) < n).astype(float)
    x, e = (column - basis @ (basis.T @ column) for column in (groups, values))
    scale = float(x @ x)
    if scale <= _NO_SPREAD * (n + m) or e @ e <= _NO_SPREAD * float(values @ values):
        return None
    weights = (x / scale / np.maximum(1 - (basis**2).sum(axis=1) - x**2 / scale, _TIES)) ** 2

    def fit(rows: Values) -> tuple[Values, Values]:
        rows = rows - (rows @ basis) @ basis.T
        shifts = rows @ x / scale
        return shifts, rows - shifts[:, None] * x

    (difference,), residuals = fit(e[None])
    rng = np.random.default_rng(SEED)
    if has_limit(n, m, n + m):
        shifts = rng.standard_normal(RESAMPLES)
        own_shifts = np.zeros(1)
        squares = np.array([[1.0], [0.0], [0.0]])
    else:
        order = rng.permuted(np.tile(np.arange(n + m), (RESAMPLES, 1)), axis=1)
        (shifts, left), (own_shifts, own_left) = fit(e[order]), fit(x[order])
        squares = np.stack([left**2 @ weights, (left * own_left) @ weights, own_left**2 @ weights])
    error = math.sqrt(float(residuals[0] ** 2 @ weights))
    slopes = np.linalg.lstsq(centred, values - difference * (groups - groups.mean()) - values.mean(), rcond=None)[0]
    adjusted = values - centred @ slopes
    satterthwaite = max(compare_means(adjusted[:n], adjusted[n:]).freedom - covariates.shape[1], 1.0)
    test = AdjustedTest((n, m), float(difference), error, satterthwaite, shifts, own_shifts, squares)
    return adjusted[:n], adjusted[n:], test


def invert_test(p: Callable[[float], float], estimate: float, error: float) -> tuple[float, float]:
    """The interval of the values that a two-sided test does not reject at 5 %, searched outwards from the estimate."""
    zero_rejected = p(0.0) < ALPHA
    return (
        _search_bound(p, estimate, -error, zero_rejected=zero_rejected),
        _search_bound(p, estimate, error, zero_rejected=zero_rejected),
    )


def _search_bound(p: Callable[[float], float], estimate: float, step: float, *, zero_rejected: bool) -> float:
    inside = estimate
    outside = math.nan
    if -estimate * step > 0:  # 0 lies on this side, and what p says of it stands
        inside, outside = (estimate, 0.0) if zero_rejected else (0.0, math.nan)
    while math.isnan(outside):
        if p(inside + step) < ALPHA:
            outside = inside + step
        else:
            inside = inside + step
            step = 2 * step
    while abs(outside - inside) > 1e-6 * abs(step):
        middle = (inside + outside) / 2
        inside, outside = (inside, middle) if p(middle) < ALPHA else (middle, outside)
    return inside


def _squared_error(squares: Values, n: int, scale: float) -> Values:
    """Of a mean, from its group's sum of squares; exactly 0 where only rounding leaves any."""
    return np.where(squares <= _NO_SPREAD * scale * n, 0.0, squares / (n * (n - 1)))


def permutation_tests(pairs: Sequence[tuple[Values, Values]]) -> list[PermutationTest | None]:
    """The test of each pair of groups over their regroupings, all of them if there are at most RESAMPLES.

    None where a group has fewer than two. Pairs of the same sizes are regrouped in the same ways.
    """
    tests: list[PermutationTest | None] = [None] * len(pairs)
    sizes = [(len(a), len(b)) for a, b in pairs]
    for n, m in sorted({size for size in sizes if min(size) > 1}):
        places = [place for place, size in enumerate(sizes) if size == (n, m)]
        means = [(float(pairs[place][0].mean()), float(pairs[place][1].mean())) for place in places]
        deviations = np.array(
            [np.concatenate([pairs[at][0] - a, pairs[at][1] - b]) for at, (a, b) in zip(places, means, strict=True)]
        )
        ours = np.arange(n + m) < n
        columns = np.concatenate([deviations, deviations**2, deviations * ours, ours[None]]).T
        totals = draw_totals(columns, n)
        extra = int(count_regroupings(n, m) > RESAMPLES)
        count = len(places)
        for at, (place, (a, b)) in enumerate(zip(places, means, strict=True)):
            squares = deviations[at] ** 2
            parts = np.array([squares[:n].sum() / (n * (n - 1)), squares[n:].sum() / (m * (m - 1))])
            error = math.sqrt(parts.sum())
            if error > 0:
                freedom = float(parts.sum() ** 2 / (parts**2 / (n - 1, m - 1)).sum())
            else:
                freedom = math.nan
            tests[place] = PermutationTest(
                (n, m), a - b, error, freedom, float(squares.sum()), totals[:, -1], totals[:, at],
                totals[:, 2 * count + at], totals[:, count + at], extra,
            )  # fmt: skip
    return tests


def draw_totals(columns: Values, n: int) -> Values:
    """The totals of columns over the first group, for each regrouping.

    In large groups (``has_limit``) totals are drawn from the normal distribution that they tend to (Hajek,
    1960), with their own means and covariances: no p differs by more than the drawing of regroupings lets it.

    Args:
        columns: (participants, columns).
        n: participants in the first group.

    Returns:
        (regroupings, columns).
    """
    total = len(columns)
    if not has_limit(n, total - n, total):
        return np.concatenate([chosen @ columns for chosen in draw_regroupings(n, total - n)])
    mean = columns.mean(axis=0)
    centred = columns - mean
    covariance = centred.T @ centred * (n * (total - n) / (total * (total - 1)))
    return np.random.default_rng(SEED).multivariate_normal(
        n * mean, covariance, RESAMPLES, check_valid="ignore", method="eigh"
    )


def has_limit(n: int, m: int, values: int) -> bool:
    """Whether groups of these sizes, with so many values that tell something, are tested by their limit."""
    return values > LARGEST_REGROUPED and min(n, m) >= LEAST_LARGE


def count_regroupings(n: int, m: int) -> float:
    """How many ways there are to form groups of these sizes; infinity where there are too many to go through."""
    if min(n, m) <= 3 or n + m <= _ALWAYS_DRAWN:
        return math.comb(n + m, n)
    return math.inf


def draw_regroupings(n: int, m: int) -> Iterable[Values]:
    """Batches of (regroupings, n + m): 1 for those in the first group; every one, or RESAMPLES drawn ones."""
    if n + m <= _KEPT_SIZE:
        return _kept_regroupings(n, m)
    return _make_regroupings(n, m)


@lru_cache(maxsize=8)
def _kept_regroupings(n: int, m: int) -> tuple[Values, ...]:
    return tuple(_make_regroupings(n, m))


def _make_regroupings(n: int, m: int) -> Iterator[Values]:
    total = n + m
    at_once = max(1, _AT_ONCE // (n + m))
    if count_regroupings(n, m) <= RESAMPLES:
        yield _membership(np.array(list(combinations(range(total), n))), total)
        return
    rng = np.random.default_rng(SEED)
    for begin in range(0, RESAMPLES, at_once):
        in_order = np.tile(np.arange(total, dtype=np.int32), (min(at_once, RESAMPLES - begin), 1))
        yield _membership(rng.permuted(in_order, axis=1, out=in_order)[:, :n], total)


def _membership(first: NDArray[np.int_], total: int) -> Values:
    members = np.zeros((len(first), total))
    np.put_along_axis(members, first, 1.0, axis=1)
    return members


def floor_freedom(n: tuple[int, int], freedom: float) -> float:
    """The degrees of freedom of the t below which a permutation test's p may not fall; 0 where there is none.

    Args:
        n: participants per group.
        freedom: Welch's.
    """
    small = min(n)
    if small < 4:
        return small - 1
    return freedom if small < _SMALL and n[0] != n[1] else 0


def smallest_p(n: tuple[int, int]) -> float:
    """The smallest p that the permutation test can come to with groups of these sizes."""
    regroupings = count_regroupings(*n)
    if regroupings > RESAMPLES:
        return 1 / (RESAMPLES + 1)
    return (2 if n[0] == n[1] else 1) / regroupings


def standardise(a: Values, b: Values, interval: tuple[float, float]) -> tuple[float, tuple[float, float]]:
    """The difference of means over the average SD, g (Bonett, 2008; Hedges' correction), and its 95 % interval.

    The standardiser assumes no equal variances. The interval recovers both errors, of the difference from its
    ``interval`` and of the SD from chi square with Satterthwaite's degrees of freedom (Zou and Donner, 2008), and has
    0 inside where that of the difference has.
    """
    variances = np.array([a.var(ddof=1), b.var(ddof=1)])
    freedom = float(variances.sum() ** 2 / (variances**2 / (len(a) - 1, len(b) - 1)).sum())
    inverse = (1 - 3 / (4 * freedom - 1)) / math.sqrt(float(variances.mean()))
    least, most = inverse * np.sqrt(scipy.special.chdtri(freedom, (0.975, 0.025)) / freedom)
    difference = float(a.mean() - b.mean())
    sign = 1 if difference >= 0 else -1
    near, far = sorted((sign * interval[0], sign * interval[1]))
    middle = abs(difference) * inverse
    low = near * inverse
    if near > 0:
        product = near * (2 * abs(difference) - near) * least * (2 * inverse - least)
        low = middle - math.sqrt(max(middle**2 - product, 0.0))
    high = middle + math.hypot((far - abs(difference)) * inverse, abs(difference) * (most - inverse))
    bounds = sorted((sign * low, sign * high))
    return difference * inverse, (bounds[0], bounds[1])


def correct_comparisons(comparisons: Sequence[GroupComparison]) -> tuple[GroupComparison, ...]:
    """The same with p corrected for how many there are; those that have none count as none."""
    return tuple(
        replace(comparison, p_holm=p)
        for comparison, p in zip(
            comparisons, holm_correction([comparison.p for comparison in comparisons]), strict=True
        )
    )


def holm_correction(ps: Sequence[float]) -> list[float]:
    """p values corrected for how many there are (Holm, 1979); NaN stays NaN and counts as none."""
    corrected = [math.nan] * len(ps)
    known = sorted((p, place) for place, p in enumerate(ps) if not math.isnan(p))
    largest = 0.0
    for rank, (p, place) in enumerate(known):
        largest = max(largest, min(1.0, p * (len(known) - rank)))
        corrected[place] = largest
    return corrected


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
        raise ValueError(
            f"the lower equivalence bound must be below 0 and the upper one above 0, not {low:g} and {high:g}"
        )
    if min(len(a), len(b)) < 2 or max(np.ptp(a), np.ptp(b)) == 0:
        return None
    welch = compare_means(a, b)
    above = scipy.special.stdtr(welch.freedom, -(welch.difference - low) / welch.error)
    below = scipy.special.stdtr(welch.freedom, (welch.difference - high) / welch.error)
    return Equivalence(bounds, welch.difference, welch.interval(0.9), float(max(above, below)))


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
    low = 0.0
    high = _LARGEST_G
    while high - low > _NEAR_ENOUGH:
        middle = (low + high) / 2
        low, high = (middle, high) if t_test_power(middle, n) < chance else (low, middle)
    return (low + high) / 2


def t_test_power(d: float, n: tuple[int, int], *, level: float = LEVEL) -> float:
    """The chance that a two-sided t test finds a difference of ``d`` standard deviations (Cohen, 1988)."""
    freedom = sum(n) - 2
    shift = d * math.sqrt(n[0] * n[1] / sum(n))
    critical = float(scipy.special.stdtrit(freedom, (1 + level) / 2))
    above = 1.0 - float(scipy.special.nctdtr(freedom, shift, critical))
    # the other tail is nothing by then, and SciPy's is NaN
    if shift < _ONE_SIDED:
        below = float(scipy.special.nctdtr(freedom, shift, -critical))
    else:
        below = 0.0
    return above + below


def find_units(teams: pd.DataFrame) -> dict[str, str]:
    """The unit of each participant who ever played with another person: all whom a chain of teams connects.

    Args:
        teams: rows of the table "teams" of one block, with participant and team.

    Returns:
        By participant, the unit's name: the id of one of its teams. Participants whose partners were agents are
        units of their own, and left out.
    """
    unit: dict[str, str] = {}
    for team, rows in teams.groupby("team", sort=True):
        members = sorted(set(rows["participant"]))
        if len(members) < 2:
            continue
        joined = {unit[member] for member in members if member in unit}
        unit |= {member: str(team) for member, own_unit in tuple(unit.items()) if own_unit in joined}
        unit |= dict.fromkeys(members, str(team))
    return unit


def name_units(rows: pd.DataFrame, units: Mapping[str, str]) -> pd.DataFrame:
    """Rows with their unit in the place of the participant, so that whatever clusters by participant does by team."""
    return rows.assign(participant=rows["participant"].map(lambda code: units.get(str(code), str(code))))
