import numpy as np
import pytest
from scipy import stats

from minihuman.statistics.survival import SurvivalTimes, compare_survival, kaplan_meier, logrank_p, restricted_mean
from tests.counts import count


def watched(times, until):
    times = np.asarray(times, float)
    return SurvivalTimes(np.minimum(times, until), times <= until)


def test_the_curve_is_scipys():
    rng = np.random.default_rng(1)
    waited = SurvivalTimes(rng.integers(1, 9, 30).astype(float), rng.random(30) < 0.6)
    peer = stats.ecdf(
        stats.CensoredData(uncensored=waited.times[waited.observed], right=waited.times[~waited.observed])
    ).sf
    found = kaplan_meier(waited)
    assert found.share == pytest.approx(peer.evaluate(found.times))
    assert list(found.at_risk) == [(waited.times >= time).sum() for time in found.times]


@pytest.mark.parametrize("last", [6, 60], ids=["many at once", "few at once"])
def test_the_log_rank_p_is_scipys(last):
    rng = np.random.default_rng(last)
    for sizes in rng.integers(2, 30, (50, 2)):
        both = [SurvivalTimes(np.minimum(rng.integers(1, last, n), 40.0), rng.random(n) < 0.7) for n in sizes]
        peers = [stats.CensoredData(uncensored=one.times[one.observed], right=one.times[~one.observed]) for one in both]
        assert logrank_p(*both) == pytest.approx(float(stats.logrank(*peers).pvalue), abs=1e-14, nan_ok=True)


def test_a_log_rank_p_of_nobody_to_whom_it_came_is_not_told():
    assert np.isnan(logrank_p(watched([50, 60], 30.0), watched([70, 80], 30.0)))


def test_watched_to_the_end_the_restricted_mean_is_that_of_the_times_cut_there():
    times = np.array([3.0, 8.0, 20.0, 50.0])
    assert restricted_mean(watched(times, 30.0), 30.0) == pytest.approx(np.minimum(times, 30).mean())


def test_watched_to_the_end_the_interval_is_welchs():
    a, b = np.array([3.0, 8.0, 20.0, 50.0]), np.array([5.0, 31.0, 32.0, 40.0, 12.0])
    found = compare_survival(watched(a, 30.0), watched(b, 30.0))
    peer = stats.ttest_ind(np.minimum(a, 30), np.minimum(b, 30), equal_var=False)
    assert found.interval == pytest.approx(tuple(peer.confidence_interval(0.95)))
    assert (found.n, found.never, found.until) == ((4, 5), (1, 3), 30.0)


def test_it_never_came_to_anybody():
    found = compare_survival(watched([50, 60], 30.0), watched([70, 80], 30.0))
    assert found.difference == 0
    assert np.isnan([found.p, *found.interval]).all()


def test_one_person_is_no_group():
    assert compare_survival(watched([50.0], 30.0), watched([70, 80], 30.0)) is None


@pytest.mark.parametrize("bad", [([1.0, 2.0], [True]), ([np.nan], [True])])
def test_times_without_an_end_are_refused(bad):
    with pytest.raises(ValueError, match="one finite time and one flag"):
        SurvivalTimes(np.array(bad[0]), np.array(bad[1]))


@pytest.mark.long
def test_with_half_never_found_the_interval_holds_the_truth():
    """Exponential times of means 40 and 80 s, watched for 60 s: 22 and 47 % never find; 20 a group."""
    rng, studies, until = np.random.default_rng(9), count(80, 1000), 60.0
    truth = [mean * (1 - np.exp(-until / mean)) for mean in (40.0, 80.0)]
    held = 0
    for _ in range(studies):
        found = compare_survival(*(watched(rng.exponential(mean, 20), until) for mean in (40.0, 80.0)))
        held += found.interval[0] <= truth[0] - truth[1] <= found.interval[1]
    print(f"the interval of the restricted mean holds the truth in {held / studies:.3f} of {studies} studies")
    assert stats.binomtest(held, studies, 0.93, alternative="less").pvalue > 0.01


@pytest.mark.long
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
    assert stats.binomtest(held, studies, 0.92, alternative="less").pvalue > 0.01
