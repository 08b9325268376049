import numpy as np
import pytest
import scipy

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
    assert (gain.runs, gain.better) == (2, 1.0)


def test_the_interval_is_students_of_paired_log_ratios():
    ours, base = np.array([0.5, 0.6, 0.8]), np.array([0.4, 0.7, 0.5])
    gain = improvement(ours, base)
    expected = scipy.stats.ttest_rel(np.log(ours), np.log(base)).confidence_interval(0.95)
    assert (gain.low, gain.high) == pytest.approx((np.expm1(expected.low), np.expm1(expected.high)))


def test_what_a_run_shares_with_its_baseline_is_taken_off():
    base = np.array([0.3, 0.5, 0.9, 0.6])
    gain = improvement(base * np.array([1.1, 1.11, 1.1, 1.09]), base)
    assert gain.mean == pytest.approx(0.1, abs=1e-3)
    assert gain.high - gain.low < 0.05


@pytest.mark.parametrize(("ours", "base"), [([0.6], [0.5]), ([0.6, 0.7], [0.5, 0.5]), ([0.6, 0.0], [0.5, 0.5])])
def test_fewer_than_three_runs_or_an_area_of_nothing_have_no_interval(ours, base):
    gain = improvement(np.array(ours), np.array(base))
    assert np.isnan([gain.low, gain.high]).all()


def test_p_is_exact_and_three_runs_cannot_tell():
    three = improvement(np.array([0.6, 0.7, 0.8]), np.array([0.5, 0.5, 0.5]))
    assert three.p == three.smallest_p == 0.25
    base = np.linspace(0.5, 0.6, 7)
    seven = improvement(base * np.linspace(1.1, 1.2, 7), base)
    assert seven.p == pytest.approx(2 / 2**7)


def test_two_kinds_of_runs_do_not_reject_a_true_null_too_often():
    rng, rejected = np.random.default_rng(7), 0
    for _ in range(400):  # of Welch's test of log areas 0.24 did at 3 against 6
        ours, base = (np.where(rng.random(8) < 3 / 8, 0.87, 0.62) + rng.normal(0, 0.01, 8) for _ in range(2))
        rejected += improvement(ours, base).p < 0.05
    assert rejected <= int(scipy.stats.binom.ppf(0.999, 400, 0.05))


def test_the_mean_of_the_middle_half_leaves_out_the_odd_run():
    assert interquartile_mean(np.array([0.0, 0.5, 0.7, 9.0])) == pytest.approx(0.6)
    assert np.isnan(interquartile_mean(np.array([0.5, 0.6, 0.7])))
