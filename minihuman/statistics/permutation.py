"""Permutation tests of the difference of two groups, with or without adjustment for covariates."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from minihuman.statistics.regroupings import RESAMPLES, SEED, count_regroupings, draw_totals, has_limit
from minihuman.statistics.t_tests import Values, compare_means

ALPHA = 0.05
LEAST_ESTIMATED = 4  # per group, for an interval: with 2 and 18 participants, one would hold the truth in 99.4 %
LEAST_FREEDOM = 5  # residual degrees of freedom, below which nothing is adjusted for covariates
_SMALL = 10  # with fewer participants in the smaller of unequal groups, p is at least that of t
_TIES = 1e-9  # relative rounding error of equal squared t
_NO_SPREAD = 1e-13  # squares below this share of the squared deviations are rounding errors
_NOTHING = (math.nan, math.nan)
_LARGEST_T = 1e18  # squared
_BOUND_PRECISION = 1e-6  # of a bound of an interval, relative to the last step of its search
_NO_WELCH = 4  # in smaller groups, Welch's degrees of freedom do not protect p


@dataclass(frozen=True, slots=True, eq=False)
class PermutationTest:
    """The permutation test of |Welch's t| of two groups, for any shift between their means.

    The statistic is studentised (Janssen, 1997), so that the test compares means even where spreads and sizes differ.
    With 5 and 25 participants and SDs of 3 and 1, permutations of the plain difference reject a true null hypothesis in
    27 to 29 % of studies. The interval contains the shifts that the same regroupings do not reject at 5 %, so it never
    contradicts p.
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
    extra: int  # 1 where regroupings are a random sample, of which the observed groups count as one; else 0

    def p(self, shift: float = 0.0) -> float:
        """Return the two-sided p of the null hypothesis that the difference is ``shift``.

        Where group sizes differ and one is below ten, regroupings reject a true null hypothesis too often if the
        smaller group varies more. There, p is at least that of Welch's t. Below four participants, p is at least that
        of a t with the smaller group's degrees of freedom, which is never too small for normal values (Mickey and
        Brown, 1966).
        """
        p = self.regrouped_p(shift)
        if not self.error > 0 or smallest_p(self.n) >= ALPHA:
            return p
        freedom = floor_freedom(self.n, self.freedom)
        if not freedom:
            return p
        return max(p, float(2 * scipy.special.stdtr(freedom, -abs(self.difference - shift) / self.error)))

    def regrouped_p(self, shift: float = 0.0) -> float:
        """Return the share of regroupings with a |t| of at least the observed one, after a shift.

        ``shift`` is subtracted from the values of the first group before the groups are formed anew.
        """
        n, m = self.n
        d = self.difference - shift
        sums = self.sums + d * self.members
        squares = self.squares + d * (2 * self.own_sums + d * self.members)
        total = n * d
        total_squares = self.sum_of_squares + n * d * d
        scale = total_squares / (n + m)
        other_sums = total - sums
        squared_difference = (sums / n - other_sums / m) ** 2
        squared_error = _square_error(squares - sums**2 / n, n, scale)
        squared_error += _square_error(total_squares - squares - other_sums**2 / m, m, scale)
        is_rounding = squared_difference <= _NO_SPREAD * scale
        with np.errstate(divide="ignore", invalid="ignore"):
            squared_t = np.where(is_rounding, 0.0, np.minimum(squared_difference / squared_error, _LARGEST_T))
        observed = self._square_t(d, scale)
        n_as_far = int(np.count_nonzero(squared_t >= observed * (1 - _TIES)))
        return (n_as_far + self.extra) / (len(squared_t) + self.extra)

    def _square_t(self, difference: float, scale: float) -> float:
        """Return the squared t of the observed groups for a difference; 0 if it is only a rounding error.

        ``scale`` is the mean square of all values, at which rounding errors are measured.
        """
        if difference * difference <= _NO_SPREAD * scale:
            return 0.0
        if self.error**2 > _NO_SPREAD * scale:
            return min((difference / self.error) ** 2, _LARGEST_T)
        return _LARGEST_T

    @property
    def has_interval(self) -> bool:
        """Return whether values vary and the groups are large enough for an interval and for p < 0.05."""
        return self.error > 0 and min(self.n) >= LEAST_ESTIMATED and smallest_p(self.n) < ALPHA

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the difference; NaN if the test has no interval."""
        if self.has_interval:
            return invert_test(self.p, self.difference, self.error)
        return _NOTHING


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedTest:
    """The permutation test of the difference of two groups at equal covariates (an analysis of covariance).

    Residuals of the model without groups are permuted, and the whole model is fitted to them again (Freedman and Lane,
    1983), so that p includes the uncertainty of the slopes. The statistic is studentised by HC3 standard errors
    (DiCiccio and Romano, 2017). Where group sizes differ, p is at least that of the t, as in the test of means. The
    interval inverts the same test.
    """

    n: tuple[int, int]
    difference: float
    error: float  # HC3
    freedom: float  # Welch's, of the values at equal covariates, less a degree per covariate
    shifts: Values  # (permutations,) difference between the groups in the permuted residuals
    own_shifts: Values  # (permutations,) the same in permuted group membership, from which covariates are regressed out
    squares: Values  # (3, permutations) squared error: of a shift of 0, and its first and second power's coefficients

    def p(self, shift: float = 0.0) -> float:
        """Return the two-sided p of the null hypothesis that the adjusted difference is ``shift``."""
        observed = abs(self.difference - shift) / self.error
        d = -shift
        squared_error = self.squares[0] + 2 * d * self.squares[1] + d * d * self.squares[2]
        t = np.abs(self.shifts + d * self.own_shifts) / np.sqrt(np.maximum(squared_error, 1 / _LARGEST_T))
        regrouped = (int(np.count_nonzero(t >= observed * (1 - _TIES))) + 1) / (len(t) + 1)
        floor = floor_freedom(self.n, self.freedom)
        if floor:
            return max(regrouped, float(2 * scipy.special.stdtr(floor, -observed)))
        return regrouped

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the adjusted difference."""
        return invert_test(self.p, self.difference, self.error)


def adjust_groups(a: tuple[Values, Values], b: tuple[Values, Values]) -> tuple[Values, Values, AdjustedTest] | None:
    """Adjust two groups' values to the means of the covariates, and test their difference.

    Args:
        a: the first group's values, of shape (n,), and covariates, of shape (n, covariates)
        b: the second group's values and covariates, of the same form

    Returns:
        Both groups' adjusted values and the test. None if fewer than LEAST_FREEDOM residual degrees of freedom
        remain, a group has fewer than LEAST_ESTIMATED participants, or the covariates explain all variation.
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
    x, e = (column - basis @ (basis.T @ column) for column in (groups, values))  # covariates are regressed out of both
    scale = float(x @ x)
    if scale <= _NO_SPREAD * (n + m) or e @ e <= _NO_SPREAD * float(values @ values):
        return None
    weights = (x / scale / np.maximum(1 - (basis**2).sum(axis=1) - x**2 / scale, _TIES)) ** 2

    def fit(rows: Values) -> tuple[Values, Values]:
        rows = rows - (rows @ basis) @ basis.T
        shifts = rows @ x / scale
        return shifts, rows - shifts[:, None] * x

    (difference,), residuals = fit(e[None])
    if has_limit(n, m, n + m):
        shifts = np.random.default_rng(SEED).standard_normal(RESAMPLES)
        own_shifts = np.zeros(1)
        squares = np.array([[1.0], [0.0], [0.0]])
    else:
        order = _draw_orders(n + m)
        shifts, errors = fit(e[order])
        own_shifts, own_errors = fit(x[order])
        squares = np.stack([errors**2 @ weights, (errors * own_errors) @ weights, own_errors**2 @ weights])
    error = math.sqrt(float(residuals[0] ** 2 @ weights))
    slopes = np.linalg.lstsq(centred, values - difference * (groups - groups.mean()) - values.mean(), rcond=None)[0]
    adjusted = values - centred @ slopes
    satterthwaite = max(compare_means(adjusted[:n], adjusted[n:]).freedom - covariates.shape[1], 1.0)
    test = AdjustedTest((n, m), float(difference), error, satterthwaite, shifts, own_shifts, squares)
    return adjusted[:n], adjusted[n:], test


def _draw_orders(total: int) -> NDArray[np.int_]:
    """Return RESAMPLES random permutations of the participants, of shape (permutations, total)."""
    rng = np.random.default_rng(SEED)
    return rng.permuted(np.tile(np.arange(total), (RESAMPLES, 1)), axis=1)


def invert_test(
    p: Callable[[float], float], estimate: float, error: float, *, alpha: float = ALPHA
) -> tuple[float, float]:
    """Return the interval of values that a two-sided test does not reject at the level ``alpha``.

    Both bounds are searched for outwards from the estimate.

    Args:
        p: the function that returns the p of the null hypothesis that the parameter has a given value
        estimate: the estimate of the parameter
        error: the standard error of the estimate, the first step of the search
        alpha: the level below which p rejects
    """

    def is_rejected(value: float) -> bool:
        return p(value) < alpha

    return _search_bound(is_rejected, estimate, -error), _search_bound(is_rejected, estimate, error)


def _search_bound(is_rejected: Callable[[float], bool], estimate: float, step: float) -> float:
    """Return the last value that is not rejected, searching outwards from the estimate.

    ``step`` is the first step; its sign is the direction of the search.
    """
    inside = estimate
    outside = math.nan
    if -estimate * step > 0:  # test 0 itself, so that the interval contains 0 exactly where p does not reject it
        if is_rejected(0.0):
            outside = 0.0
        else:
            inside = 0.0
    while math.isnan(outside):
        if is_rejected(inside + step):
            outside = inside + step
        else:
            inside = inside + step
            step = 2 * step
    while abs(outside - inside) > _BOUND_PRECISION * abs(step):
        middle = (inside + outside) / 2
        if is_rejected(middle):
            outside = middle
        else:
            inside = middle
    return inside


def _square_error(squares: Values, n: int, scale: float) -> Values:
    """Return the squared standard error of the mean of ``n`` values from their sums of squared deviations.

    It is exactly 0 where values differ only by rounding errors; ``scale`` is the mean square of all values.
    """
    return np.where(squares <= _NO_SPREAD * scale * n, 0.0, squares / (n * (n - 1)))


def permutation_tests(pairs: Sequence[tuple[Values, Values]]) -> list[PermutationTest | None]:
    """Return the permutation test of each pair of groups; None where a group has fewer than two participants.

    All regroupings are used if there are at most RESAMPLES, and a random sample otherwise. Pairs of the same sizes use
    the same regroupings.
    """
    tests: list[PermutationTest | None] = [None] * len(pairs)
    sizes = [(len(a), len(b)) for a, b in pairs]
    for size in sorted({size for size in sizes if min(size) > 1}):
        indices = [index for index, pair_size in enumerate(sizes) if pair_size == size]
        same_size_tests = _test_same_size_pairs([pairs[index] for index in indices])
        for index, test in zip(indices, same_size_tests, strict=True):
            tests[index] = test
    return tests


def _test_same_size_pairs(pairs: Sequence[tuple[Values, Values]]) -> Iterator[PermutationTest]:
    """Yield the test of each pair; all pairs have the same two sizes, each at least 2, and share their regroupings."""
    n = len(pairs[0][0])
    m = len(pairs[0][1])
    deviations = np.array([np.concatenate([a - a.mean(), b - b.mean()]) for a, b in pairs])
    is_first = np.arange(n + m) < n
    # per participant: the deviations of all pairs, their squares, those of the first group, and the membership in it
    columns = np.concatenate([deviations, deviations**2, deviations * is_first, is_first[None]]).T
    totals = draw_totals(columns, n)
    count = len(pairs)
    sums = totals[:, :count]
    square_sums = totals[:, count : 2 * count]
    own_sums = totals[:, 2 * count : 3 * count]
    extra = int(count_regroupings(n, m) > RESAMPLES)
    for index, (a, b) in enumerate(pairs):
        squares = deviations[index] ** 2
        error, freedom = _measure_welch_error(squares[:n].sum(), squares[n:].sum(), n, m)
        yield PermutationTest(
            n=(n, m),
            difference=float(a.mean()) - float(b.mean()),
            error=error,
            freedom=freedom,
            sum_of_squares=float(squares.sum()),
            members=totals[:, -1],
            sums=sums[:, index],
            own_sums=own_sums[:, index],
            squares=square_sums[:, index],
            extra=extra,
        )


def _measure_welch_error(first_squares: float, second_squares: float, n: int, m: int) -> tuple[float, float]:
    """Return the standard error of a difference of means and its degrees of freedom, NaN if nothing varies.

    Args:
        first_squares: the sum of squared deviations in the first group.
        second_squares: the sum of squared deviations in the second group.
        n: the number of participants in the first group.
        m: the number of participants in the second group.
    """
    parts = np.array([first_squares / (n * (n - 1)), second_squares / (m * (m - 1))])
    error = math.sqrt(parts.sum())
    if error == 0:
        return error, math.nan
    return error, float(parts.sum() ** 2 / (parts**2 / (n - 1, m - 1)).sum())


def floor_freedom(n: tuple[int, int], freedom: float) -> float:
    """Return the degrees of freedom of the t distribution whose p is a lower limit of the permutation test's p.

    Args:
        n: the number of participants in each group
        freedom: the degrees of freedom of Welch's t

    Returns:
        The degrees of freedom; 0 if p has no lower limit.
    """
    smaller = min(n)
    if smaller < _NO_WELCH:
        return smaller - 1
    if smaller < _SMALL and n[0] != n[1]:
        return freedom
    return 0


def smallest_p(n: tuple[int, int]) -> float:
    """Return the smallest p that the permutation test can reach with groups of these sizes."""
    regroupings = count_regroupings(*n)
    if regroupings > RESAMPLES:
        return 1 / (RESAMPLES + 1)
    extremes = 2 if n[0] == n[1] else 1  # swapping groups of equal size gives the same |t|
    return extremes / regroupings
