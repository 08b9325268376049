"""The interaction of groups and conditions: a test of whether groups have equal contrast scores between conditions.

With two groups and one contrast, the interaction is the permuted Welch test of ``comparison``. This module has the test
with several degrees of freedom.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from minihuman.statistics.effect_size import (
    NO_EFFECT_SIZE,
    ExplainedVariance,
    estimate_explained_variance,
    find_critical_statistic,
)
from minihuman.statistics.permutation import ALPHA
from minihuman.statistics.regroupings import RESAMPLES, SEED
from minihuman.statistics.t_tests import Values

_AT_ONCE = 400_000  # scores permuted at a time
_SINGULAR = 1e-10  # an eigenvalue below this share of the largest one of all scores counts as 0
_TIES = 1e-9
LEAST_TESTED = 8  # per group: with 5 and 25 participants and SDs of 3 and 1, a true null is rejected in 7 % of studies


@dataclass(frozen=True, slots=True)
class InteractionTest:
    """The permuted Wald-type test of whether all groups have the same mean contrast scores.

    The statistic and p are NaN where the test could not be made.
    """

    n: tuple[int, ...]  # participants per group
    freedom: int
    statistic: float
    p: float
    reason: str = ""  # why there is no p
    effect: ExplainedVariance = NO_EFFECT_SIZE  # of the contrast scores' variance


def compare_contrast_scores(scores: Sequence[Values]) -> InteractionTest:
    """Test whether groups have the same mean vector of contrast scores.

    Participants are permuted between groups, and the statistic is studentised by each group's own covariance (Chung and
    Romano, 2016; Friedrich, Brunner and Pauly, 2017). For two groups, p is at least that of the F approximation of
    Krishnamoorthy and Yu (2004); for more groups, at least that of a parametric bootstrap (Krishnamoorthy and Lu,
    2010). Permutation alone rejects a true null hypothesis in 9 % of studies with 8 participants in each of two groups
    and SDs of 3 and 1.

    Args:
        scores: per group, an array of shape (participants, contrasts) with linearly independent contrasts
    """
    n = tuple(len(group) for group in scores)
    contrasts = scores[0].shape[1]
    freedom = (len(scores) - 1) * contrasts
    least = max(LEAST_TESTED, contrasts + 2)
    if min(n) < least:
        reason = f"{min(n)} in the smallest group: {contrasts + 1} conditions need {least} per group"
        return InteractionTest(n, freedom, math.nan, math.nan, reason)
    pooled = np.concatenate(list(scores))
    scale = _measure_scale(pooled)
    if scale == 0:
        return InteractionTest(n, freedom, math.nan, math.nan, "no participant differs from the others")
    observed = float(_compute_wald(pooled[None], n, scale)[0])
    if not math.isfinite(observed):
        reason = "a group's differences between conditions do not vary, or determine each other"
        return InteractionTest(n, freedom, math.nan, math.nan, reason)
    permuted = np.concatenate(
        [_compute_wald(pooled[order], n, scale) for order in _draw_orders(len(pooled), contrasts)]
    )
    reference, residual_freedom = _find_lower_limit(scores, observed, scale)
    at_least = int(np.count_nonzero(permuted >= observed * (1 - _TIES)))
    effect = estimate_explained_variance(
        observed,
        max(find_critical_statistic(permuted), reference.critical),
        (freedom, residual_freedom),
        len(pooled),
    )
    p = max((at_least + 1) / (RESAMPLES + 1), reference.p)
    return InteractionTest(n, freedom, observed, p, effect=effect)


@dataclass(frozen=True, slots=True)
class _LowerLimit:
    """A lower limit of p, and the statistic at which it is 0.05."""

    p: float
    critical: float


def _find_lower_limit(scores: Sequence[Values], observed: float, scale: float) -> tuple[_LowerLimit, float]:
    """Return the lower limit of p, and the residual degrees of freedom of the F that approximates the statistic.

    Args:
        scores: per group, the contrast scores, of shape (participants, contrasts)
        observed: the observed statistic
        scale: the largest variance of all scores, as ``_measure_scale`` returns it
    """
    if len(scores) == 2:
        return _approximate_p(scores, observed)
    return _bootstrap_p(scores, observed, scale), _approximate_freedom(scores)


def _measure_scale(pooled: Values) -> float:
    """Return the largest variance that a direction of the space of contrasts has; 0 if only rounding errors vary.

    ``pooled`` holds the contrast scores of all groups, of shape (participants, contrasts).
    """
    largest = float(np.linalg.eigvalsh(np.atleast_2d(np.cov(pooled, rowvar=False)))[-1])
    if largest > _SINGULAR**2 * float((pooled**2).max()):
        return largest
    return 0.0


def _split_resamples(scores: int) -> Iterator[int]:
    """Yield the sizes of batches that add up to RESAMPLES and whose scores fit into memory.

    Args:
        scores: the number of scores in one resample
    """
    at_once = max(1, _AT_ONCE // scores)
    for begin in range(0, RESAMPLES, at_once):
        yield min(at_once, RESAMPLES - begin)


def _draw_orders(people: int, contrasts: int) -> Iterator[NDArray[np.int64]]:
    """Yield batches of random permutations of shape (permutations, people), RESAMPLES permutations in all."""
    rng = np.random.default_rng(SEED)
    for count in _split_resamples(people * contrasts):
        yield rng.permuted(np.tile(np.arange(people), (count, 1)), axis=1)


def _compute_wald(scores: Values, n: Sequence[int], scale: float) -> Values:
    """Compute the Wald-type statistic of each permutation; infinity where a group's covariance is singular.

    Args:
        scores: an array of shape (permutations, people, contrasts), with the people of each group next to each other
        n: the number of people in each group
        scale: the largest variance of all scores; a covariance that is far smaller counts as singular
    """
    means = []
    weights = []
    is_singular = np.zeros(len(scores), bool)
    for group in np.split(scores, np.cumsum(n)[:-1], axis=1):
        people = group.shape[1]
        mean = group.mean(axis=1)
        centred = group - mean[:, None, :]
        covariance = centred.swapaxes(1, 2) @ centred / (people * (people - 1))
        is_group_singular = np.linalg.eigvalsh(covariance)[:, 0] * people <= _SINGULAR * scale
        covariance[is_group_singular] = np.eye(covariance.shape[1])  # any that can be inverted
        is_singular |= is_group_singular
        means.append(mean)
        weights.append(np.linalg.inv(covariance))
    common = np.linalg.solve(
        sum(weights), sum(weight @ mean[:, :, None] for weight, mean in zip(weights, means, strict=True))
    )[:, :, 0]
    wald = np.zeros(len(scores))
    for mean, weight in zip(means, weights, strict=True):
        deviation = mean - common
        wald += np.einsum("bi,bij,bj->b", deviation, weight, deviation)
    return np.where(is_singular, np.inf, wald)


def _approximate_p(scores: Sequence[Values], observed: float) -> tuple[_LowerLimit, float]:
    """Approximate the p of Hotelling's T squared for two groups with unequal covariances by F.

    The approximation is that of Krishnamoorthy and Yu (2004). Return the lower limit of p, and the residual degrees of
    freedom of F.
    """
    errors = [np.atleast_2d(np.cov(group, rowvar=False)) / len(group) for group in scores]
    inverse = np.linalg.inv(sum(errors))
    contrasts = len(inverse)
    spread = 0.0
    for group, error in zip(scores, errors, strict=True):
        share = error @ inverse
        spread += float(np.trace(share @ share) + np.trace(share) ** 2) / (len(group) - 1)
    freedom = contrasts * (contrasts + 1) / spread
    residual = freedom - contrasts + 1
    scaling = residual / (freedom * contrasts)
    critical = float(scipy.special.fdtri(contrasts, residual, 1 - ALPHA)) / scaling
    return _LowerLimit(float(scipy.special.fdtrc(contrasts, residual, observed * scaling)), critical), residual


def _approximate_freedom(scores: Sequence[Values]) -> float:
    """Return the residual degrees of freedom of the F that approximates the statistic (Johansen, 1980).

    ``scores`` holds, per group, the contrast scores of shape (participants, contrasts).
    """
    weights = [np.linalg.inv(np.atleast_2d(np.cov(group, rowvar=False)) / len(group)) for group in scores]
    total_inverse = np.linalg.inv(sum(weights))
    contrasts = len(total_inverse)
    spread = 0.0
    for group, weight in zip(scores, weights, strict=True):
        share = np.eye(contrasts) - total_inverse @ weight
        spread += float(np.trace(share @ share) + np.trace(share) ** 2) / (2 * (len(group) - 1))
    effect = contrasts * (len(scores) - 1)
    return effect * (effect + 2) / (3 * spread)


def _bootstrap_p(scores: Sequence[Values], observed: float, scale: float) -> _LowerLimit:
    """Return the lower limit of p from a parametric bootstrap.

    The p is the share of samples with a statistic of at least ``observed``, drawn from normal distributions with the
    groups' covariances and equal means.
    """
    n = [len(group) for group in scores]
    factors = [np.linalg.cholesky(np.atleast_2d(np.cov(group, rowvar=False))) for group in scores]
    rng = np.random.default_rng(SEED)
    batches = []
    for count in _split_resamples(sum(map(len, scores)) * scores[0].shape[1]):
        samples = [
            rng.standard_normal((count, people, len(factor))) @ factor.T
            for people, factor in zip(n, factors, strict=True)
        ]
        batches.append(_compute_wald(np.concatenate(samples, axis=1), n, scale))
    wald = np.concatenate(batches)
    p = (int(np.count_nonzero(wald >= observed)) + 1) / (RESAMPLES + 1)
    return _LowerLimit(p, find_critical_statistic(wald))
