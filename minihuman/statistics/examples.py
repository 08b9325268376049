"""What numbers tell of other numbers, learnt from examples: ridge regression, with intervals that hold on the examples.

For parameters whose likelihood nobody can write down but whose consequences can be simulated (approximate Bayesian
computation by regression: Beaumont, Zhang and Balding, 2002). The intervals are conformal: as wide as the errors at
examples that were left out (Barber and others, 2021).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.95
_RIDGES = tuple(10.0**power for power in range(-2, 4))

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """A regression of one target on ``d`` numbers and their squares."""

    centre: Numbers  # (d,)
    scale: Numbers  # (d,)
    weights: Numbers  # (1 + 2 d,)
    half_width: float  # of the interval
    told: float  # share of the examples' variance that is told where they were left out; at most 1, may be below 0

    def predict(self, numbers: Numbers) -> Numbers:
        """The target of each row of (n, d)."""
        return _features(numbers, self.centre, self.scale) @ self.weights

    def interval(self, at: float) -> tuple[float, float]:
        """In which a target lies that was predicted to be ``at``."""
        return at - self.half_width, at + self.half_width


def learn(numbers: Numbers, target: Numbers, level: float = LEVEL) -> Examples:
    """Regress (n,) on (n, d). Of several penalties the one is taken that errs least on what it has not seen.

    Raises:
        ValueError: if there are fewer than ten examples.
    """
    n = len(target)
    if n < 10:
        raise ValueError(f"{n} examples tell too little; ten are the least")
    centre, scale = numbers.mean(axis=0), np.maximum(numbers.std(axis=0), 1e-9)
    rows = _features(numbers, centre, scale)
    best: tuple[float, Numbers, Numbers] | None = None
    for ridge in _RIDGES:
        penalty = np.eye(rows.shape[1]) * ridge
        penalty[0, 0] = 0.0  # the mean is not shrunk
        solved = np.linalg.solve(rows.T @ rows + penalty, rows.T)
        weights, leverage = solved @ target, np.einsum("ij,ji->i", rows, solved)
        errors = (target - rows @ weights) / np.maximum(1 - leverage, 1e-3)  # each with its own example left out
        if best is None or (errors**2).mean() < best[0]:
            best = float((errors**2).mean()), weights, errors
    assert best is not None
    loss, weights, errors = best
    rank = min(math.ceil((n + 1) * level), n)
    return Examples(centre, scale, weights, float(np.sort(np.abs(errors))[rank - 1]), 1 - loss / float(target.var()))


def _features(numbers: Numbers, centre: Numbers, scale: Numbers) -> Numbers:
    at = np.clip((np.atleast_2d(numbers) - centre) / scale, -4, 4)
    return np.concatenate([np.ones((len(at), 1)), at, at**2], axis=1)
