"""Group-sequential tests of two groups: boundaries by alpha spending, and p values adjusted for the looks.

Tests are two-sided and symmetric. Information is counted in participants; the increments between looks are normal and
independent.
"""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

_POINTS = 801  # of the grid on which the score's density between two looks is followed


def spend_alpha(fraction: float, alpha: float) -> float:
    """Return the alpha spent at a fraction of the information, of the O'Brien-Fleming type (Lan & DeMets, 1983)."""
    return float(4 * scipy.special.ndtr(scipy.special.ndtri(alpha / 4) / np.sqrt(fraction)))


def find_boundaries(fractions: Sequence[float], alpha: float = 0.05) -> tuple[float, ...]:
    """Return the |z| at which a study stops at each look; ``fractions`` of the information increase to 1."""
    spent = [0.0, *(spend_alpha(fraction, alpha) for fraction in fractions)]
    walk = _Walk()
    boundaries = list[float]()
    for at, fraction in enumerate(fractions):
        due = spent[at + 1] - spent[at]
        boundaries.append(float(scipy.optimize.brentq(lambda z, t=fraction, due=due: walk.exit(z, t) - due, 0.5, 12.0)))
        walk.advance(boundaries[-1], fraction)
    return tuple(boundaries)


def compute_adjusted_p(z: float, fractions: Sequence[float], boundaries: Sequence[float]) -> float:
    """Compute the p value of a study that stopped at the last of its looks with a given z.

    By stagewise ordering (Tsiatis, Rosner & Mehta, 1984, Biometrics 40), p is the probability of stopping earlier, or
    of a z at least as extreme at this look.
    """
    walk = _Walk()
    earlier = 0.0
    for boundary, fraction in zip(boundaries[: len(fractions) - 1], fractions, strict=False):
        earlier += walk.exit(boundary, fraction)
        walk.advance(boundary, fraction)
    return min(1.0, earlier + walk.exit(abs(z), fractions[-1]))


class _Walk:
    """The density of the score among studies that have not stopped."""

    def __init__(self) -> None:
        self._scores: NDArray[np.float64] = np.zeros(1)
        self._weights: NDArray[np.float64] = np.ones(1)  # density times the grid's step
        self._fraction = 0.0

    def exit(self, z: float, fraction: float) -> float:
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
    """Return the z with the same two-sided p as Welch's t, from two groups' (n, mean, variance); 0 if undefined."""
    (n, mean, variance), (m, other, spread) = first, second
    if n < 2 or m < 2 or variance + spread <= 0:
        return 0.0
    squares = variance / n, spread / m
    t = (mean - other) / np.sqrt(sum(squares))
    freedom = sum(squares) ** 2 / (squares[0] ** 2 / (n - 1) + squares[1] ** 2 / (m - 1))
    return float(-np.sign(t) * scipy.special.ndtri(scipy.stats.t.sf(abs(t), freedom)))
