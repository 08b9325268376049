"""Stop-signal reaction times by the integration method with replacement of omissions.

Source: Verbruggen et al. (2019), A consensus guide to capturing the ability to inhibit actions and impulsive behaviors
in the stop-signal task, eLife 8:e46323.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from minihuman.experiment.trial_responses import NO_RESPONSE

STOP_DELAY = "delay_ms"  # the option that a stop signal's delay comes from
FEWEST_STOP_TRIALS = 50
RESPONSE_RATES = (0.25, 0.75)  # of stop trials: outside, the estimate is unreliable


@dataclass(frozen=True, slots=True)
class StopSignalEstimate:
    """The estimate of one participant in one block; times in milliseconds, NaN where there is none."""

    go_trials: int
    stop_trials: int
    go_accuracy: float
    go_omissions: float  # share of go trials
    go_ms: float  # mean, of all go trials with a response
    failed_stop_ms: float  # mean response time of stop trials with a response
    response_rate: float  # p(respond | signal)
    mean_delay_ms: float  # of the presented delays
    ssrt_ms: float  # NaN where it must not be estimated
    remark: str  # why there is no estimate, or why it is unreliable; "" otherwise


def estimate_stop_signal(
    go_ms: NDArray[np.float64],
    is_go_correct: NDArray[np.bool_],
    stop_ms: NDArray[np.float64],
    delays_ms: NDArray[np.float64],
) -> StopSignalEstimate:
    """Estimate the stop-signal reaction time of one participant.

    Args:
        go_ms: response times of all go trials in milliseconds, shape (g,); NaN for an omission. Wrong and premature
            responses are included.
        is_go_correct: whether the response of each go trial was correct, shape (g,).
        stop_ms: response times of all stop trials, shape (s,); NaN where the response was withheld.
        delays_ms: the presented delay of each stop trial, shape (s,).
    """
    is_failed_stop = ~np.isnan(stop_ms)
    is_omission = np.isnan(go_ms)
    response_rate = float(is_failed_stop.mean()) if len(stop_ms) else math.nan
    mean_go_ms = _find_mean(go_ms[~is_omission])
    failed_ms = _find_mean(stop_ms[is_failed_stop])
    remark = _find_obstacle(len(stop_ms), mean_go_ms, failed_ms)
    ssrt_ms = math.nan
    if not remark:
        sorted_go_ms = np.sort(np.where(is_omission, np.nanmax(go_ms), go_ms))  # the slowest replaces omissions
        rank = min(len(go_ms), max(1, math.ceil(response_rate * len(go_ms))))  # of the quantile p(respond)
        ssrt_ms = float(sorted_go_ms[rank - 1]) - float(delays_ms.mean())
        if not RESPONSE_RATES[0] <= response_rate <= RESPONSE_RATES[1]:
            remark = f"p(respond | signal) is outside {RESPONSE_RATES[0]} to {RESPONSE_RATES[1]}: unreliable"
    return StopSignalEstimate(
        go_trials=len(go_ms),
        stop_trials=len(stop_ms),
        go_accuracy=_find_mean(is_go_correct[~is_omission].astype(np.float64)),
        go_omissions=_find_mean(is_omission.astype(np.float64)),
        go_ms=mean_go_ms,
        failed_stop_ms=failed_ms,
        response_rate=response_rate,
        mean_delay_ms=_find_mean(delays_ms),
        ssrt_ms=ssrt_ms,
        remark=remark,
    )


def _find_obstacle(stop_trials: int, go_ms: float, failed_stop_ms: float) -> str:
    """Return why no stop-signal reaction time may be estimated; "" if it may. The times are means in ms, or NaN."""
    if stop_trials < FEWEST_STOP_TRIALS:
        return f"fewer than {FEWEST_STOP_TRIALS} stop trials"
    if math.isnan(go_ms):
        return "no response in a go trial"
    if failed_stop_ms >= go_ms:
        return "failed stops are not faster than go responses: the race model does not hold"
    return ""


def _find_mean(numbers: NDArray[np.float64]) -> float:
    if len(numbers):
        return float(numbers.mean())
    return math.nan


def read_stop_delays(trials: pd.DataFrame) -> "pd.Series[float]":
    """Return the delay of the stop signal of each trial in milliseconds; NaN for a trial without one.

    A trial has a stop signal if its world has the option ``delay_ms`` and withholding the response is correct.
    """
    delays = trials["stimulus"].map(lambda text: json.loads(text).get(STOP_DELAY, math.nan)).astype(float)
    return delays.where(trials["correct"].eq(NO_RESPONSE))


def estimate_people(trials: pd.DataFrame) -> Iterator[tuple[str, str, str, StopSignalEstimate]]:
    """Yield block, group, participant and estimate for each participant of each block with stop signals.

    ``trials`` are rows of the table of trials.
    """
    delays = read_stop_delays(trials)
    keys = [trials[name] for name in ("block", "group", "participant")]
    for (block, group, participant), part in trials.groupby(keys, sort=False):
        person_delays = delays.loc[part.index]
        is_stop = person_delays.notna()
        if not is_stop.any() or part["is_correct"].isna().all():
            continue
        go = part[~is_stop]
        yield (
            str(block),
            str(group),
            str(participant),
            estimate_stop_signal(
                go["response_ms"].to_numpy(np.float64),
                go["is_correct"].eq(True).to_numpy(bool),
                part.loc[is_stop, "response_ms"].to_numpy(np.float64),
                person_delays[is_stop].to_numpy().astype(np.float64),
            ),
        )
