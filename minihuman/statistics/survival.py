"""Survival analysis of right-censored times: Kaplan-Meier curves, restricted means and the log-rank test."""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from minihuman.statistics.permutation import ALPHA, floor_freedom, smallest_p
from minihuman.statistics.regroupings import RESAMPLES, SEED, count_regroupings, draw_regroupings, has_limit
from minihuman.statistics.t_tests import Values

LEAST_EVENTS = 5  # a group, below which a restricted mean is too uncertain for an interval and a p
_TIES = 1e-9  # by so much, relative, may two equal differences come out apart
_AT_ONCE = 40_000  # values regrouped at a time: what stays in a core's cache
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SurvivalTimes:
    """Waiting times, each with a flag: True if the event was observed, False if the time is right-censored."""

    times: Values  # (n,) of any unit
    observed: Flags  # (n,)

    def __post_init__(self) -> None:
        """Check the arrays.

        Raises:
            ValueError: if times and flags are not of the same one-dimensional shape, or a time is NaN.
        """
        if self.times.shape != self.observed.shape or self.times.ndim != 1 or np.isnan(self.times).any():
            shapes = f"times has shape {self.times.shape} and observed {self.observed.shape}"
            raise ValueError(f"{shapes}; give one finite time and one observed flag per participant")

    def count_at_risk(self, at: Values) -> NDArray[np.int64]:
        """Return the number of participants at risk just before each of the times ``at``."""
        return len(self.times) - np.searchsorted(np.sort(self.times), at)


@dataclass(frozen=True, slots=True, eq=False)
class SurvivalCurve:
    """The share of participants without the event (Kaplan and Meier, 1958), at each time of an event."""

    times: Values  # (k,) rising
    share: Values  # (k,) just after
    at_risk: NDArray[np.int64]  # (k,) just before


@dataclass(frozen=True, slots=True)
class SurvivalComparison:
    """The comparison of two groups' waiting times; differences are the first group minus the second."""

    n: tuple[int, int]
    censored: tuple[int, int]  # without the event until the end of observation
    until: float  # the horizon of the restricted means: the last time at which both groups' curves are known
    means: tuple[float, float]  # restricted means
    difference: float
    interval: tuple[float, float]  # NaN below LEAST_EVENTS events in a group
    p: float  # of the difference, by permutation, as is the interval
    logrank_p: float  # by permutation


def kaplan_meier(survival_times: SurvivalTimes) -> SurvivalCurve:
    """Return the Kaplan-Meier curve of survival times."""
    times, observed = np.unique(survival_times.times[survival_times.observed], return_counts=True)
    at_risk = survival_times.count_at_risk(times)
    share: Values = np.cumprod(1 - observed / at_risk).astype(np.float64)
    return SurvivalCurve(times, share, at_risk)


def compare_survival(first: SurvivalTimes, second: SurvivalTimes) -> SurvivalComparison | None:
    """Compare two groups by restricted means and the log-rank test.

    Return None if a group has fewer than two participants.

    The interval and p of the difference come from one permutation test of the studentised difference (Horiguchi and
    Uno, 2020; Ditzhaus et al., 2023): participants are regrouped with their times, and the curves, the horizon and
    Greenwood's variance are computed anew for each regrouping. Without censoring, it is the test of |Welch's t| of the
    times truncated at the horizon.
    """
    n = (len(first.times), len(second.times))
    if min(n) < 2:
        return None
    pooled = _pool(first, second)
    own = _compare_means(pooled, _mark_first(n))
    means = (float(own.means[0][0]), float(own.means[1][0]))
    interval, p = _test_difference(pooled, n, own)
    censored = (int((~first.observed).sum()), int((~second.observed).sum()))
    return SurvivalComparison(
        n, censored, float(own.until[0]), means, means[0] - means[1], interval, p, logrank_p(first, second)
    )


def _pool(first: SurvivalTimes, second: SurvivalTimes) -> SurvivalTimes:
    """Return the times of both groups together, those of the first group first."""
    return SurvivalTimes(np.concatenate([first.times, second.times]), np.concatenate([first.observed, second.observed]))


def _mark_first(n: tuple[int, int]) -> Values:
    """Return an array of shape (1, participants) with a 1 for each participant in the first group."""
    return (np.arange(sum(n)) < n[0])[None].astype(np.float64)


def _test_difference(
    pooled: SurvivalTimes, n: tuple[int, int], own: "_RestrictedMeans"
) -> tuple[tuple[float, float], float]:
    """Return the interval and p of the difference of restricted means; ``own`` has the means of the observed groups.

    They are NaN if a group has fewer than LEAST_EVENTS events, or if no difference could reach p < 0.05.
    """
    not_tested = ((math.nan, math.nan), math.nan)
    if not own.enough[0] or not own.error[0] > 0:
        return not_tested
    differences = np.sort(_draw_differences(pooled, n))[::-1]
    extra = int(count_regroupings(*n) > RESAMPLES)  # the observed groups count as one of the random regroupings
    rank = math.ceil(ALPHA * (len(differences) + extra)) - extra
    if rank < 1 or not math.isfinite(differences[rank - 1]):
        return not_tested
    observed = float(own.standardised[0])
    critical = float(differences[rank - 1]) * (1 + _TIES)
    p = (int(np.count_nonzero(differences >= observed * (1 - _TIES))) + extra) / (len(differences) + extra)
    parts = np.array([float(part[0]) for part in own.parts])
    satterthwaite = float(parts.sum() ** 2 / (parts**2 / (n[0] - 1, n[1] - 1)).sum())
    freedom = floor_freedom(n, satterthwaite)
    if freedom:
        p = max(p, float(2 * scipy.special.stdtr(freedom, -observed)))
        critical = max(critical, float(scipy.special.stdtrit(freedom, 1 - ALPHA / 2)))
    difference = float(own.means[0][0] - own.means[1][0])
    half = critical * float(own.error[0])
    return (difference - half, difference + half), p


def _draw_differences(pooled: SurvivalTimes, n: tuple[int, int]) -> Values:
    """Return the absolute difference of restricted means in standard errors for each regrouping.

    Regroupings with fewer than LEAST_EVENTS events in a group are omitted. With many events, the differences are drawn
    from the normal distribution to which they converge.
    """
    if has_limit(*n, int(pooled.observed.sum())):
        return np.abs(np.random.default_rng(SEED).standard_normal(RESAMPLES))
    batches = [
        _compare_means(pooled, part)
        for members in draw_regroupings(*n)
        for part in np.array_split(members, members.size // _AT_ONCE + 1)
    ]
    # A study with too few events in a group is not tested, so such regroupings are left out.
    has_enough = np.concatenate([batch.enough for batch in batches])
    differences: Values = np.concatenate([batch.standardised for batch in batches])[has_enough]
    return differences


@dataclass(frozen=True, slots=True, eq=False)
class _RestrictedMeans:
    """The restricted means of two groups, for each of some regroupings."""

    until: Values  # (regroupings,)
    means: tuple[Values, Values]
    parts: tuple[Values, Values]  # squared standard errors
    enough: Flags  # (regroupings,) LEAST_EVENTS in both groups

    @property
    def error(self) -> Values:
        """Return the standard error of the difference of the two means."""
        return np.sqrt(self.parts[0] + self.parts[1])

    @property
    def standardised(self) -> Values:
        """Return the absolute difference of the two means, in standard errors."""
        difference = np.abs(self.means[0] - self.means[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(difference <= _TIES * self.until, 0.0, difference / self.error)


def _compare_means(pooled: SurvivalTimes, members: Values) -> _RestrictedMeans:
    """Compute two groups' restricted means for some regroupings.

    Args:
        pooled: the survival times of both groups
        members: an array of shape (regroupings, participants) with a 1 for each participant in the first group
    """
    times, time_index = np.unique(pooled.times, return_inverse=True)
    sum_by_time = _make_summing_matrix(time_index, len(times))
    totals = np.bincount(time_index)
    all_events = sum_by_time @ pooled.observed
    first = members.T
    ended = np.asarray(sum_by_time @ first, np.float64)
    events = np.asarray(sum_by_time @ (pooled.observed[:, None] * first), np.float64)
    groups = [_Group.follow(ended, events), _Group.follow(totals[:, None] - ended, all_events[:, None] - events)]
    until = np.minimum(np.minimum(*(group.find_known_until(times) for group in groups)), times[-1])
    width = np.diff(np.minimum(times[:, None], until), axis=0, prepend=0.0)
    is_inside = times[:, None] <= until
    enough = np.logical_and(*((group.events * is_inside).sum(axis=0) >= LEAST_EVENTS for group in groups))
    (first_mean, first_square), (second_mean, second_square) = (group.integrate(width) for group in groups)
    return _RestrictedMeans(until, (first_mean, second_mean), (first_square, second_square), enough)


def _make_summing_matrix(time_index: NDArray[np.intp], n_times: int) -> "scipy.sparse.csr_array":
    """Return a matrix of shape (times, participants) that sums the participants' values at each time.

    ``time_index`` has the index of each participant's time.
    """
    n = len(time_index)
    return scipy.sparse.csr_array((np.ones(n), (time_index, np.arange(n))), (n_times, n))


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """One group's survival curves at the times of both groups; arrays have the shape (times, regroupings)."""

    events: Values
    at_risk: Values  # just before
    share: Values  # without the event, just after

    @classmethod
    def follow(cls, ended: Values, events: Values) -> "_Group":
        """Compute the curves from the numbers of members whose times end at each time, and who have the event then."""
        at_risk = np.cumsum(ended[::-1], axis=0)[::-1]
        return cls(events, at_risk, np.cumprod(1 - events / np.maximum(at_risk, 1), axis=0).astype(np.float64))

    def find_known_until(self, times: Values) -> Values:
        """Return the time until which each curve is known; infinity where every member had the event."""
        last = np.count_nonzero(self.at_risk, axis=0) - 1
        return np.where(self.share[-1] <= _TIES, math.inf, times[last])

    def integrate(self, width: Values) -> tuple[Values, Values]:
        """Return the area under each curve and its squared standard error (Greenwood's, times n / (n - 1)).

        ``width``, of shape (times, regroupings), is the part of the time since the previous time that lies before the
        horizon.
        """
        area = width.copy()
        area[1:] *= self.share[:-1]
        area = np.cumsum(area, axis=0)
        later_area = area[-1] - area
        size = float(self.at_risk[0, 0])
        at_risk_after = self.at_risk - self.events
        variance = (later_area**2 * self.events / np.maximum(self.at_risk * at_risk_after, 1)).sum(axis=0)
        return area[-1], variance * size / (size - 1)


def logrank_p(first: SurvivalTimes, second: SurvivalTimes) -> float:
    """Return the two-sided p of the log-rank test (Mantel, 1966) of equal curves.

    Participants are regrouped with their times, and the statistic is studentised anew by its hypergeometric variance
    (Neuhaus, 1993), so that p holds in small groups, whatever their censoring. By the normal distribution, a true null
    hypothesis is rejected in 10 % of studies of 3 and 30 participants. p is NaN if the variance of the statistic is 0,
    or if no regrouping of groups of these sizes could reach p < 0.05.
    """
    n = (len(first.times), len(second.times))
    pooled = _pool(first, second)
    observed = float(compute_logrank(pooled, _mark_first(n))[0])
    if math.isnan(observed) or smallest_p(n) >= ALPHA:
        return math.nan
    if has_limit(*n, int(pooled.observed.sum())):
        return float(2 * scipy.special.ndtr(-observed))
    statistics = np.concatenate(
        [
            compute_logrank(pooled, part)
            for members in draw_regroupings(*n)
            for part in np.array_split(members, members.size // _AT_ONCE + 1)
        ]
    )
    extra = int(count_regroupings(*n) > RESAMPLES)  # the observed groups count as one of the random regroupings
    n_as_far = int(np.count_nonzero(statistics >= observed * (1 - _TIES)))
    return (n_as_far + extra) / (len(statistics) + extra)


def compute_logrank(pooled: SurvivalTimes, members: Values) -> Values:
    """Return the absolute log-rank statistic of each regrouping, in standard errors; NaN if its variance is 0.

    Args:
        pooled: the survival times of both groups
        members: an array of shape (regroupings, participants) with a 1 for each participant in the first group
    """
    times, time_index = np.unique(pooled.times, return_inverse=True)
    sum_by_time = _make_summing_matrix(time_index, len(times))
    first = members.T
    ended = np.asarray(sum_by_time @ first, np.float64)
    events = np.asarray(sum_by_time @ (pooled.observed[:, None] * first), np.float64)
    at_risk = np.cumsum(ended[::-1], axis=0)[::-1]
    all_at_risk = np.cumsum(np.bincount(time_index)[::-1])[::-1][:, None].astype(np.float64)
    all_events = (sum_by_time @ pooled.observed)[:, None]
    excess = (events - all_events * at_risk / all_at_risk).sum(axis=0)
    spread = all_events * at_risk * (all_at_risk - at_risk) * (all_at_risk - all_events)
    variance = (spread / np.maximum(all_at_risk**2 * (all_at_risk - 1), 1)).sum(axis=0)  # 0 / 1 with one at risk
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(variance > _TIES, np.abs(excess) / np.sqrt(variance), math.nan)
