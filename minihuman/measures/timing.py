"""Time: how long an episode was played, pauses left out, and how fast keys were answered."""

import math
import statistics

import numpy as np

from minihuman.recorded.episode import Episode


def played_ns(episode: Episode, until_ns: int | None = None) -> int:
    """Playing time from the reset to a moment of session time, by default the last step: pauses in between left out."""
    first, last = int(episode.t_ns[0]), int(episode.t_ns[-1]) if until_ns is None else until_ns
    return last - first - sum(max(0, min(last, end) - max(first, begin)) for begin, end in episode.pauses)


def playing_s(episode: Episode) -> float:
    """Seconds from the reset to the last step, without the pauses in between."""
    return played_ns(episode) / 1e9


def reaction_ms(episode: Episode) -> tuple[float, float]:
    """Mean and median reaction time, ms: key press minus the flip of the picture it answers; NaN without any."""
    answered = episode.rt_ms[~np.isnan(episode.rt_ms)]
    if not answered.size:
        return (math.nan, math.nan)
    return (float(answered.mean()), statistics.median(answered.tolist()))
