"""The report's table of stop-signal reaction times."""

import math

import pandas as pd

from minihuman.activities.trials.stop_signal import FEWEST_STOP_TRIALS, StopSignalEstimate, estimate_people
from minihuman.reporting.activity_sections import CaptionedTable
from minihuman.reporting.template import Table, format_mean_sd, format_number

_HEADS = (
    "block", "group", "participant", "go trials", "go accuracy", "go omissions", "go RT (ms)", "stop trials",
    "p(respond | signal)", "delay (ms)", "failed stop RT (ms)", "SSRT (ms)", "remark",
)  # fmt: skip
_CAPTION = (
    "Stop signals: go RT, mean of all go responses; delay, mean of the presented ones; failed stop RT, mean of responses "
    "in stop trials; SSRT, by integration with go omissions replaced by the slowest go response, wrong and premature go "
    f"responses included (Verbruggen et al., 2019). None with fewer than {FEWEST_STOP_TRIALS} stop trials, or where "
    "failed stops are not faster than go responses. Last row of a group: mean (standard deviation) over participants."
)


def tabulate_stop_signals(trials: pd.DataFrame) -> list[CaptionedTable]:
    """Build the table of stop-signal reaction times; none without stop signals."""
    estimates = list(estimate_people(trials))
    rows: list[tuple[str, ...]] = []
    for place, (block, group, participant, estimate) in enumerate(estimates):
        rows.append((block, group, participant, *_format_estimate(estimate)))
        is_last = place + 1 == len(estimates) or estimates[place + 1][:2] != (block, group)
        if is_last:
            rows.append(_summarise(block, group, [other for *of, _, other in estimates if of == [block, group]]))
    if rows:
        return [CaptionedTable(Table(_HEADS, rows, words=3), _CAPTION)]
    return []


def _format_estimate(estimate: StopSignalEstimate) -> tuple[str, ...]:
    return (
        str(estimate.go_trials),
        _format(estimate.go_accuracy, 3),
        _format(estimate.go_omissions, 3),
        _format(estimate.go_ms, 0),
        str(estimate.stop_trials),
        _format(estimate.response_rate, 3),
        _format(estimate.mean_delay_ms, 0),
        _format(estimate.failed_stop_ms, 0),
        _format(estimate.ssrt_ms, 0),
        estimate.remark,
    )


def _summarise(block: str, group: str, estimates: list[StopSignalEstimate]) -> tuple[str, ...]:
    times = pd.Series([estimate.ssrt_ms for estimate in estimates]).dropna()
    summary = "n/a"
    if len(times):
        summary = format_mean_sd(float(times.mean()), float(times.std()))
    return (block, group, f"all with an SSRT: {len(times)} of {len(estimates)}", *[""] * 8, summary, "")


def _format(value: float, digits: int) -> str:
    if math.isnan(value):
        return "n/a"
    return format_number(value, digits)
