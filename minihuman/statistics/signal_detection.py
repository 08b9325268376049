"""Signal detection: sensitivity and criterion from counts, with the log-linear correction for every observer.

The measures follow Macmillan and Creelman (2005), Detection theory: a user's guide, chapters 1 and 2. The correction
follows Hautus (1995), Behavior Research Methods, Instruments, & Computers 27, 46-51: 0.5 is added to each count and 1
to the number of trials of each kind, even where no rate is 0 or 1, because correcting only extreme rates would bias
comparisons.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

_NORMAL = NormalDist()


@dataclass(frozen=True, slots=True)
class DetectionMeasures:
    """The detection measures of one observer in one condition."""

    hit_rate: float  # as counted; NaN without signal trials
    false_alarm_rate: float  # as counted; NaN without noise trials
    d_prime: float  # equal-variance normal model, log-linear rates; NaN unless there are trials of both kinds
    criterion: float  # c: 0 is unbiased, above 0 says "signal" too seldom


def measure_detection(hits: int, misses: int, false_alarms: int, correct_rejections: int) -> DetectionMeasures:
    """Compute detection measures from counts of responses.

    Raises:
        ValueError: if a count is below 0.
    """
    if min(hits, misses, false_alarms, correct_rejections) < 0:
        raise ValueError(f"counts are 0 or more, not {(hits, misses, false_alarms, correct_rejections)}")
    signals = hits + misses
    noises = false_alarms + correct_rejections
    hit_rate = hits / signals if signals else math.nan
    false_alarm_rate = false_alarms / noises if noises else math.nan
    if not signals or not noises:
        return DetectionMeasures(hit_rate, false_alarm_rate, math.nan, math.nan)
    z_hit = _NORMAL.inv_cdf((hits + 0.5) / (signals + 1))
    z_false_alarm = _NORMAL.inv_cdf((false_alarms + 0.5) / (noises + 1))
    return DetectionMeasures(hit_rate, false_alarm_rate, z_hit - z_false_alarm, -(z_hit + z_false_alarm) / 2)
