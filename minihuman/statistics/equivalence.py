"""Tests of equivalence: whether the difference of two groups' means lies within a margin."""

import math
from dataclasses import dataclass

from minihuman.statistics.permutation import ALPHA, LEAST_ESTIMATED, PermutationTest, invert_test, permutation_tests
from minihuman.statistics.t_tests import Values


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Two one-sided tests (Schuirmann, 1987) of whether a difference lies within bounds, by permutation.

    The interval and p are NaN, with a reason, where the tests cannot be made.
    """

    bounds: tuple[float, float]
    difference: float  # first minus second
    interval: tuple[float, float]  # of 90 %: it lies within the bounds where p is below 0.05
    p: float  # the larger of the two
    reason: str = ""

    @property
    def alike(self) -> bool:
        """Return whether the tests show that the difference lies within the bounds."""
        return self.p < ALPHA


def check_equivalence(a: Values, b: Values, bounds: tuple[float, float]) -> Equivalence:
    """Test whether the difference of two groups' means lies within bounds.

    Each one-sided p is half of the two-sided p of the permuted Welch test, with that test's lower limits and its least
    group sizes. By Welch's t alone, groups of 2 and 18 whose difference is at the margin are called equivalent in 9 %
    of studies.

    Args:
        a: the values of the first group, one per participant
        b: the values of the second group
        bounds: the smallest and the largest difference, first minus second, that count as equivalent

    Raises:
        ValueError: if the lower bound is not below 0 or the upper bound is not above 0.
    """
    low, high = bounds
    if not low < 0 < high:
        raise ValueError(
            f"the lower equivalence bound must be below 0 and the upper one above 0, not {low:g} and {high:g}"
        )
    (test,) = permutation_tests([(a, b)])
    if test is None or not test.has_interval:
        difference = float(a.mean() - b.mean()) if len(a) and len(b) else math.nan
        reason = f"it needs {LEAST_ESTIMATED} participants in each group and values that differ"
        return Equivalence(bounds, difference, (math.nan, math.nan), math.nan, reason)
    interval = invert_test(test.p, test.difference, test.error, alpha=2 * ALPHA)
    p = max(_one_sided_p(test, low, sign=1), _one_sided_p(test, high, sign=-1))
    return Equivalence(bounds, test.difference, interval, p)


def _one_sided_p(test: PermutationTest, bound: float, *, sign: int) -> float:
    """Return the p of the null hypothesis that the difference lies beyond a bound.

    Args:
        test: the test of the two groups
        bound: the bound
        sign: 1 if the difference is expected above the bound, -1 below
    """
    half_p = test.p(bound) / 2
    if sign * (test.difference - bound) > 0:
        return half_p
    return 1 - half_p
