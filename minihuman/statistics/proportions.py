"""Proportions: the Wilson score interval of a success rate. Kept apart because it needs neither scipy nor pandas."""

import math


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """The 95 % score interval (Wilson, 1927) of a success rate; (0, 1) where nothing was tried."""
    if trials == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate = successes / trials
    middle = rate + z * z / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)
