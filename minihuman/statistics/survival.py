"""Survival analysis: times until an event, censored times included; Kaplan-Meier curves, restricted means and the
log-rank test.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from minihuman.statistics.comparison import Values, compare_means

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SurvivalTimes:
    """How long each waited, and whether it came: False where the watching stopped first (right-censored)."""

    times: Values  # (n,) of any unit
    observed: Flags  # (n,)

    def __post_init__(self) -> None:
        """Refuse what is none."""
        if self.times.shape != self.observed.shape or self.times.ndim != 1 or np.isnan(self.times).any():
            shapes = f"times has shape {self.times.shape} and observed {self.observed.shape}"
            raise ValueError(f"{shapes}; give one finite time and one flag per participant")

    def waiting(self, at: Values) -> NDArray[np.int64]:
        """How many are still waiting at some times: the line under a survival figure."""
        return len(self.times) - np.searchsorted(np.sort(self.times), at)


@dataclass(frozen=True, slots=True, eq=False)
class SurvivalCurve:
    """The share to whom it has not come yet (Kaplan and Meier, 1958), at each time of an event."""

    times: Values  # (k,) rising
    share: Values  # (k,) just after
    at_risk: NDArray[np.int64]  # (k,) just before


@dataclass(frozen=True, slots=True)
class SurvivalComparison:
    """Two groups' waiting, first minus second."""

    n: tuple[int, int]
    never: tuple[int, int]  # to whom it had not come
    until: float  # restricted means look at the time up to here: as far as both groups' curves are known
    means: tuple[float, float]  # restricted means
    difference: float
    interval: tuple[float, float]
    p: float  # log-rank


def kaplan_meier(waited: SurvivalTimes) -> SurvivalCurve:
    """The Kaplan-Meier curve."""
    times, observed = np.unique(waited.times[waited.observed], return_counts=True)
    at_risk = waited.waiting(times)
    share: Values = np.cumprod(1 - observed / at_risk).astype(np.float64)
    return SurvivalCurve(times, share, at_risk)


def restricted_mean(waited: SurvivalTimes, until: float) -> float:
    """The mean time waited up to ``until``: the area under the curve."""
    found = kaplan_meier(waited)
    inside = found.times < until
    edges = np.concatenate([[0.0], found.times[inside], [until]])
    heights = np.concatenate([[1.0], found.share[inside]])
    return float(np.sum(np.diff(edges) * heights))


def compare_survival(first: SurvivalTimes, second: SurvivalTimes) -> SurvivalComparison | None:
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
        interval = compare_means(*pseudo).interval()
    never = int((~first.observed).sum()), int((~second.observed).sum())
    return SurvivalComparison(n, never, until, means, means[0] - means[1], interval, logrank_p(first, second))


def logrank_p(first: SurvivalTimes, second: SurvivalTimes) -> float:
    """The two-sided p of the log-rank test (Mantel, 1966): that both groups wait alike. NaN where nothing tells it."""
    whole = np.concatenate([first.times[first.observed], second.times[second.observed]])
    times, observed = np.unique(whole, return_counts=True)
    a, b = (waited.waiting(times).astype(np.float64) for waited in (first, second))
    n = a + b
    expected = float((a * observed / n).sum())
    several = n > 1  # with one left nothing varies
    spread = a * b * observed * (n - observed)
    variance = float((spread[several] / (n[several] ** 2 * (n[several] - 1))).sum())
    if not variance > 0:
        return math.nan
    return float(2 * special.ndtr(-abs(first.observed.sum() - expected) / math.sqrt(variance)))


def _known_until(waited: SurvivalTimes) -> float:
    """How far the curve is known: for ever where it came to the last one of all."""
    last = float(waited.times.max())
    return math.inf if waited.observed[waited.times == last].all() else last


def _pseudo(waited: SurvivalTimes, until: float) -> Values:
    n, whole = len(waited.times), restricted_mean(waited, until)
    others = np.arange(n)
    without = [
        restricted_mean(SurvivalTimes(waited.times[others != one], waited.observed[others != one]), until)
        for one in range(n)
    ]
    return n * whole - (n - 1) * np.array(without)
