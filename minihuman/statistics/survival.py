"""Times until something happened, for those too to whom it had not happened when the watching stopped."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from minihuman.statistics.compare import Values, welch

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Waited:
    """How long each waited, and whether it came: False where the watching stopped first (right-censored)."""

    times: Values  # (n,) of any unit
    came: Flags  # (n,)

    def __post_init__(self) -> None:
        """Refuse what is none."""
        if self.times.shape != self.came.shape or self.times.ndim != 1 or np.isnan(self.times).any():
            raise ValueError("a time and whether it came for each: two rows of the same length, without NaN")

    def waiting(self, at: Values) -> NDArray[np.int64]:
        """How many are still waiting at some times: the line under a survival figure."""
        return len(self.times) - np.searchsorted(np.sort(self.times), at)


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """The share to whom it has not come yet (Kaplan and Meier, 1958), at each time that it came to somebody."""

    times: Values  # (k,) rising
    share: Values  # (k,) just after
    at_risk: NDArray[np.int64]  # (k,) just before


@dataclass(frozen=True, slots=True)
class WaitedCompared:
    """Two groups' waiting, first minus second."""

    n: tuple[int, int]
    never: tuple[int, int]  # to whom it had not come
    until: float  # restricted means look at the time up to here: as far as both groups' curves are known
    means: tuple[float, float]  # restricted means
    difference: float
    interval: tuple[float, float]
    p: float  # log-rank


def curve(waited: Waited) -> Curve:
    """The Kaplan-Meier curve."""
    times, came = np.unique(waited.times[waited.came], return_counts=True)
    at_risk = waited.waiting(times)
    share: Values = np.cumprod(1 - came / at_risk).astype(np.float64)
    return Curve(times, share, at_risk)


def restricted_mean(waited: Waited, until: float) -> float:
    """The mean time waited up to ``until``: the area under the curve."""
    found = curve(waited)
    inside = found.times < until
    edges = np.concatenate([[0.0], found.times[inside], [until]])
    heights = np.concatenate([[1.0], found.share[inside]])
    return float(np.sum(np.diff(edges) * heights))


def compare_waiting(first: Waited, second: Waited) -> WaitedCompared | None:
    """Two groups compared by restricted means and the log-rank test; None where a group has fewer than two.

    The interval is Welch's over pseudo-observations (Andersen, Hansen and Klein, 2004), one a person: where everybody
    was watched to the end it is that of the times themselves, cut there.
    """
    n = len(first.times), len(second.times)
    if min(n) < 2:
        return None
    until = min(_known_until(first), _known_until(second), float(max(first.times.max(), second.times.max())))
    means = restricted_mean(first, until), restricted_mean(second, until)
    pseudo = [_pseudo(waited, until) for waited in (first, second)]
    interval = (math.nan, math.nan)
    if max(np.ptp(pseudo[0]), np.ptp(pseudo[1])) > 0:
        interval = welch(*pseudo).interval()
    never = int((~first.came).sum()), int((~second.came).sum())
    return WaitedCompared(n, never, until, means, means[0] - means[1], interval, logrank_p(first, second))


def logrank_p(first: Waited, second: Waited) -> float:
    """The two-sided p of the log-rank test (Mantel, 1966): that both groups wait alike. NaN where nothing tells it."""
    whole = np.concatenate([first.times[first.came], second.times[second.came]])
    times, came = np.unique(whole, return_counts=True)
    a, b = (waited.waiting(times).astype(np.float64) for waited in (first, second))
    n = a + b
    expected = float((a * came / n).sum())
    several = n > 1  # with one left nothing varies
    spread = a * b * came * (n - came)
    variance = float((spread[several] / (n[several] ** 2 * (n[several] - 1))).sum())
    if not variance > 0:
        return math.nan
    return float(2 * special.ndtr(-abs(first.came.sum() - expected) / math.sqrt(variance)))


def _known_until(waited: Waited) -> float:
    """How far the curve is known: for ever where it came to the last one of all."""
    last = float(waited.times.max())
    return math.inf if waited.came[waited.times == last].all() else last


def _pseudo(waited: Waited, until: float) -> Values:
    n, whole = len(waited.times), restricted_mean(waited, until)
    others = np.arange(n)
    without = [
        restricted_mean(Waited(waited.times[others != one], waited.came[others != one]), until) for one in range(n)
    ]
    return n * whole - (n - 1) * np.array(without)
