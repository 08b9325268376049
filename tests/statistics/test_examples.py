import numpy as np
import pytest
from scipy import stats

from minihuman.statistics.examples import learn
from tests.counts import count


def drawn(rng, n):
    """A target that the first of three numbers tells in part."""
    numbers = rng.normal(0, 1, (n, 3))
    return numbers, 2 + 1.5 * numbers[:, 0] + 0.5 * numbers[:, 1] ** 2 + rng.normal(0, 1, n)


def test_what_is_told_is_learnt_and_what_is_not_is_not():
    rng = np.random.default_rng(1)
    numbers, target = drawn(rng, 400)
    assert learn(numbers, target).told == pytest.approx(1 - 1 / (1 + 2.25 + 0.5), abs=0.08)
    assert learn(numbers, rng.normal(0, 1, 400)).told < 0.05


@pytest.mark.long
def test_intervals_hold_what_was_not_among_the_examples():
    rng, hits, studies = np.random.default_rng(2), 0, count(60, 2000)
    for _ in range(studies):
        numbers, target = drawn(rng, 80)
        one, truth = drawn(rng, 1)
        learnt = learn(numbers, target)
        low, high = learnt.interval(float(learnt.predict(one)[0]))
        hits += low <= truth[0] <= high
    print(f"{hits / studies:.3f} of {studies} intervals hold the truth")  # shown by pytest -s
    assert stats.binomtest(hits, studies, 0.95).pvalue > 0.001


def test_a_handful_of_examples_is_refused():
    with pytest.raises(ValueError, match="ten are the least"):
        learn(np.zeros((5, 2)), np.zeros(5))
