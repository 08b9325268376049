"""Time: how long an episode was played, pauses left out, and how fast keys were answered."""

import math
import statistics
from collections.abc import Iterable

import numpy as np

from minihuman.recorded.episode import Episode
from minihuman.study.events import Noted, Paused, Resumed

Pauses = tuple[tuple[int, int | None], ...]  # begin and end, ns


def pauses(notes: Iterable[Noted | Paused | Resumed]) -> Pauses:
    """Begin and end of every pause, ns; the end is None for a pause that the session ended in."""
    found: list[tuple[int, int | None]] = []
    for note in sorted(notes, key=lambda note: note.t_ns):
        is_open = bool(found) and found[-1][1] is None
        match note:
            case Paused() if not is_open:
                found.append((note.t_ns, None))
            case Resumed() if is_open:
                found[-1] = (found[-1][0], note.t_ns)
    return tuple(found)


def playing_s(episode: Episode, paused: Pauses = ()) -> float:
    """Seconds from the reset to the last step, without the pauses in between."""
    first, last = int(episode.t_ns[0]), int(episode.t_ns[-1])
    still = sum(
        max(0, min(last, last if end is None else end) - max(first, begin)) for begin, end in paused if begin < last
    )
    return (last - first - still) / 1e9


def reaction_ms(episode: Episode) -> tuple[float, float]:
    """Mean and median reaction time, ms: key press minus the flip of the picture it answers; NaN without any."""
    answered = episode.rt_ms[~np.isnan(episode.rt_ms)]
    if not answered.size:
        return (math.nan, math.nan)
    return (float(answered.mean()), statistics.median(answered.tolist()))
