import numpy as np
import pytest
import scipy

from minihuman.statistics.equivalence import check_equivalence
from tests.counts import count


def test_it_agrees_with_two_one_sided_t_tests_of_large_groups():
    from statsmodels.stats.weightstats import ttost_ind

    rng = np.random.default_rng(2)
    a, b = rng.normal(0, 1, 60), rng.normal(0.1, 2, 40)
    test = check_equivalence(a, b, (-0.8, 0.8))
    assert test.p == pytest.approx(ttost_ind(a, b, -0.8, 0.8, usevar="unequal")[0], abs=0.01)
    assert test.alike == (test.interval[0] > -0.8 and test.interval[1] < 0.8)


def test_the_interval_lies_within_the_margin_exactly_where_groups_are_called_equivalent():
    rng = np.random.default_rng(3)
    for number in range(12):
        a, b = rng.normal(0.3, 2, 6 + number), rng.normal(0, 1, 12)
        test = check_equivalence(a, b, (-1.2, 1.2))
        assert test.alike == (test.interval[0] > -1.2 and test.interval[1] < 1.2)


def test_too_few_people_are_not_tested_and_the_reason_says_how_many_it_takes():
    test = check_equivalence(np.array([0.1, 0.2]), np.linspace(0, 0.3, 18), (-0.5, 0.5))
    assert np.isnan(test.p)
    assert not test.alike
    assert "needs 4 participants in each group" in test.reason


def test_two_large_groups_are_shown_to_be_alike_and_two_small_ones_are_not():
    rng = np.random.default_rng(4)
    draw = [rng.normal(0, 1, n) for n in (900, 900, 6, 6)]
    assert check_equivalence(draw[0], draw[1], (-0.3, 0.3)).alike
    assert not check_equivalence(draw[2], draw[3], (-0.3, 0.3)).alike


def test_bounds_lie_around_zero():
    with pytest.raises(ValueError, match="the lower equivalence bound must be below 0 and the upper one above 0"):
        check_equivalence(np.zeros(3), np.ones(3), (0.1, 0.3))


@pytest.mark.nightly
def test_a_difference_on_the_bound_is_called_alike_as_rarely_as_it_should_be():
    rng, studies = np.random.default_rng(6), count(200, 2000)
    alike = sum(
        check_equivalence(rng.normal(0.5, 1, 25), rng.normal(0, 1, 25), (-0.5, 0.5)).alike for _ in range(studies)
    )
    assert scipy.stats.binomtest(alike, studies, 0.05, alternative="greater").pvalue > 0.001
