import numpy as np
import pytest
from scipy import stats

from minihuman.statistics.comparison import holm_correction
from tests.counts import count
from transfer_study.job import area_under, improvement, interquartile_mean


def test_the_area_under_a_straight_rise_is_half():
    assert area_under(np.array([0.0, 500.0, 1000.0]), np.array([0.0, 0.5, 1.0])) == pytest.approx(0.5)


def test_steps_are_divided_by_the_last_one_and_the_curve_starts_at_its_first_update():
    # from 1/4 to 1, at a constant reward of 0.8
    assert area_under(np.array([50.0, 100.0, 200.0]), np.array([0.8, 0.8, 0.8])) == pytest.approx(0.8 * 0.75)


def test_updates_need_not_be_evenly_spaced():
    assert area_under(np.array([0.0, 1.0, 4.0]), np.array([0.0, 1.0, 0.0])) == pytest.approx((0.5 + 1.5) / 4)


def test_a_curve_of_one_update_is_its_reward():
    assert area_under(np.array([2048.0]), np.array([0.3])) == pytest.approx(0.3)


@pytest.mark.parametrize(("steps", "rewards"), [([], []), ([1, 2], [0.1]), ([2, 1], [0.1, 0.2]), ([1, 1], [0.1, 0.2])])
def test_a_curve_that_is_none_is_refused(steps, rewards):
    with pytest.raises(ValueError, match="growing steps"):
        area_under(np.array(steps), np.array(rewards))


def test_improvement_is_relative_to_the_baseline():
    gain = improvement(np.array([0.6, 0.6]), np.array([0.5, 0.5]))
    assert gain.mean == pytest.approx(0.2)
    assert (gain.runs, gain.baselines, gain.better) == (2, 2, 1.0)


def test_the_interval_is_welchs_of_log_areas():
    ours, base = np.array([0.5, 0.6, 0.8]), np.array([0.4, 0.7, 0.5, 0.45])
    gain = improvement(ours, base)
    a, b = np.log(ours), np.log(base)
    va, vb = a.var(ddof=1) / 3, b.var(ddof=1) / 4
    df = (va + vb) ** 2 / (va**2 / 2 + vb**2 / 3)
    half = stats.t.ppf(0.975, df) * np.sqrt(va + vb)
    middle = a.mean() - b.mean()
    assert (gain.low, gain.high) == pytest.approx((np.expm1(middle - half), np.expm1(middle + half)))
    assert gain.p == pytest.approx(2 * stats.t.sf(abs(middle) / np.sqrt(va + vb), df))


def test_the_interval_holds_the_spread_of_the_baseline_too():
    transfer, shaky = np.array([0.6, 0.6, 0.6, 0.61]), np.array([0.3, 0.7, 0.4, 0.6])
    sure, unsure = (improvement(transfer, base) for base in (np.array([0.5, 0.5, 0.5, 0.51]), shaky))
    assert sure.high - sure.low < 0.05
    assert unsure.high - unsure.low > 0.4


@pytest.mark.parametrize(("ours", "base"), [([0.6], [0.5, 0.5]), ([0.6, 0.6], [0.5]), ([0.6, 0.0], [0.5, 0.5])])
def test_one_run_or_an_area_of_nothing_has_no_interval(ours, base):
    gain = improvement(np.array(ours), np.array(base))
    assert gain.mean == pytest.approx(np.mean(ours) / np.mean(base) - 1)
    assert np.isnan([gain.low, gain.high, gain.p]).all()


@pytest.mark.long
@pytest.mark.parametrize("runs", [2, 3, 5])
def test_the_interval_holds_the_truth_as_often_as_it_says(runs):
    rng, n = np.random.default_rng(7), count(300, 2000)
    ours, base = rng.normal(0.95, 0.08, (n, runs)), rng.normal(1.0, 0.08, (n, 2 * runs))
    gains = [improvement(mine, theirs) for mine, theirs in zip(ours, base, strict=True)]
    held = sum(gain.low <= -0.05 <= gain.high for gain in gains)
    print(f"{runs} runs: the interval holds the truth in {held / n:.3f} of {n} studies")
    assert held >= fewest(n, 0.93)


@pytest.mark.long
def test_of_studies_without_any_effect_few_find_one():
    rng, n = np.random.default_rng(8), count(150, 1000)
    found = 0
    for _ in range(n):
        base = rng.normal(1.0, 0.08, 6)
        ps = holm_correction([improvement(rng.normal(1.0, 0.08, 3), base).p for _ in range(12)])
        found += min(ps) < 0.05
    print(f"{found / n:.3f} of {n} studies without any effect find one")
    assert found <= n - fewest(n, 0.95)


def test_the_mean_of_the_middle_half_leaves_out_the_odd_run():
    assert interquartile_mean(np.array([0.0, 0.5, 0.7, 9.0])) == pytest.approx(0.6)
    assert np.isnan(interquartile_mean(np.array([0.5, 0.6, 0.7])))


def fewest(n, share):
    """What a count of ``n`` tries that come out with this chance stays above in 999 of 1,000 cases."""
    return int(stats.binom.ppf(0.001, n, share))
