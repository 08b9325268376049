"""Group-sequential tests of two groups: boundaries by alpha spending, and p values adjusted for the looks.

Tests are two-sided and symmetric. Information is counted in participants; the increments between looks are normal and
independent.
"""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

_BOUNDARY_BRACKET = (0.5, 12.0)  # interval of |z| in which each look's boundary is searched
_POINTS = 801  # of the grid on which the score's density is evaluated


def spend_alpha(fraction: float, alpha: float) -> float:
    """Return the alpha spent at a fraction of the information, of the O'Brien-Fleming type (Lan & DeMets, 1983)."""
    return float(4 * scipy.special.ndtr(scipy.special.ndtri(alpha / 4) / np.sqrt(fraction)))


def find_boundaries(fractions: Sequence[float], alpha: float = 0.05) -> tuple[float, ...]:
    """Return the |z| at which a study stops at each look.

    Args:
        fractions: the fraction of the information at each look, increasing to 1.
        alpha: the two-sided error rate of the whole study.
    """
    spent = [0.0, *(spend_alpha(fraction, alpha) for fraction in fractions)]
    walk = _Walk()
    boundaries = list[float]()
    for look, fraction in enumerate(fractions):
        alpha_of_look = spent[look + 1] - spent[look]
        boundary = _find_boundary(walk, fraction, alpha_of_look)
        boundaries.append(boundary)
        walk.advance(boundary, fraction)
    return tuple(boundaries)


def _find_boundary(walk: "_Walk", fraction: float, alpha_of_look: float) -> float:
    """Return the |z| that a look exceeds with probability ``alpha_of_look`` if the study has not stopped before."""

    def excess_alpha(z: float) -> float:
        return walk.exit_probability(z, fraction) - alpha_of_look

    return float(scipy.optimize.brentq(excess_alpha, *_BOUNDARY_BRACKET))


def compute_adjusted_p(z: float, fractions: Sequence[float], boundaries: Sequence[float]) -> float:
    """Compute the p value of a study that stopped at the last of its looks with a given z.

    By stagewise ordering (Tsiatis, Rosner & Mehta, 1984, Biometrics 40), p is the probability of stopping earlier, or
    of a z at least as extreme at this look.
    """
    walk = _Walk()
    p_earlier = 0.0
    *earlier_fractions, fraction = fractions
    for earlier_boundary, earlier_fraction in zip(boundaries, earlier_fractions, strict=False):
        p_earlier += walk.exit_probability(earlier_boundary, earlier_fraction)
        walk.advance(earlier_boundary, earlier_fraction)
    return min(1.0, p_earlier + walk.exit_probability(abs(z), fraction))


class _Walk:
    """The density of the score among studies that have not stopped."""

    def __init__(self) -> None:
        self._scores: NDArray[np.float64] = np.zeros(1)
        self._weights: NDArray[np.float64] = np.ones(1)  # density times the grid's step
        self._fraction = 0.0

    def exit_probability(self, z: float, fraction: float) -> float:
        """Return the probability of reaching |z| at a fraction of the information without having stopped earlier."""
        spread = np.sqrt(fraction - self._fraction)
        bound = z * np.sqrt(fraction)
        upper = scipy.special.ndtr((self._scores - bound) / spread)
        return float(self._weights @ (upper + scipy.special.ndtr((-self._scores - bound) / spread)))

    def advance(self, boundary: float, fraction: float) -> None:
        """Advance the density to a look, keeping the studies within its boundary."""
        spread = np.sqrt(fraction - self._fraction)
        bound = boundary * np.sqrt(fraction)
        scores = np.linspace(-bound, bound, _POINTS)
        density = np.exp(-(((scores[:, None] - self._scores) / spread) ** 2) / 2) @ self._weights
        weights = density * (scores[1] - scores[0]) / (spread * np.sqrt(2 * np.pi))
        weights[[0, -1]] /= 2
        self._scores = scores
        self._weights = weights
        self._fraction = fraction


def compute_welch_z(first: Sequence[float], second: Sequence[float]) -> float:
    """Return the z with the same two-sided p as Welch's t, from two groups' (n, mean, variance).

    It has the sign of the first mean minus the second; it is 0 if a group has fewer than two or nothing varies.
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
