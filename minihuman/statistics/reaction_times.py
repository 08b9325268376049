"""Reaction times of one person: an ex-Gaussian, shorter for a repeated key and with practice. From times alone."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

PARAMETER_NAMES = ("mu_ms", "sigma_ms", "tau_ms", "repeat_factor", "practice", "practice_presses")
MIN_TIMES = 60  # times that a fit needs
_START = (330.0, 50.0, 150.0, 0.6, 0.3, 150.0)
_FATIGUE = 0.04  # slower by this share in 1,000 presses: too little to be told from practice, so it is taken as given
_Z = float(stats.norm.ppf(0.975))
_STEP = 1e-2  # of a parameter on that line, for the curvature


@dataclass(frozen=True, slots=True, eq=False)
class ReactionTimes:
    """Reaction times with what they depend on, each (n,)."""

    ms: NDArray[np.float64]
    again: NDArray[np.bool_]  # the key was that of the press before
    presses: NDArray[np.int64]  # made before

    def __getitem__(self, which: NDArray[np.bool_]) -> "ReactionTimes":
        return ReactionTimes(self.ms[which], self.again[which], self.presses[which])


@dataclass(frozen=True, slots=True)
class ReactionTimeFit:
    """Most likely parameters, and 95 % intervals by the curvature there (Wald, on logarithms and log odds)."""

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    n: int


def log_density(times: ReactionTimes, values: Mapping[str, float], *, floor_ms: float) -> NDArray[np.float64]:
    """The logarithm of each time's density per ms; of a time at the floor, of the chance to be there or below."""
    gone = values["practice"] * -np.expm1(-times.presses / values["practice_presses"])
    share = np.where(times.again, values["repeat_factor"], 1.0) * (1 - gone) * (1 + _FATIGUE * times.presses / 1000)
    shape = stats.exponnorm(values["tau_ms"] / values["sigma_ms"], values["mu_ms"], values["sigma_ms"])
    at_floor = times.ms <= floor_ms + 0.5
    found = np.empty(len(times.ms))
    found[at_floor] = np.log(shape.cdf(floor_ms / share[at_floor]) + 1e-12)
    found[~at_floor] = shape.logpdf(times.ms[~at_floor] / share[~at_floor]) - np.log(share[~at_floor])
    return np.maximum(found, -50.0)


def fit_reaction_times(times: ReactionTimes, *, floor_ms: float) -> ReactionTimeFit | None:
    """The most likely parameters; None where there are too few times, or none are most likely."""
    if len(times.ms) < MIN_TIMES:
        return None

    def unlikely(point: NDArray[np.float64]) -> float:
        return -float(log_density(times, _values(point), floor_ms=floor_ms).sum())

    start = np.array([_to_line(name, value) for name, value in zip(PARAMETER_NAMES, _START, strict=True)])
    options: Any = {"maxiter": 4000, "maxfev": 4000, "xatol": 1e-3, "fatol": 1e-2, "adaptive": True}
    found = optimize.minimize(unlikely, start, method="Nelder-Mead", options=options)
    point = found.x
    steps = np.eye(len(PARAMETER_NAMES)) * _STEP
    curvature = np.array(
        [
            [
                (unlikely(point + a + b) - unlikely(point + a - b) - unlikely(point - a + b) + unlikely(point - a - b))
                / (4 * _STEP**2)
                for b in steps
            ]
            for a in steps
        ]
    )
    variances = np.diag(np.linalg.pinv(curvature))
    errors = np.where(variances > 0, np.sqrt(np.maximum(variances, 0)), math.inf)
    intervals = {
        name: (_from_line(name, at - _Z * error), _from_line(name, at + _Z * error))
        for name, at, error in zip(PARAMETER_NAMES, point, errors, strict=True)
    }
    return ReactionTimeFit(_values(point), intervals, len(times.ms))


def _values(point: NDArray[np.float64]) -> dict[str, float]:
    return {name: _from_line(name, float(at)) for name, at in zip(PARAMETER_NAMES, point, strict=True)}


def _to_line(name: str, value: float) -> float:
    return math.log(value / (1 - value)) if name == "practice" else math.log(value)


def _from_line(name: str, at: float) -> float:
    at = min(max(at, -30.0), 30.0)
    return 1 / (1 + math.exp(-at)) if name == "practice" else math.exp(at)
