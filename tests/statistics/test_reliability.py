"""Reliability: the published example, other people's numbers, and how often intervals hold."""

import numpy as np
import pandas as pd
import pytest

from minihuman.statistics.reliability import estimate_reliability
from tests.counts import count

# Shrout and Fleiss (1979), table 2: six targets, four judges
SHROUT = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]


def as_rows(values, groups=None):
    """Rows of a list of values for each participant, in order of play."""
    return pd.DataFrame(
        [
            {"group": groups[who] if groups else "all", "participant": str(who), "value": float(value)}
            for who, each in enumerate(values)
            for value in each
        ],
        columns=["group", "participant", "value"],
    )


def test_the_published_example() -> None:
    found = estimate_reliability("it", as_rows(SHROUT))
    assert (found.participants, found.episodes) == (6, 24)
    assert found.icc == pytest.approx(0.166, abs=5e-4)  # theirs: .17
    assert found.icc_interval == pytest.approx((-0.133, 0.723), abs=5e-4)  # of the R package psych
    odd, even = np.array(SHROUT)[:, ::2].mean(axis=1), np.array(SHROUT)[:, 1::2].mean(axis=1)
    r = np.corrcoef(odd, even)[0, 1]
    assert found.halves == pytest.approx(2 * r / (1 + r))


def test_a_difference_between_groups_is_no_reliability() -> None:
    apart = [[value + 100 * (who % 2) for value in each] for who, each in enumerate(SHROUT)]
    groups = ["a", "b"] * 3
    one, other = (estimate_reliability("it", as_rows(each, groups)) for each in (SHROUT, apart))
    assert one.icc == pytest.approx(other.icc)
    assert one.halves == pytest.approx(other.halves)


def test_what_cannot_be_estimated() -> None:
    assert estimate_reliability("it", as_rows(SHROUT[:3])) is None
    assert estimate_reliability("it", as_rows([[0.1] * 4] * 6)) is None
    assert estimate_reliability("it", as_rows([each[:1] for each in SHROUT])) is None
    assert estimate_reliability("it", as_rows([])) is None
    assert estimate_reliability("it", as_rows([*SHROUT, [3]])).participants == 6


@pytest.mark.parametrize(("truth", "people", "episodes"), [(0.3, 12, (3, 9)), (0.6, 30, (8, 8))])
def test_intervals_hold(truth: float, people: int, episodes: tuple[int, int]) -> None:
    rng = np.random.default_rng(7)
    held = []
    for _ in range(count(100, 4_000)):
        sizes = rng.integers(episodes[0], episodes[1] + 1, people)
        values = [rng.normal(rng.normal(0, truth**0.5), (1 - truth) ** 0.5, size) for size in sizes]
        found = estimate_reliability("it", as_rows(values))
        held.append(found.icc_interval[0] <= truth <= found.icc_interval[1])
    slack = 3 * (0.05 * 0.95 / len(held)) ** 0.5
    assert 0.95 - slack <= np.mean(held) <= 0.95 + slack
