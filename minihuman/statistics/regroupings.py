"""The regroupings of a permutation test: all of them, a random sample, or the limit that their totals tend to."""

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
_ALWAYS_DRAWN = 30  # participants; more in groups above three have more regroupings than RESAMPLES
_CACHED_SIZE = 200  # participants, up to whom regroupings are cached for the next measure: 16 MB
SEED = 20_230_613  # of the permutations, so that the same data give the same p


def draw_totals(columns: Values, n: int) -> Values:
    """Return the totals of columns over the first group, for each regrouping.

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
    """Say whether groups of these sizes, with so many informative values, are tested by their limit."""
    return values > LARGEST_REGROUPED and min(n, m) >= LEAST_LARGE


def count_regroupings(n: int, m: int) -> float:
    """Count the ways to form groups of these sizes; infinity where there are too many to enumerate."""
    if min(n, m) <= 3 or n + m <= _ALWAYS_DRAWN:
        return math.comb(n + m, n)
    return math.inf


def draw_regroupings(n: int, m: int) -> Iterable[Values]:
    """Return batches of (regroupings, n + m), 1 for members of the first group: all, or RESAMPLES drawn ones."""
    if n + m <= _CACHED_SIZE:
        return _cache_regroupings(n, m)
    return _make_regroupings(n, m)


@lru_cache(maxsize=8)
def _cache_regroupings(n: int, m: int) -> tuple[Values, ...]:
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
    """Return (regroupings, total), 1 where a participant is in the first group."""
    members = np.zeros((len(first), total))
    np.put_along_axis(members, first, 1.0, axis=1)
    return members
