"""The regroupings of a permutation test: all of them, a random sample, or the limiting distribution of their totals."""

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from minihuman.statistics.t_tests import Values

RESAMPLES = 9_999
_AT_ONCE = 200_000  # values permuted at a time
LARGEST_REGROUPED = 5_000  # values; of more, in large groups, the limit of the regroupings is drawn instead of them
LEAST_LARGE = 500  # participants in the smaller group, from whom on that limit holds for skewed values, too
_DRAWN_GROUP = 4  # participants per group, from whom on ``_ALWAYS_DRAWN`` holds
_ALWAYS_DRAWN = 30  # with more participants, groups of four or more have more regroupings than RESAMPLES
_CACHED_SIZE = 200  # participants, up to whom regroupings are cached for the next measure: 16 MB
SEED = 20_230_613  # of the permutations, so that the same data give the same p


def draw_totals(columns: Values, n: int) -> Values:
    """Return the totals of columns over the first group, for each regrouping.

    In large groups (see ``has_limit``), totals are drawn from the normal distribution to which they converge (Hajek,
    1960), with the same means and covariances. No p value differs by more than the random error of drawing regroupings.

    Args:
        columns: values of shape (participants, columns)
        n: the number of participants in the first group

    Returns:
        Totals of shape (regroupings, columns).
    """
    total = len(columns)
    if not has_limit(n, total - n, total):
        return np.concatenate([members @ columns for members in draw_regroupings(n, total - n)])
    mean = columns.mean(axis=0)
    centred = columns - mean
    covariance = centred.T @ centred * (n * (total - n) / (total * (total - 1)))
    return np.random.default_rng(SEED).multivariate_normal(
        n * mean, covariance, RESAMPLES, check_valid="ignore", method="eigh"
    )


def has_limit(n: int, m: int, values: int) -> bool:
    """Return whether a test uses the limiting distribution of the regroupings instead of the regroupings.

    Args:
        n: the number of participants in the first group
        m: the number of participants in the second group
        values: the number of informative values
    """
    return values > LARGEST_REGROUPED and min(n, m) >= LEAST_LARGE


def count_regroupings(n: int, m: int) -> float:
    """Return the number of ways to form groups of these sizes; infinity if it is certainly more than RESAMPLES."""
    if min(n, m) < _DRAWN_GROUP or n + m <= _ALWAYS_DRAWN:
        return math.comb(n + m, n)
    return math.inf


def draw_regroupings(n: int, m: int) -> Iterable[Values]:
    """Return batches of regroupings: all of them, or RESAMPLES random ones.

    Each batch has the shape (regroupings, n + m); a 1 marks a member of the first group.
    """
    if n + m <= _CACHED_SIZE:
        return _cache_regroupings(n, m, RESAMPLES)
    return _make_regroupings(n, m, RESAMPLES)


@lru_cache(maxsize=8)
def _cache_regroupings(n: int, m: int, resamples: int) -> tuple[Values, ...]:
    """Return all batches of ``_make_regroupings``, cached."""
    return tuple(_make_regroupings(n, m, resamples))


def _make_regroupings(n: int, m: int, resamples: int) -> Iterator[Values]:
    """Yield batches of all regroupings if there are at most ``resamples``, else of that many random ones."""
    total = n + m
    at_once = max(1, _AT_ONCE // (n + m))
    if count_regroupings(n, m) <= resamples:
        yield _mark_members(np.array(list(combinations(range(total), n))), total)
        return
    rng = np.random.default_rng(SEED)
    for begin in range(0, resamples, at_once):
        in_order = np.tile(np.arange(total, dtype=np.int32), (min(at_once, resamples - begin), 1))
        yield _mark_members(rng.permuted(in_order, axis=1, out=in_order)[:, :n], total)


def _mark_members(first: NDArray[np.int_], total: int) -> Values:
    """Return an array of shape (regroupings, total) with a 1 for each participant in the first group.

    ``first`` has the indices of these participants, of shape (regroupings, participants).
    """
    members = np.zeros((len(first), total))
    np.put_along_axis(members, first, 1.0, axis=1)
    return members
