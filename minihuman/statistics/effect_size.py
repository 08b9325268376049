"""The effect size of tests with several degrees of freedom: the share of variance that an effect explains.

Effect sizes of differences of two groups are in ``comparison``.
"""

import math
from dataclasses import dataclass

import scipy

from minihuman.statistics.permutation import ALPHA
from minihuman.statistics.t_tests import Values

_LARGEST = 1e7  # noncentrality at which the search stops
_NEAR = 1e-6  # tolerance of the noncentrality
_LEAST_FREEDOM = 2.0  # residual degrees of freedom, below which F has no mean


@dataclass(frozen=True, slots=True)
class ExplainedVariance:
    """The effect's share of the variance that remains without the other effects (partial omega squared).

    It is estimated from the noncentrality of F (Steiger, 2004). The interval is of 90 %, as a test with several degrees
    of freedom has one side: it begins above 0 exactly where p is below 0.05.
    """

    estimate: float
    interval: tuple[float, float]


NO_EFFECT_SIZE = ExplainedVariance(math.nan, (math.nan, math.nan))


def find_critical_statistic(permuted: Values) -> float:
    """Return the statistic that must be exceeded for p < 0.05; infinity if there are too few permutations for that.

    ``permuted`` are the statistics of the permutations, without the observed one.
    """
    rank = math.ceil(ALPHA * (len(permuted) + 1)) - 2  # from 0; the observed statistic counts among those as large
    if rank < 0:
        return math.inf
    return float(sorted(permuted, reverse=True)[rank])


def estimate_explained_variance(
    statistic: float, critical: float, freedom: tuple[float, float], n: int
) -> ExplainedVariance:
    """Estimate the share of variance from a statistic that is proportional to F under its null hypothesis.

    Args:
        statistic: the observed statistic
        critical: the statistic at which p is 0.05, which need not be that of F
        freedom: the degrees of freedom of the effect and the residual ones
        n: the number of participants, or of values where the effect lies within participants

    Returns:
        The estimate and its interval; NaN if p cannot reach 0.05 or there are too few residual degrees of freedom.
    """
    effect, residual = freedom
    if not 0 < critical < math.inf or residual <= _LEAST_FREEDOM:
        return NO_EFFECT_SIZE
    f = statistic / critical * float(scipy.special.fdtri(effect, residual, 1 - ALPHA))
    noncentrality = max(0.0, f * effect * (residual - 2) / residual - effect)
    low, high = (_find_noncentrality(f, freedom, probability) for probability in (1 - ALPHA, ALPHA))
    estimate, lower_bound, upper_bound = (ratio / (ratio + n) for ratio in (noncentrality, low, high))
    return ExplainedVariance(estimate, (lower_bound, upper_bound))


def _find_noncentrality(f: float, freedom: tuple[float, float], probability: float) -> float:
    """Return the noncentrality at which F is below ``f`` with the given probability.

    It is 0 if even the central F is below ``f`` with a smaller probability, and at most ``_LARGEST``. ``freedom`` holds
    the degrees of freedom of the effect and the residual ones.
    """

    def surplus(noncentrality: float) -> float:
        return float(scipy.special.ncfdtr(*freedom, noncentrality, f)) - probability

    if not surplus(0.0) > 0:
        return 0.0
    high = max(f * freedom[0], 1.0)
    while surplus(high) > 0 and high < _LARGEST:
        high *= 2
    if high >= _LARGEST:
        return _LARGEST
    return float(scipy.optimize.brentq(surplus, 0.0, high, xtol=_NEAR))
