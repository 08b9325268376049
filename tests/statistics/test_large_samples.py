"""Of more than LARGEST_REGROUPED people the limit of the regroupings is drawn: the same p and intervals, sooner."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from minihuman.statistics import regroupings
from minihuman.statistics.permutation import adjust_groups, permutation_tests
from minihuman.statistics.regroupings import LARGEST_REGROUPED, RESAMPLES, count_regroupings, has_limit
from minihuman.statistics.survival import SurvivalTimes, compare_survival
from minihuman.statistics.two_part_model import two_parts_p

N, M = 700, 500  # regrouped in full, and by the limit where it is made to begin below them
TOLERANCE = 0.02  # three standard deviations of the difference of two p from 10,000 draws each
Values = NDArray[np.float64]


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], list[object]]:
    """What a function gives with regroupings and with their limit."""

    def run(work: Callable[[], object]) -> list[object]:
        assert N + M < LARGEST_REGROUPED
        found = [work()]
        monkeypatch.setattr(regroupings, "LARGEST_REGROUPED", N)
        return [*found, work()]

    return run


def groups(shift: float, seed: int) -> tuple[Values, Values]:
    """Skewed values of two groups of different spread."""
    rng = np.random.default_rng(seed)
    return rng.gamma(2.0, 1.0, N) + shift, rng.gamma(2.0, 1.4, M)


@pytest.mark.parametrize("shift", [0.5, 0.6, 0.7])
def test_means(both: Callable[[Callable[[], object]], list[object]], shift: float) -> None:
    def work() -> object:
        (test,) = permutation_tests([groups(shift, 3)])
        assert test is not None
        return test.p(), *test.interval()

    regrouped, limit = both(work)
    assert limit == pytest.approx(regrouped, abs=TOLERANCE)
    assert limit != regrouped


@pytest.mark.parametrize("share", [0.8, 0.84])
def test_two_parts(both: Callable[[Callable[[], object]], list[object]], share: float) -> None:
    rng = np.random.default_rng(5)
    people = [
        np.column_stack(
            [rng.beta(of * 20, (1 - of) * 20, n), np.where(rng.random(n) < 0.9, rng.normal(0.9, 0.1, n), np.nan)]
        )
        for n, of in ((N, share), (M, 0.83))
    ]
    regrouped, limit = both(lambda: two_parts_p(people[0], people[1]))
    assert limit == pytest.approx(regrouped, abs=TOLERANCE)


@pytest.mark.parametrize("scale", [1.0, 1.15])
def test_waits(both: Callable[[Callable[[], object]], list[object]], scale: float) -> None:
    rng = np.random.default_rng(6)
    waits = [SurvivalTimes(rng.exponential(by, n).round(2), rng.random(n) < 0.8) for n, by in ((N, scale), (M, 1.0))]

    def work() -> object:
        found = compare_survival(waits[0], waits[1])
        assert found is not None
        return found.p, *found.interval

    regrouped, limit = both(work)
    assert limit == pytest.approx(regrouped, abs=TOLERANCE)


def test_adjusted_means(both: Callable[[Callable[[], object]], list[object]]) -> None:
    rng = np.random.default_rng(7)
    sides = [(rng.normal(mean, 1.0, n), rng.normal(0, 1, (n, 2))) for n, mean in ((N, 0.1), (M, 0.0))]

    def work() -> object:
        found = adjust_groups(sides[0], sides[1])
        assert found is not None
        return found[2].p(), *found[2].interval()

    regrouped, limit = both(work)
    assert limit == pytest.approx(regrouped, abs=TOLERANCE)


def test_a_small_group_beside_a_large_one_and_few_values_are_regrouped() -> None:
    assert has_limit(3_000, 3_000, 6_000)
    assert not has_limit(20, 6_000, 6_020), "the mean of 20 skewed values is not normal"
    assert not has_limit(3_000, 3_000, 40), "40 events tell little, however many people were watched"


def test_a_hundred_thousand_people_are_compared() -> None:
    rng = np.random.default_rng(8)
    (test,) = permutation_tests([(rng.normal(0.02, 1, 50_000), rng.normal(0, 1, 50_000))])
    assert test is not None
    low, high = test.interval()
    assert low < test.difference < high
    assert high - low == pytest.approx(2 * 1.96 * np.sqrt(2 / 50_000), rel=0.03)


@pytest.mark.parametrize(
    ("n", "m"), [(3, 3), (3, 36), (3, 37), (3, 40), (2, 200), (1, 9_999), (4, 27), (8, 8), (8, 9), (15, 15)]
)
def test_regroupings_are_counted_where_they_can_all_be_gone_through(n: int, m: int) -> None:
    from scipy import special

    exact = special.comb(n + m, n, exact=True)
    assert (count_regroupings(n, m) <= RESAMPLES) == (exact <= RESAMPLES)
    assert exact > RESAMPLES or count_regroupings(n, m) == exact
