"""Adaptation: how a measure changes over a block's first episodes."""

import math
from collections.abc import Sequence

import numpy as np

FIRST = 5  # episodes that count as the first


def slope_per_episode(values: Sequence[float], *, first: int = FIRST) -> float:
    """Least-squares slope over the first episodes, a change in the measure an episode; NaN with fewer than two.

    NaN values, of episodes that do not count, are left out.
    """
    early = np.asarray(values[:first], float)
    there = ~np.isnan(early)
    if there.sum() < 2:
        return math.nan
    return float(np.polyfit(np.flatnonzero(there), early[there], 1)[0])


def gain(values: Sequence[float], *, first: int = FIRST) -> float:
    """Mean of the episodes after the first ones minus the very first episode's value; NaN where either is missing."""
    late = np.asarray(values[first:], float)
    late = late[~np.isnan(late)]
    return float(late.mean() - values[0]) if late.size else math.nan
