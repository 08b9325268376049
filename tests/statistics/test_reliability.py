"""Reliability: the published example, other people's numbers, and how often intervals hold."""

import numpy as np
import pandas as pd
import pytest

from minihuman.statistics import reliability
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


def test_without_a_participant_f_is_that_of_the_others() -> None:
    """The jackknife's closed form, of groups that differ in size and participants in episodes."""
    rng = np.random.default_rng(4)
    values = [rng.normal(size=size) for size in (2, 5, 3, 4, 6, 3, 2, 7, 4)]
    groups = [*"aaaabbbb", "c"]
    people = reliability._Participants.describe(as_rows(values, groups))
    ratio = reliability._VarianceRatio.compute(people)
    for person in range(9):
        rest = [place for place in range(9) if place != person]
        others = as_rows([values[place] for place in rest], [groups[place] for place in rest])
        other_ratio = reliability._VarianceRatio.compute(reliability._Participants.describe(others))
        f = 1 + (other_ratio.across / other_ratio.inside - 1) * ratio.length / other_ratio.length
        assert ratio.logs[person] == pytest.approx(np.log(max(f, 1e-12)))


def test_fewer_than_four_in_a_group_have_no_interval() -> None:
    found = estimate_reliability("it", as_rows(SHROUT, [*"aabbbb"]))
    assert np.isnan([*found.icc_interval, *found.halves_interval]).all()
    assert found.note == "2 in the smallest group: intervals need 4 participants per group"


def test_of_skewed_values_the_page_says_that_intervals_may_be_too_narrow() -> None:
    found = estimate_reliability("it", as_rows([*SHROUT, [90, 95, 92, 91]]))
    assert "skewed" in found.note
    assert not estimate_reliability("it", as_rows(SHROUT)).note


@pytest.mark.parametrize(
    ("sizes", "spreads", "episodes"),
    [((12,), (0.65,), (3, 9)), ((30,), (1.2,), (8, 8)), ((8, 24), (3.0, 1.0), (8, 8)), ((10, 10), (3.0, 1.0), (4, 8))],
)
@pytest.mark.nightly(sample=True)
def test_intervals_hold(sizes: tuple[int, ...], spreads: tuple[float, ...], episodes: tuple[int, int]) -> None:
    """Where groups vary equally, and where they do not: by F with all degrees of freedom 0.85 in the third study."""
    rng = np.random.default_rng(7)
    studies = count(60, 2_000)
    free = np.array(sizes) - 1
    variance = float(free @ np.square(spreads)) / free.sum()
    truth = variance / (variance + 1)
    groups = [group for group, size in zip("ab", sizes, strict=False) for _ in range(size)]
    held = []
    for _ in range(studies):
        own = np.concatenate([rng.normal(0, spread, size) for size, spread in zip(sizes, spreads, strict=True)])
        values = [rng.normal(level, 1, rng.integers(episodes[0], episodes[1] + 1)) for level in own]
        found = estimate_reliability("it", as_rows(values, groups))
        held.append(found.icc_interval[0] <= truth <= found.icc_interval[1])
    print(f"ICC of {sizes}, SDs {spreads}: the interval holds the truth in {np.mean(held):.3f} of {studies}")
    slack = 3 * (0.05 * 0.95 / studies) ** 0.5
    assert 0.935 - slack <= np.mean(held) <= 0.98 + slack
