"""Fits of a simulated participant's reaction times to logged participants.

The model of one participant is an ex-Gaussian distribution, faster for a repeated key and with practice, with a share
of pauses, longer presses after looking away. It is fitted to times alone. The module also measures how well a fit
predicts held-out episodes.
"""

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from minihuman.dataset.tables import Tables
from minihuman.errors import ReportError
from minihuman.simulation.human_like import ParticipantParameters

PARAMETER_NAMES = ("mu_ms", "sigma_ms", "tau_ms", "repeat_factor", "practice", "practice_presses", "pause")
_EPISODE = ["study", "participant", "session", "episode", "attempt"]  # what tells an episode from all others
MIN_TIMES = 150  # times that a fit needs
_MIN_TIMES_OF = {"tau_ms": 300, "practice": 300, "practice_presses": 1000}  # and that a parameter's interval needs
_START = (330.0, 50.0, 150.0, 0.6, 0.3, 150.0, 0.01)  # where a fit begins, in the order of `PARAMETER_NAMES`
_PRIOR_SDS = (
    np.inf,
    np.inf,
    np.inf,
    np.inf,
    1.0,
    1.0,
    2.0,
)  # around the start, on the unbounded scale of ``_to_unbounded``; weak, for practice that few times determine
_PAUSE_MS = 3000.0  # mean of the pauses' exponential
_CHANCES = ("practice", "pause")  # their unbounded scale is log odds; that of the others is the logarithm
_FATIGUE = 0.04  # slower by this share in 1,000 presses: too little to be told from practice, so it is taken as given
_MAX_LAG = 0.9  # of the lag-1 correlation by which intervals are widened
_MAX_EXPONENT = 30.0  # keeps exponentials finite
_ROUNDING_MS = 0.5  # a time within it of the floor counts as a time at the floor
_LEAST_LOG_DENSITY = -50.0  # so that no single time decides the fit
_STEP = 2e-2  # of a parameter on the unbounded scale, for the curvature


@dataclass(frozen=True, slots=True, eq=False)
class ReactionTimes:
    """Reaction times with the predictors that they depend on, each (n,)."""

    ms: NDArray[np.float64]
    again: NDArray[np.bool_]  # the key was that of the press before
    presses: NDArray[np.int64]  # made before

    def __getitem__(self, which: NDArray[np.bool_]) -> "ReactionTimes":
        """Return the times that a mask selects, with their predictors."""
        return ReactionTimes(self.ms[which], self.again[which], self.presses[which])


@dataclass(frozen=True, slots=True)
class ReactionTimeFit:
    """The most likely parameters, with 95 % intervals from the curvature (Wald, on logarithms and log odds).

    Intervals are widened for the lag-1 correlation of times. A parameter has no interval if there are too few times to
    determine it.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    n: int


def log_density(times: ReactionTimes, values: Mapping[str, float], *, floor_ms: float) -> NDArray[np.float64]:
    """Return the log density of each reaction time, per millisecond.

    For a time at the floor, it is the log probability of a time at or below the floor.

    Args:
        times: the reaction times with their predictors.
        values: the parameters of ``PARAMETER_NAMES``, by name.
        floor_ms: the shortest possible time in milliseconds.
    """
    practice_effect = values["practice"] * -np.expm1(-times.presses / values["practice_presses"])
    repeat_factor = np.where(times.again, values["repeat_factor"], 1.0)
    time_factor = repeat_factor * (1 - practice_effect) * (1 + _FATIGUE * times.presses / 1000)
    at_floor = times.ms <= floor_ms + _ROUNDING_MS
    z = (np.where(at_floor, floor_ms, times.ms) / time_factor - values["mu_ms"]) / values["sigma_ms"]
    ratio = values["sigma_ms"] / values["tau_ms"]
    tail = ratio**2 / 2 - ratio * z + scipy.special.log_ndtr(z - ratio)  # SciPy's exponnorm, ten times as fast
    # 1e-12 and 1e-300 only keep the logarithms finite
    log_below = np.log(np.maximum(scipy.special.ndtr(z) - np.exp(tail), 0.0) + 1e-12)
    log_response = np.where(at_floor, log_below, tail - np.log(values["tau_ms"] * time_factor))
    pauses = np.where(at_floor, 0.0, values["pause"] * np.exp(-times.ms / _PAUSE_MS) / _PAUSE_MS)
    log_densities = np.log((1 - values["pause"]) * np.exp(log_response) + pauses + 1e-300)
    return np.maximum(log_densities, _LEAST_LOG_DENSITY)


def fit_reaction_times(times: ReactionTimes, *, floor_ms: float) -> ReactionTimeFit | None:
    """Return the maximum-a-posteriori fit of the parameters, or None if there are fewer than ``MIN_TIMES`` times.

    ``floor_ms`` is the shortest possible time in milliseconds.
    """
    if len(times.ms) < MIN_TIMES:
        return None

    def compute_cost(candidate: NDArray[np.float64]) -> float:  # the negative log posterior density
        log_prior = -float((((candidate - start) / _PRIOR_SDS) ** 2).sum()) / 2
        return -log_prior - float(log_density(times, _read_parameters(candidate), floor_ms=floor_ms).sum())

    start = np.array([_to_unbounded(*named) for named in zip(PARAMETER_NAMES, _START, strict=True)])
    options: Any = {"maxiter": 4000, "maxfev": 4000, "xatol": 1e-3, "fatol": 1e-2, "adaptive": True}
    optimum = scipy.optimize.minimize(compute_cost, start, method="Nelder-Mead", options=options)
    point = optimum.x
    curvature = _measure_curvature(compute_cost, point)
    unrepeated_ms = times.ms / np.where(times.again, _read_parameters(point)["repeat_factor"], 1.0)
    ranks = scipy.stats.rankdata(unrepeated_ms)
    lag_1_correlation = float(np.corrcoef(ranks[:-1], ranks[1:])[0, 1])
    lag = min(max(lag_1_correlation, 0.0), _MAX_LAG)
    variances = np.diag(np.linalg.pinv(curvature)) * (1 + lag) / (1 - lag)  # as of a mean of autocorrelated times
    errors = np.where(variances > 0, np.sqrt(np.maximum(variances, 0)), math.inf)
    z = float(scipy.special.ndtri(0.975))
    intervals = {
        name: (_from_unbounded(name, estimate - z * error), _from_unbounded(name, estimate + z * error))
        for name, estimate, error in zip(PARAMETER_NAMES, point, errors, strict=True)
        if len(times.ms) >= _MIN_TIMES_OF.get(name, MIN_TIMES) and math.isfinite(error)
    }
    return ReactionTimeFit(_read_parameters(point), intervals, len(times.ms))


def _read_parameters(point: NDArray[np.float64]) -> dict[str, float]:
    """Return the parameters by name, from their values on the unbounded scale."""
    named_coordinates = zip(PARAMETER_NAMES, point, strict=True)
    return {name: _from_unbounded(name, float(coordinate)) for name, coordinate in named_coordinates}


def _measure_curvature(cost: Callable[[NDArray[np.float64]], float], point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix of second derivatives of a function at a point, by central differences of ``_STEP``."""
    steps = np.eye(len(point)) * _STEP
    curvature = np.empty((len(point), len(point)))
    for row, a in enumerate(steps):
        for column, b in enumerate(steps):
            slope_ahead = cost(point + a + b) - cost(point + a - b)
            slope_behind = cost(point - a + b) - cost(point - a - b)
            curvature[row, column] = (slope_ahead - slope_behind) / (4 * _STEP**2)
    return curvature


def _to_unbounded(name: str, parameter: float) -> float:
    """Return the log odds of a probability, or the logarithm of any other parameter."""
    if name in _CHANCES:
        return math.log(parameter / (1 - parameter))
    return math.log(parameter)


def _from_unbounded(name: str, unbounded: float) -> float:
    """Return a parameter from its log odds, for a probability, or from its logarithm; both are limited to 30."""
    exponent = min(max(unbounded, -_MAX_EXPONENT), _MAX_EXPONENT)
    if name in _CHANCES:
        return 1 / (1 + math.exp(-exponent))
    return math.exp(exponent)


@dataclass(frozen=True, slots=True)
class FittedParticipant:
    """The fit to one participant, and its predictive gain on every second episode, held out from a second fit."""

    participant: str
    fitted: ReactionTimeFit
    gain: float  # bits per held-out press over a log-normal that knows repeated keys and practice, of the same episodes
    held_out: int  # presses


def fit_participants(tables: Tables) -> Iterator[FittedParticipant]:
    """Yield a fit for each session of a participant that has enough presses in included episodes.

    Raises:
        LogError: if the folder does not exist.
        ReportError: if no participant has enough presses.
    """
    tables.require(("steps",))
    included = tables.frame("episodes", [*_EPISODE, "exclusion_reason"])
    included = included[included["exclusion_reason"].isna()]
    steps = tables.frame("steps", [*_EPISODE, "key", "visible_effect", "response_ms"])
    is_included = pd.MultiIndex.from_frame(steps[_EPISODE]).isin(pd.MultiIndex.from_frame(included[_EPISODE]))
    steps["response_ms"] = steps["response_ms"].where(is_included)
    any_fit = False
    for _, session in steps.groupby(_EPISODE[:3], sort=False):
        fitted = _fit_participant(session)
        if fitted is not None:
            any_fit = True
            yield fitted
    if not any_fit:
        raise ReportError(f"{tables.source}: no participant has enough key presses for a fit; record more episodes")


def _fit_participant(steps: pd.DataFrame) -> FittedParticipant | None:
    """Fit the participant of one session to all its presses, and to those of odd episodes for the gain on the others.

    Return None if there are too few presses for either fit.
    """
    times, episodes = select_reaction_times(steps)
    is_odd = episodes % 2 == 1
    floor_ms = ParticipantParameters().floor_ms
    fit = fit_reaction_times(times, floor_ms=floor_ms)
    half_fit = fit_reaction_times(times[is_odd], floor_ms=floor_ms)
    if fit is None or half_fit is None:
        return None
    gain = measure_gain(half_fit, times[is_odd], times[~is_odd])
    return FittedParticipant(str(steps["participant"].iloc[0]), fit, gain, int((~is_odd).sum()))


def select_reaction_times(steps: pd.DataFrame) -> tuple[ReactionTimes, NDArray[np.int64]]:
    """Return the reaction times to fit, and the episode number of each time.

    An episode's first press and a press after a press without a visible effect are excluded.
    """
    previous = steps.shift(1)
    is_usable = (steps["episode"] == previous["episode"]) & (steps["attempt"] == previous["attempt"])
    is_usable &= previous["visible_effect"].astype("boolean").fillna(False).astype(bool) & steps["response_ms"].notna()
    usable_steps = steps[is_usable]
    times = ReactionTimes(
        usable_steps["response_ms"].to_numpy(float),
        (steps["key"].astype(str) == previous["key"].astype(str))[is_usable].to_numpy(bool),
        np.flatnonzero(is_usable.to_numpy(bool)).astype(np.int64),
    )
    return times, usable_steps["episode"].to_numpy(np.int64)


def measure_gain(fitted: ReactionTimeFit, training: ReactionTimes, held_out: ReactionTimes) -> float:
    """Return how many bits per held-out press a fit predicts better than a log-normal with the same predictors.

    Both distributions are conditional on times above the floor, because the probability at the floor cannot be compared
    with a density. NaN if no held-out time is above the floor.

    Args:
        fitted: the fit to the training times.
        training: the times to which the log-normal is fitted.
        held_out: the times to predict.
    """
    floor_ms = ParticipantParameters().floor_ms
    above = held_out[held_out.ms > floor_ms + _ROUNDING_MS]
    if not len(above.ms):
        return math.nan
    training_predictors, new_predictors = (
        np.column_stack([np.ones(len(times.ms)), times.again, np.log1p(times.presses)]) for times in (training, above)
    )
    slopes = np.linalg.lstsq(training_predictors, np.log(training.ms), rcond=None)[0]
    residual_sd = (np.log(training.ms) - training_predictors @ slopes).std()
    log_normal = scipy.stats.norm(new_predictors @ slopes, residual_sd)
    baseline = log_normal.logpdf(np.log(above.ms)) - np.log(above.ms) - log_normal.logsf(math.log(floor_ms))
    at_floor = ReactionTimes(np.full(len(above.ms), floor_ms), above.again, above.presses)
    p_below = np.exp(log_density(at_floor, fitted.values, floor_ms=floor_ms))
    log_p_above = np.log1p(-np.minimum(p_below, 1 - 1e-9))  # the limit keeps the logarithm finite
    log_densities = log_density(above, fitted.values, floor_ms=floor_ms) - log_p_above
    return float((log_densities - baseline).mean() / np.log(2))


def describe_fits(participants: list[FittedParticipant]) -> Iterator[str]:
    """Yield lines that describe each participant's fit, the median participant, and the gain on held-out episodes."""
    for participant in participants:
        parameters = ", ".join(f"{name} {participant.fitted.values[name]:.3g}" for name in PARAMETER_NAMES)
        bits = f"{participant.gain:+.2f} bits per press"
        yield f"{participant.participant}  {parameters}  ({participant.fitted.n} presses; held out: {bits})"
    settings = []
    for name in PARAMETER_NAMES:
        median = float(np.median([participant.fitted.values[name] for participant in participants]))
        settings.append(f"{name}={median:.4g}")
    yield "human-like:" + ",".join(settings)
    gain = np.mean([participant.gain for participant in participants])
    yield f"On held-out episodes the fit predicts {gain:+.2f} bits per press better than a conditional log-normal."


def write_fits(participants: list[FittedParticipant], path: Path) -> Path:
    """Write a row per participant and parameter, with its interval, as a CSV file; return the file's path."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("participant", "parameter", "value", "low", "high", "presses", "held_out_bits"))
        for participant in participants:
            for name in PARAMETER_NAMES:
                fitted = participant.fitted
                low, high = fitted.intervals.get(name, (math.nan, math.nan))
                table.writerow(
                    (participant.participant, name, fitted.values[name], low, high, fitted.n, participant.gain)
                )
    return path
