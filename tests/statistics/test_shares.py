import pytest

from minihuman.statistics.scores import wilson_interval


def test_wilson_agrees_with_scipy():
    from scipy.stats import binomtest

    for successes, trials in ((0, 20), (3, 20), (20, 20), (57, 100)):
        expected = binomtest(successes, trials).proportion_ci(method="wilson")
        assert wilson_interval(successes, trials) == pytest.approx((expected.low, expected.high))


def test_nothing_tried_says_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)
