"""Draws from a random stream, in arithmetic that is the same on every machine.

NumPy's own ``Generator.uniform`` may fuse the multiply and the add where the processor can; these never do.
"""

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np


def uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """One number in [low, high)."""
    return low + (high - low) * rng.random()


def weighted(rng: np.random.Generator, cumulative: Sequence[float]) -> int:
    """An index, drawn by weights given as their running sum; the last is 1."""
    return bisect_right(cumulative, rng.random())


def running_sum(weights: Sequence[float]) -> tuple[float, ...]:
    """The running sum of weights, scaled to end at 1, rounded as ``Generator.choice`` rounds it."""
    shares = np.array(weights, dtype=float)
    sums = np.cumsum(shares / np.sum(shares))
    return tuple((sums / sums[-1]).tolist())
