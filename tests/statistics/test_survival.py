from itertools import combinations

import numpy as np
import pytest
import scipy

from minihuman.statistics.permutation import permutation_tests
from minihuman.statistics.survival import SurvivalTimes, compare_survival, compute_logrank, kaplan_meier, logrank_p
from tests.counts import count


def restricted_mean(waited, until):
    """The mean time waited up to ``until``: the area under the curve."""
    found = kaplan_meier(waited)
    inside = found.times < until
    edges = np.concatenate([[0.0], found.times[inside], [until]])
    heights = np.concatenate([[1.0], found.share[inside]])
    return float(np.sum(np.diff(edges) * heights))


def watched(times, until):
    times = np.asarray(times, float)
    return SurvivalTimes(np.minimum(times, until), times <= until)


def test_the_curve_is_scipys():
    rng = np.random.default_rng(1)
    waited = SurvivalTimes(rng.integers(1, 9, 30).astype(float), rng.random(30) < 0.6)
    peer = scipy.stats.ecdf(
        scipy.stats.CensoredData(uncensored=waited.times[waited.observed], right=waited.times[~waited.observed])
    ).sf
    found = kaplan_meier(waited)
    assert found.share == pytest.approx(peer.evaluate(found.times))
    assert list(found.at_risk) == [(waited.times >= time).sum() for time in found.times]


@pytest.mark.parametrize("last", [6, 60], ids=["many at once", "few at once"])
def test_the_log_rank_statistic_is_scipys(last):
    rng = np.random.default_rng(last)
    for sizes in rng.integers(2, 30, (50, 2)):
        both = [SurvivalTimes(np.minimum(rng.integers(1, last, n), 40.0), rng.random(n) < 0.7) for n in sizes]
        peers = [
            scipy.stats.CensoredData(uncensored=one.times[one.observed], right=one.times[~one.observed]) for one in both
        ]
        pooled = SurvivalTimes(
            *(np.concatenate([getattr(one, name) for one in both]) for name in ("times", "observed"))
        )
        own = (np.arange(sum(sizes)) < sizes[0])[None].astype(float)
        p = float(2 * scipy.special.ndtr(-compute_logrank(pooled, own)[0]))
        assert p == pytest.approx(float(scipy.stats.logrank(*peers).pvalue), abs=1e-14, nan_ok=True)


def test_the_log_rank_p_is_the_share_of_regroupings_that_are_as_far_apart():
    times = np.array([3.0, 8, 13, 20, 34, 50, 21, 29, 31, 40])
    both = SurvivalTimes(times, ~np.isin(times, (34, 40)))

    def split(first):
        rest = np.setdiff1d(np.arange(10), first)
        return [SurvivalTimes(both.times[part], both.observed[part]) for part in (np.array(first), rest)]

    def statistic(first):
        peers = [
            scipy.stats.CensoredData(uncensored=one.times[one.observed], right=one.times[~one.observed])
            for one in split(first)
        ]
        return abs(float(scipy.stats.logrank(*peers).statistic))

    apart = np.array([statistic(first) for first in combinations(range(10), 4)])
    assert logrank_p(*split(range(4))) == pytest.approx(np.mean(apart >= statistic(range(4)) * (1 - 1e-9)))


def test_a_log_rank_p_that_no_regrouping_could_bring_below_5_percent_is_not_told():
    assert np.isnan(logrank_p(watched([1, 2, 3], 30.0), watched([17, 18, 19], 30.0)))


@pytest.mark.nightly(sample=True)
def test_the_log_rank_test_of_three_and_thirty_rejects_no_true_null_too_often():
    """By the normal distribution, it is 0.09."""
    rejected, studies, rng = 0, count(100, 3000), np.random.default_rng(13)
    for _ in range(studies):
        times, stopped = rng.exponential(40, 33), rng.exponential(160, 33)
        waited = [
            SurvivalTimes(np.minimum(times, stopped)[part], (times <= stopped)[part])
            for part in (slice(3), slice(3, None))
        ]
        rejected += logrank_p(*waited) < 0.05
    print(f"3 v 30 waits, 20 % censored at random: log-rank p < 0.05 in {rejected / studies:.3f} of {studies}")
    assert scipy.stats.binomtest(rejected, studies, 0.06, alternative="greater").pvalue > 0.01


def test_a_log_rank_p_of_nobody_to_whom_it_came_is_not_told():
    assert np.isnan(logrank_p(watched([50, 60], 30.0), watched([70, 80], 30.0)))


def test_watched_to_the_end_the_restricted_mean_is_that_of_the_times_cut_there():
    times = np.array([3.0, 8.0, 20.0, 50.0])
    assert restricted_mean(watched(times, 30.0), 30.0) == pytest.approx(np.minimum(times, 30).mean())


def test_watched_to_the_end_the_test_is_that_of_the_times_cut_there():
    a, b = np.array([3.0, 8.0, 20.0, 50.0, 11.0, 2.0]), np.array([5.0, 31.0, 32.0, 40.0, 12.0, 29.0, 28.0, 27.0])
    found = compare_survival(watched(a, 30.0), watched(b, 30.0))
    (test,) = permutation_tests([(np.minimum(a, 30), np.minimum(b, 30))])
    assert found.p == pytest.approx(test.p())
    assert found.interval == pytest.approx(test.interval(), abs=0.05)
    assert np.mean(found.interval) == pytest.approx(test.difference)
    assert (found.n, found.censored, found.until) == ((6, 8), (1, 3), 30.0)


def studentised(a, b):
    """The difference of restricted means in standard errors, by Greenwood's sum."""
    ends = [np.inf if one.observed[one.times == one.times.max()].all() else one.times.max() for one in (a, b)]
    until = min(*ends, max(a.times.max(), b.times.max()))
    square = 0.0
    for one in (a, b):
        n, whole = len(one.times), restricted_mean(one, until)
        for time in np.unique(one.times[one.observed & (one.times <= until)]):
            at_risk, came = (one.times >= time).sum(), (one.observed & (one.times == time)).sum()
            if at_risk > came:
                rest = whole - restricted_mean(one, time)
                square += rest**2 * came / (at_risk * (at_risk - came)) * n / (n - 1)
    enough = all((one.observed & (one.times <= until)).sum() >= 5 for one in (a, b))
    return abs(restricted_mean(a, until) - restricted_mean(b, until)) / np.sqrt(square), enough


def test_of_censored_times_p_is_the_share_of_regroupings_not_refused_that_are_as_far_apart():
    times = np.array([3.0, 8, 13, 20, 34, 50, 21, 29, 31, 40, 57, 90])
    both = SurvivalTimes(times, ~np.isin(times, (34, 57)))

    def split(first):
        rest = np.setdiff1d(np.arange(12), first)
        return [SurvivalTimes(both.times[part], both.observed[part]) for part in (np.array(first), rest)]

    own, enough = studentised(*split(range(6)))
    assert enough
    apart = [value for value, enough in (studentised(*split(one)) for one in combinations(range(12), 6)) if enough]
    found = compare_survival(*split(range(6)))
    assert found.p == pytest.approx(np.mean(np.array(apart) >= own * (1 - 1e-9)))
    assert (found.p < 0.05) == (found.interval[0] > 0 or found.interval[1] < 0)


@pytest.mark.nightly
def test_of_waits_censored_at_random_a_true_null_is_seldom_rejected():
    rejected, studies, rng = 0, count(300, 3000), np.random.default_rng(12)
    for _ in range(studies):
        pair = []
        for n in (10, 20):
            times, stopped = rng.exponential(40, n), rng.exponential(93, n)
            pair.append(SurvivalTimes(np.minimum(times, stopped), times <= stopped))
        rejected += compare_survival(*pair).p < 0.05
    print(f"10 v 20 waits, 30 % censored at random: p < 0.05 in {rejected / studies:.3f} of {studies}")
    assert scipy.stats.binomtest(rejected, studies, 0.065, alternative="greater").pvalue > 0.01


def test_below_five_events_in_a_group_a_restricted_mean_has_no_interval_and_no_p():
    found = compare_survival(watched([3, 8, 20, 25, 50, 60], 30.0), watched(np.arange(1.0, 19.0), 30.0))
    assert found.difference > 0
    assert np.isnan([found.p, *found.interval]).all()
    assert found.logrank_p < 0.05


def test_it_never_came_to_anybody():
    found = compare_survival(watched([50, 60], 30.0), watched([70, 80], 30.0))
    assert found.difference == 0
    assert np.isnan([found.p, *found.interval]).all()


def test_one_person_is_no_group():
    assert compare_survival(watched([50.0], 30.0), watched([70, 80], 30.0)) is None


@pytest.mark.parametrize("bad", [([1.0, 2.0], [True]), ([np.nan], [True])])
def test_times_without_an_end_are_refused(bad):
    with pytest.raises(ValueError, match="one finite time and one observed flag"):
        SurvivalTimes(np.array(bad[0]), np.array(bad[1]))


@pytest.mark.nightly(sample=True)
def test_with_half_never_found_the_interval_holds_the_truth():
    """Exponential times of means 40 and 80 s, watched for 60 s: 22 and 47 % never find; 20 a group."""
    rng, studies, until = np.random.default_rng(9), count(80, 1000), 60.0
    truth = [mean * (1 - np.exp(-until / mean)) for mean in (40.0, 80.0)]
    held = 0
    for _ in range(studies):
        found = compare_survival(*(watched(rng.exponential(mean, 20), until) for mean in (40.0, 80.0)))
        held += found.interval[0] <= truth[0] - truth[1] <= found.interval[1]
    print(f"the interval of the restricted mean holds the truth in {held / studies:.3f} of {studies} studies")
    assert scipy.stats.binomtest(held, studies, 0.93, alternative="less").pvalue > 0.01


@pytest.mark.nightly(sample=True)
def test_with_uneven_watching_too():
    rng, studies = np.random.default_rng(10), count(40, 600)
    held = 0
    for _ in range(studies):
        pair = []
        for mean in (40.0, 80.0):
            times, stopped = rng.exponential(mean, 20), rng.uniform(30, 90, 20)
            pair.append(SurvivalTimes(np.minimum(times, stopped), times <= stopped))
        found = compare_survival(*pair)
        truth = [mean * (1 - np.exp(-found.until / mean)) for mean in (40.0, 80.0)]
        held += found.interval[0] <= truth[0] - truth[1] <= found.interval[1]
    print(f"unevenly watched: {held / studies:.3f} of {studies}")
    assert scipy.stats.binomtest(held, studies, 0.92, alternative="less").pvalue > 0.01
