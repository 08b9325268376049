"""Two groups alike: not a difference that was not found, but one that is shown to be small."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from minihuman.statistics.compare import Values, welch


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Two one-sided tests (Schuirmann, 1987) of whether a difference lies within bounds, with Welch's t."""

    bounds: tuple[float, float]
    difference: float  # first minus second
    interval: tuple[float, float]  # of 90 %: it lies within the bounds where p is below 0.05
    p: float  # the larger of the two

    @property
    def alike(self) -> bool:
        """Whether the two are shown to be as near as the bounds say."""
        return self.p < 0.05


def equivalence(a: Values, b: Values, bounds: tuple[float, float]) -> Equivalence | None:
    """Whether the means of two groups differ by something within the bounds; None where nothing varies or too few tell.

    Raises:
        ValueError: if the bounds do not lie around 0.
    """
    low, high = bounds
    if not low < 0 < high:
        raise ValueError(f"bounds are {low:g} and {high:g}; they lie around 0")
    if min(len(a), len(b)) < 2 or max(np.ptp(a), np.ptp(b)) == 0:
        return None
    found = welch(a, b)
    above = special.stdtr(found.freedom, -(found.difference - low) / found.error)
    below = special.stdtr(found.freedom, (found.difference - high) / found.error)
    return Equivalence(bounds, found.difference, found.interval(0.9), float(max(above, below)))
