import numpy as np
import pytest

from minihuman.learn.transfer.curves import area_under, improvement, wilson


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


def test_improvement_is_relative_to_the_mean_baseline():
    gain = improvement(np.array([0.6, 0.8]), np.array([0.4, 0.6]), rng=np.random.default_rng(1))
    assert gain.mean == pytest.approx(0.4)
    assert gain.sd == pytest.approx(np.std([0.2, 0.6], ddof=1))
    assert gain.runs == 2


def test_the_interval_holds_the_spread_of_the_baseline_too():
    transfer, steady = np.full(10, 0.6), np.full(10, 0.5)
    shaky = np.array([0.3, 0.7] * 5)
    sure = improvement(transfer, steady, rng=np.random.default_rng(1))
    unsure = improvement(transfer, shaky, rng=np.random.default_rng(1))
    assert (sure.low, sure.high) == pytest.approx((0.2, 0.2))
    assert unsure.low < 0.05
    assert unsure.high > 0.4
    assert unsure.mean == pytest.approx(sure.mean)


def test_one_run_has_no_interval():
    gain = improvement(np.array([0.6]), np.array([0.5, 0.5]), rng=np.random.default_rng(1))
    assert gain.mean == pytest.approx(0.2)
    assert np.isnan([gain.sd, gain.low, gain.high]).all()


def test_the_bootstrap_interval_covers_a_true_improvement_about_as_often_as_it_says():
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(60):
        gain = improvement(rng.normal(0.6, 0.05, 20), rng.normal(0.5, 0.05, 20), rng=rng)
        hits += gain.low <= 0.2 <= gain.high
    assert hits >= 51


def test_wilson_agrees_with_scipy():
    from scipy.stats import binomtest

    for successes, trials in ((0, 20), (3, 20), (20, 20), (57, 100)):
        expected = binomtest(successes, trials).proportion_ci(method="wilson")
        assert wilson(successes, trials) == pytest.approx((expected.low, expected.high))


def test_nothing_tried_says_nothing():
    assert wilson(0, 0) == (0.0, 1.0)
