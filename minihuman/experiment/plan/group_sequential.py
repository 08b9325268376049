"""Group-sequential tests of two groups: boundaries by alpha spending, and p values adjusted for the looks.

Tests are two-sided and symmetric. Information is counted in participants; the increments between looks are normal and
independent.
"""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

_BOUNDARY_BRACKET = (0.5, 12.0)  # interval of |z| in which each look's boundary is searched
_N_GRID_POINTS = 801  # of the grid on which the score's density is evaluated


def spend_alpha(fraction: float, alpha: float) -> float:
    """Return the part of the two-sided ``alpha`` that is spent up to a fraction of the information.

    The fraction is above 0 and at most 1.

    The spending function is of the O'Brien-Fleming type (Lan & DeMets, 1983).
    """
    return float(4 * scipy.special.ndtr(scipy.special.ndtri(alpha / 4) / np.sqrt(fraction)))


def find_boundaries(fractions: Sequence[float], alpha: float = 0.05) -> tuple[float, ...]:
    """Return the boundary of each look: the |z| from which on the study stops there.

    Args:
        fractions: the fraction of the information at each look, increasing to 1.
        alpha: the two-sided error rate of the whole study.
    """
    spent = [0.0, *(spend_alpha(fraction, alpha) for fraction in fractions)]
    density = _ScoreDensity()
    boundaries: list[float] = []
    for look, fraction in enumerate(fractions):
        alpha_of_look = spent[look + 1] - spent[look]
        boundary = _find_boundary(density, fraction, alpha_of_look)
        boundaries.append(boundary)
        density.advance(boundary, fraction)
    return tuple(boundaries)


def _find_boundary(density: "_ScoreDensity", fraction: float, alpha_of_look: float) -> float:
    """Return the |z| at which the probability of stopping at a look, and not before, is ``alpha_of_look``."""

    def excess_alpha(z: float) -> float:
        return density.compute_exit_probability(z, fraction) - alpha_of_look

    return float(scipy.optimize.brentq(excess_alpha, *_BOUNDARY_BRACKET))


def compute_adjusted_p(z: float, fractions: Sequence[float], boundaries: Sequence[float]) -> float:
    """Compute the two-sided p value of a study that stopped at the last of its looks.

    By stagewise ordering (Tsiatis, Rosner & Mehta, 1984, Biometrics 40), p is the probability of stopping earlier, or
    of a z at least as extreme at this look.

    Args:
        z: the z at the last look that was taken.
        fractions: the fraction of the information at each look up to that one.
        boundaries: the boundary of each look; those of the last look and later ones are not used.
    """
    density = _ScoreDensity()
    p_earlier = 0.0
    *earlier_fractions, fraction = fractions
    for earlier_boundary, earlier_fraction in zip(boundaries, earlier_fractions, strict=False):
        p_earlier += density.compute_exit_probability(earlier_boundary, earlier_fraction)
        density.advance(earlier_boundary, earlier_fraction)
    return min(1.0, p_earlier + density.compute_exit_probability(abs(z), fraction))


class _ScoreDensity:
    """The density of the score at a look, among studies that have not stopped at it or before.

    The score is z times the square root of the fraction of the information; before the first look it is 0.
    """

    def __init__(self) -> None:
        self._scores: NDArray[np.float64] = np.zeros(1)
        self._weights: NDArray[np.float64] = np.ones(1)  # density times the grid's step
        self._fraction = 0.0  # of the information at the look

    def compute_exit_probability(self, z: float, fraction: float) -> float:
        """Compute the probability of a z at least as extreme at a later look, without having stopped before it.

        Args:
            z: the size of z, 0 or more.
            fraction: the fraction of the information at the later look.
        """
        spread = np.sqrt(fraction - self._fraction)
        bound = z * np.sqrt(fraction)
        upper = scipy.special.ndtr((self._scores - bound) / spread)
        return float(self._weights @ (upper + scipy.special.ndtr((-self._scores - bound) / spread)))

    def advance(self, boundary: float, fraction: float) -> None:
        """Advance the density to a look at a fraction of the information, and drop the studies beyond its boundary."""
        spread = np.sqrt(fraction - self._fraction)
        bound = boundary * np.sqrt(fraction)
        scores = np.linspace(-bound, bound, _N_GRID_POINTS)
        density = np.exp(-(((scores[:, None] - self._scores) / spread) ** 2) / 2) @ self._weights
        weights = density * (scores[1] - scores[0]) / (spread * np.sqrt(2 * np.pi))
        weights[[0, -1]] /= 2  # the ends of the trapezoidal rule
        self._scores = scores
        self._weights = weights
        self._fraction = fraction


def compute_welch_z(first: Sequence[float], second: Sequence[float]) -> float:
    """Return the z that has the same two-sided p as Welch's t of two groups, given as (n, mean, variance).

    It has the sign of the first mean minus the second. It is 0 if a group has fewer than two participants, or if both
    variances are 0.
    """
    n_first, mean_first, variance_first = first
    n_second, mean_second, variance_second = second
    if min(n_first, n_second) < 2 or variance_first + variance_second <= 0:
        return 0.0
    squared_error_first = variance_first / n_first
    squared_error_second = variance_second / n_second
    squared_error = squared_error_first + squared_error_second
    t = (mean_first - mean_second) / np.sqrt(squared_error)
    freedom = squared_error**2 / (squared_error_first**2 / (n_first - 1) + squared_error_second**2 / (n_second - 1))
    one_sided_p = scipy.stats.t.sf(abs(t), freedom)
    return float(-np.sign(t) * scipy.special.ndtri(one_sided_p))
