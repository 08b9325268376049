"""Welch's t test of two groups, and the power of a t test."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from minihuman.moved import forward_names

LEVEL = 0.95
Values = NDArray[np.float64]
_LARGE_G = 0.8  # Cohen's large difference, in standard deviations
_LIKELY = 0.8  # the customary power
_ONE_SIDED = 5.0  # standard errors
_LARGEST_G = 30.0  # the largest difference searched for
_LARGEST_SIZE = 1000  # participants per group; far fewer have the customary power for a large difference
_NEAR_ENOUGH = 1e-9  # standard deviations


@dataclass(frozen=True, slots=True)
class Welch:
    """A difference of two means with Welch's (1947) standard error and degrees of freedom."""

    difference: float
    error: float
    freedom: float

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """Return the t interval of the difference at a confidence level, such as 0.95."""
        half = float(scipy.special.stdtrit(self.freedom, (1 + level) / 2)) * self.error
        return self.difference - half, self.difference + half

    @property
    def p(self) -> float:
        """Return the two-sided p of the null hypothesis that the difference is 0."""
        return float(2 * scipy.special.stdtr(self.freedom, -abs(self.difference) / self.error))


def compare_means(a: Values, b: Values) -> Welch:
    """Compare the means of two groups of at least two values each, of which at least one group varies."""
    parts = (a.var(ddof=1) / len(a), b.var(ddof=1) / len(b))
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(a) - 1) + parts[1] ** 2 / (len(b) - 1))
    return Welch(float(a.mean() - b.mean()), math.sqrt(sum(parts)), float(freedom))


def split_skewness(a: Values, b: Values) -> tuple[float, float]:
    """Return each group's part of the skewness of the difference of two means.

    The parts add up to that skewness, with which the error of a t test's level grows (Johnson, 1978). Each group must
    have at least three values. Both parts are 0 if nothing varies.
    """
    variance = float(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    if not variance > 0:
        return 0.0, 0.0
    first, second = (_estimate_third_moment(group) / len(group) ** 2 / variance**1.5 for group in (a, b))
    return first, -second


def _estimate_third_moment(values: Values) -> float:
    """Return the unbiased estimate of the third central moment."""
    n = len(values)
    return float(((values - values.mean()) ** 3).sum()) * n / ((n - 1) * (n - 2))


@dataclass(frozen=True, slots=True)
class PowerAnalysis:
    """The power of a two-sided t test at 5 % with two groups of given sizes."""

    n: tuple[int, int]
    power_for_large: float  # chance to find a difference of 0.8 standard deviations
    detectable_g: float  # the difference found with a chance of 80 %, in standard deviations
    needed_for_large: int  # participants per group for a chance of 80 % at 0.8 standard deviations


def compute_power(n: tuple[int, int]) -> PowerAnalysis:
    """Compute the power of a comparison of two groups with ``n`` participants each.

    The power and the detectable difference are NaN if a group has fewer than two participants.
    """
    needed = next(size for size in range(2, _LARGEST_SIZE) if t_test_power(_LARGE_G, (size, size)) >= _LIKELY)
    if min(n) < 2:
        return PowerAnalysis(n, math.nan, math.nan, needed)
    return PowerAnalysis(n, t_test_power(_LARGE_G, n), _find_detectable_difference(_LIKELY, n), needed)


def _find_detectable_difference(chance: float, n: tuple[int, int]) -> float:
    """Return the difference, in standard deviations, that a t test detects with a given probability, by bisection."""
    low = 0.0
    high = _LARGEST_G
    while high - low > _NEAR_ENOUGH:
        middle = (low + high) / 2
        if t_test_power(middle, n) < chance:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def t_test_power(d: float, n: tuple[int, int], *, level: float = LEVEL) -> float:
    """Return the power of a two-sided t test for a difference of ``d`` standard deviations (Cohen, 1988).

    ``n`` holds the number of participants in each group; the test rejects at a p below 1 - ``level``.
    """
    freedom = sum(n) - 2
    shift = d * math.sqrt(n[0] * n[1] / sum(n))
    critical = float(scipy.special.stdtrit(freedom, (1 + level) / 2))
    above = 1.0 - float(scipy.special.nctdtr(freedom, shift, critical))
    # The other tail is negligible for a large shift, for which SciPy returns NaN.
    if shift < _ONE_SIDED:
        below = float(scipy.special.nctdtr(freedom, shift, -critical))
    else:
        below = 0.0
    return above + below


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
