"""Measures of trials: accuracy, response times of correct responses, and detection, per participant and condition."""

import json
import math
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from minihuman.experiment.trial_responses import NO_RESPONSE
from minihuman.statistics.signal_detection import measure_detection

ANTICIPATION_MS = 150.0  # a response before it cannot follow from the stimulus
_OUTLIER_MADS = 3.0
_MAD_TO_SD = 1.4826  # of a normal distribution
TASK = "task"  # the label by which trials differ in what is to be done
SWITCH = "task_switch"
ALL = "all"  # the level of all trials together

MEASURES = {  # of a participant in a condition, with what they are called
    "accuracy": "accuracy (share of trials)",
    "response_mean_ms": "response time, mean of correct, trimmed (ms)",
    "response_median_ms": "response time, median of correct (ms)",
    "omissions": "omissions (share of trials with a correct response)",
    "hit_rate": "hits (share of signal trials)",
    "false_alarm_rate": "false alarms (share of noise trials)",
    "d_prime": "sensitivity d'",
    "criterion": "criterion c",
}
FORMULAS = {  # of a participant's trials, where the label does not say it
    "accuracy": "trials with the correct response, or rightly without any / trials that have a correct response",
    "response_mean_ms": "key press minus onset, the mean over correct responses without those trimmed",
    "response_median_ms": "key press minus onset, the median over correct responses",
    "hit_rate": "responses in trials that ask for one / these trials",
    "false_alarm_rate": "responses in trials that ask for none / these trials",
    "d_prime": "z(hits) \N{MINUS SIGN} z(false alarms), rates with the log-linear correction",
    "criterion": "\N{MINUS SIGN}(z(hits) + z(false alarms)) / 2, of the same rates",
}
COMPARED = ("accuracy", "response_mean_ms")  # between the levels of a label
_PERSON = ["participant", "session", "group", "block"]


def read_labels(trials: pd.DataFrame) -> dict[str, "pd.Series[str]"]:
    """Return, for each label, the level of each trial as text; "" for a trial without the label.

    If there is a label ``task``, which names what is to be done, a label ``task_switch`` is added unless it exists: it
    says whether the task is that of the trial before, so the difference between its levels is the switch cost.
    """
    labels = trials["labels"].map(lambda text: json.loads(text) if isinstance(text, str) and text else {})
    names = dict.fromkeys(name for trial_labels in labels for name in trial_labels)
    levels = {name: labels.map(lambda trial_labels, name=name: str(trial_labels.get(name, ""))) for name in names}
    if TASK in levels and SWITCH not in levels:
        levels[SWITCH] = _mark_switches(trials, levels[TASK])
    return levels


def _mark_switches(trials: pd.DataFrame, tasks: "pd.Series[str]") -> "pd.Series[str]":
    """Return for each trial "switch" or "repeat"; "" where the trial before is not included or has no task."""
    person = [trials[name] for name in _PERSON]
    previous = tasks.groupby(person).shift(fill_value="")
    follows_directly = trials["trial"].groupby(person).diff().eq(1)
    has_both_tasks = follows_directly & tasks.ne("") & previous.ne("")
    return tasks.eq(previous).map({True: "repeat", False: "switch"}).where(has_both_tasks, "")


def mark_trimmed(trials: pd.DataFrame) -> "pd.Series[bool]":
    """Return a mask of the correct responses whose times count in a trimmed mean.

    Responses before 150 ms are excluded, and those further than 3 scaled median absolute deviations from the
    participant's median in the block (Leys, Ley, Klein, Bernard and Licata, 2013, Journal of Experimental Social
    Psychology 49).
    """
    times = trials["response_ms"].where(trials["is_correct"].eq(True))
    times = times.where(times >= ANTICIPATION_MS)
    by_person = times.groupby([trials[name] for name in _PERSON])
    medians = by_person.transform("median")
    deviations = (times - medians).abs()
    spread = _MAD_TO_SD * deviations.groupby([trials[name] for name in _PERSON]).transform("median")
    is_near = (deviations <= _OUTLIER_MADS * spread) | spread.eq(0)  # without a spread, nothing is an outlier
    return times.notna() & is_near


def measure_conditions(trials: pd.DataFrame) -> pd.DataFrame:
    """Compute the measures of each participant in each block, over all trials and over each level of each label.

    Args:
        trials: the included rows of the table of trials.

    Returns:
        A row per participant, session, block, label and level, with the number of trials and ``MEASURES``. In the
        rows for all trials together, ``label`` is "" and ``level`` is "all".
    """
    trials = trials.assign(is_trimmed=mark_trimmed(trials))
    rows = list(_measure_level(trials, "", pd.Series(ALL, trials.index)))
    for label, levels in read_labels(trials).items():
        rows += _measure_level(trials, label, levels)
    return pd.DataFrame(rows, columns=[*_PERSON, "label", "level", "trials", *MEASURES])


def _measure_level(trials: pd.DataFrame, label: str, levels: "pd.Series[str]") -> Iterator[dict[str, object]]:
    """Yield a row of measures for each participant, session, block and level of a label.

    ``levels`` has the level of each trial; trials with the level "" are left out.
    """
    stated_levels = levels[levels != ""].rename("level")
    for key, part in trials.loc[stated_levels.index].groupby([*_PERSON, stated_levels], sort=False):
        *person, level = key
        yield dict(zip(_PERSON, person, strict=True)) | {"label": label, "level": level} | measure_trials(part)


def measure_trials(trials: pd.DataFrame) -> dict[str, float]:
    """Return the number of a participant's trials and their `MEASURES`, by name.

    Signal trials are those with a correct response; noise trials are those in which withholding a response is correct.
    The measures of detection are NaN if there are no noise trials. ``trials`` needs a column ``is_trimmed``, which is
    the mask of `mark_trimmed`.
    """
    scored = trials[trials["correct"].notna() & trials["correct"].ne("") & trials["is_correct"].notna()]
    is_correct = scored["is_correct"].astype(bool)
    has_response = scored["response"].ne(NO_RESPONSE)
    is_signal = scored["correct"].ne(NO_RESPONSE)
    detection = measure_detection(
        int((is_signal & has_response).sum()),
        int((is_signal & ~has_response).sum()),
        int((~is_signal & has_response).sum()),
        int((~is_signal & ~has_response).sum()),
    )
    is_detection_task = bool((~is_signal).any())
    times = trials["response_ms"]
    correct_times = times[trials["is_correct"].eq(True)] if len(scored) else times
    return {
        "trials": len(trials),
        "accuracy": _find_mean(is_correct),
        "response_mean_ms": _find_mean(times[trials["is_trimmed"]]),
        "response_median_ms": float(correct_times.median()),
        "omissions": _find_mean((~has_response)[is_signal]),
        "hit_rate": detection.hit_rate if is_detection_task else math.nan,
        "false_alarm_rate": detection.false_alarm_rate,
        "d_prime": detection.d_prime,
        "criterion": detection.criterion,
    }


def _find_mean(numbers: "pd.Series[float] | pd.Series[bool]") -> float:
    """Return the mean, or NaN if there are no numbers."""
    if len(numbers):
        return float(numbers.mean())
    return math.nan


def average_sessions(measured: pd.DataFrame) -> pd.DataFrame:
    """Average the measures over sessions: one row per participant, block, label and level."""
    keys = ["participant", "group", "block", "label", "level"]
    return measured.groupby(keys, sort=False)[["trials", *MEASURES]].mean().reset_index()


def measure_quarters(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the measures of each participant in each quarter of each block, as `measure_conditions` has them.

    ``label`` is "quarter" and ``level`` is "1" to "4"; a block is as long as its highest trial number.
    """
    trials = trials.assign(is_trimmed=mark_trimmed(trials))
    block_length = trials.groupby("block")["trial"].transform("max")
    # trials count from 1, so that a block's last trial is in quarter 4
    quarters = pd.Series(np.ceil(4 * trials["trial"] / block_length), trials.index).astype(int).astype(str)
    rows = list(_measure_level(trials, "quarter", quarters))
    return pd.DataFrame(rows, columns=[*_PERSON, "label", "level", "trials", *MEASURES])


def find_quantiles(trials: pd.DataFrame, levels: "pd.Series[str]", shares: Sequence[float]) -> pd.DataFrame:
    """Return quantiles of the correct response times by level, averaged over participants (Vincentiles).

    Source: Ratcliff (1979), Psychological Bulletin 86, 446-461.

    Args:
        trials: the rows of the table of trials.
        levels: the level of each trial; trials with the level "" are left out.
        shares: the quantiles to compute, from 0 to 1.

    Returns:
        A row per level and a column per share, in milliseconds.
    """
    times = trials["response_ms"].where(trials["is_correct"].eq(True) | trials["is_correct"].isna())
    by_person = times[levels != ""].groupby([trials["participant"], levels.rename("level")], sort=False)
    quantiles = by_person.quantile(np.array(shares)).unstack()
    return quantiles.groupby("level", sort=False).mean()
