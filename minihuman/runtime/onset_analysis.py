"""Onsets in a recording, compared with the times that a log states: no device and no clock.

`find_onsets` finds clicks and edges in samples, `measure_delays_s` matches them with the stated times, and
`summarise_delays` returns the figures that `minihuman doctor` reports.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

QUIET_S = 0.1  # without a sample over the threshold, before an onset
FAINTEST = 0.001  # of full scale; a smaller change is no signal
_NOISE_TO_THRESHOLD = 6.0  # standard deviations of the noise
_PEAK_TO_THRESHOLD = 0.25
_MAD_TO_SD = 1.4826  # the standard deviation of normal values, in median absolute deviations
_EARLIEST_S = -0.1  # the smallest constant delay; the input's stated times may be too early
_LATEST_S = 1.0
_SPREAD_S = 0.02  # in which the delays of most onsets lie, while the constant delay is looked for


@dataclass(frozen=True, slots=True)
class DelaySummary:
    """The delays from stated to recorded onsets.

    Attributes:
        stated: the number of stated onsets.
        recorded: how many of these were found in the recording.
        median_ms: the median delay; NaN if none was found, as are the following.
        sd_ms: the delays' standard deviation; NaN with fewer than two.
        largest_ms: the largest distance of a delay from the median.
    """

    stated: int
    recorded: int
    median_ms: float
    sd_ms: float
    largest_ms: float


def find_onsets(samples: NDArray[np.float32], rate_hz: float, *, count: int, rise_s: float) -> NDArray[np.float64]:
    """Return the onsets of transients in a recording, float64[n], in samples from its beginning, with fractions.

    A transient is a change, in either direction, from the mean of the ``rise_s`` before. Its onset is the time at which
    it first reaches half of its peak.

    Args:
        samples: float32[n], -1 to 1.
        rate_hz: the number of samples per second.
        count: how many transients are expected; their peaks set the threshold.
        rise_s: the time in seconds within which a transient reaches its peak.
    """
    length = round(rise_s * rate_hz)
    if len(samples) < 4 * length:
        return np.empty(0)
    changes = _measure_changes(samples, length)
    loud = np.flatnonzero(changes > _find_threshold(changes, round(QUIET_S * rate_hz), count))
    quiet_length = round(QUIET_S * rate_hz)
    starts = loud[np.diff(loud, prepend=-quiet_length - 1) > quiet_length]
    return np.array([_locate_half_peak(samples, int(start), length) for start in starts], np.float64)


def _measure_changes(samples: NDArray[np.float32], length: int) -> NDArray[np.float64]:
    """Return how far each sample is from the mean of the ``length`` samples before it, float64[n]."""
    padded = np.concatenate([np.full(length, samples[0], np.float64), samples])
    sums = np.concatenate([[0.0], np.cumsum(padded)])
    means = (sums[length:-1] - sums[: -length - 1]) / length
    changes: NDArray[np.float64] = np.abs(samples - means)
    return changes


def _find_threshold(changes: NDArray[np.float64], block_length: int, count: int) -> float:
    """Return a threshold above the noise, and at a quarter of the typical peak of ``count`` transients."""
    noise = _MAD_TO_SD * float(np.median(changes))
    n_blocks = max(1, len(changes) // block_length)
    peaks = [float(block.max()) for block in np.array_split(changes, n_blocks)]
    typical_peak = float(np.median(sorted(peaks)[-count:]))
    return max(FAINTEST, _NOISE_TO_THRESHOLD * noise, _PEAK_TO_THRESHOLD * typical_peak)


def _locate_half_peak(samples: NDArray[np.float32], start: int, length: int) -> float:
    """Return where the transient that crosses the threshold at ``start`` first reaches half of its peak, in samples."""
    before = samples[max(0, start - 2 * length) : max(1, start - length)]
    levels = np.abs(samples - before.mean(dtype=np.float64))[: start + length]
    half = levels[start:].max() / 2
    index = start + int(np.argmax(levels[start:] >= half))
    while index > 0 and levels[index - 1] >= half:
        index -= 1
    if index == 0:
        return 0.0
    return index - 1 + float((half - levels[index - 1]) / (levels[index] - levels[index - 1]))


def measure_delays_s(
    stated_s: NDArray[np.float64], recorded_s: NDArray[np.float64], *, tolerance_s: float
) -> NDArray[np.float64]:
    """Return the delay in seconds from each stated onset to its recorded one, float64[n]; NaN if it was not recorded.

    The constant delay is that with which most onsets agree, from -0.1 to 1 s; irregular intervals make it unambiguous.
    Each recorded onset belongs to at most one stated onset.

    Args:
        stated_s: the stated onsets, float64[n].
        recorded_s: the recorded onsets, float64[m], by the same clock.
        tolerance_s: the largest distance from the constant delay, less than half of the shortest interval.
    """
    delays_s = np.full(len(stated_s), np.nan)
    differences_s = recorded_s[None, :] - stated_s[:, None]
    constant_s = _find_constant_delay_s(differences_s)
    if constant_s is None:
        return delays_s
    errors_s = np.abs(differences_s - constant_s)
    used: set[int] = set()
    for stated, recorded in sorted(np.argwhere(errors_s <= tolerance_s), key=lambda pair: float(errors_s[tuple(pair)])):
        if np.isnan(delays_s[stated]) and int(recorded) not in used:
            delays_s[stated] = differences_s[stated, recorded]
            used.add(int(recorded))
    return delays_s


def _find_constant_delay_s(differences_s: NDArray[np.float64]) -> float | None:
    """Return the delay with which most differences agree; None if no recorded onset can belong to a stated one."""
    possible = (differences_s >= _EARLIEST_S) & (differences_s <= _LATEST_S)
    candidates_s = np.sort(differences_s[possible])
    if len(candidates_s) == 0:
        return None
    ends = np.searchsorted(candidates_s, candidates_s + _SPREAD_S, side="right")
    first = int(np.argmax(ends - np.arange(len(candidates_s))))
    return float(np.median(candidates_s[first : ends[first]]))


def summarise_delays(delays_s: NDArray[np.float64]) -> DelaySummary:
    """Return the summary of delays in seconds, float64[n], among which NaN is an onset that was not recorded."""
    delays_ms = 1000 * delays_s[~np.isnan(delays_s)]
    if len(delays_ms) == 0:
        return DelaySummary(len(delays_s), 0, np.nan, np.nan, np.nan)
    median_ms = float(np.median(delays_ms))
    sd_ms = float(np.std(delays_ms, ddof=1)) if len(delays_ms) > 1 else np.nan
    return DelaySummary(len(delays_s), len(delays_ms), median_ms, sd_ms, float(np.abs(delays_ms - median_ms).max()))


def compute_share_within(delays_s: NDArray[np.float64], uncertainties_s: NDArray[np.float64]) -> float:
    """Return the share of recorded onsets whose delay is within the stated uncertainty of the median delay.

    Args:
        delays_s: float64[n]; NaN if the onset was not recorded; at least one is not.
        uncertainties_s: float64[n].
    """
    is_recorded = ~np.isnan(delays_s)
    errors_s = np.abs(delays_s[is_recorded] - np.median(delays_s[is_recorded]))
    return float(np.mean(errors_s <= uncertainties_s[is_recorded]))
