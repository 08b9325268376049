import math

import numpy as np
import pandas as pd
import pytest

from minihuman.errors import ReportError
from minihuman.planning.power import MEASURES, Effect, compute_values, parse_group_sizes, power_curve
from minihuman.statistics.t_tests import t_test_power
from tests.counts import count

POOL = 4_000  # people: so many that drawing from them is drawing from the normal distribution


def normal(mean, seed):
    return np.random.default_rng(seed).normal(mean, 1.0, POOL)


@pytest.mark.nightly(sample=True)
def test_without_an_effect_studies_find_one_as_rarely_as_they_should():
    people, studies = normal(0.0, 1), count(40, 2000)
    (found,) = power_curve("reward", people, people, [15], studies=studies, seed=2)
    print(f"without an effect: {found.power:.3f} of {studies} studies")
    assert found.low <= 0.06
    assert found.high >= 0.04


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("size", [10, 26])
def test_power_for_normal_people_is_the_textbooks(size):
    studies = count(40, 2000)
    treated, untreated = normal(0.8, 3), normal(0.0, 4)
    d = (treated.mean() - untreated.mean()) / math.sqrt((treated.var() + untreated.var()) / 2)
    (found,) = power_curve("reward", treated, untreated, [size], studies=studies, seed=5)
    expected = t_test_power(d, (size, size))
    print(f"{size} a group: {found.power:.3f}, textbook {expected:.3f}")
    assert found.low - 0.03 <= expected <= found.high + 0.03


def episodes(**columns):
    rows = {"participant": ["a", "a", "b"], "outcome": ["goal", "timeout", "goal"], "reward": [0.9, 0.0, 0.8]}
    return pd.DataFrame(
        rows | {"steps": [50, 100, 100], "max_steps": [100] * 3, "feasible_steps": [30.0] * 3} | columns
    )


def test_an_effect_shortens_what_is_over_the_best_way_and_nothing_else():
    changed = Effect(excess=0.5).of(episodes())
    assert changed["steps"].tolist() == [40, 100, 65]
    assert changed["reward"].tolist() == pytest.approx([1 - 0.1 * 40 / 50, 0.0, 1 - 0.2 * 65 / 100])
    assert Effect().of(episodes()).equals(episodes())


def test_a_persons_value_is_the_mean_over_episodes_time_outs_at_the_limit():
    values = compute_values(episodes(), "log_excess_steps")
    assert values.tolist() == pytest.approx([(math.log(21) + math.log(71)) / 2, math.log(71)])
    ratios = compute_values(episodes(), "log_steps_ratio")
    assert ratios.tolist() == pytest.approx([(math.log(5 / 3) + math.log(10 / 3)) / 2, math.log(10 / 3)])
    assert compute_values(episodes(), "success").tolist() == [0.5, 1.0]
    assert compute_values(episodes(), "steps_at_limit").tolist() == [75, 100]


def test_a_world_whose_best_way_nobody_knows_has_no_excess():
    with pytest.raises(ReportError, match=r"only 0 simulated participants have a value for spl"):
        compute_values(episodes(feasible_steps=[np.nan] * 3), "spl")


@pytest.mark.parametrize("text", ["excess", "excess=-1", "reward=0.7", "excess=much", ""])
def test_an_effect_that_is_none_is_refused(text):
    with pytest.raises(ReportError, match=r"excess=0\.7 for 30 %"):
        Effect.parse(text)


def test_what_effects_and_sizes_are_read_as():
    assert Effect.parse("excess=0.7") == Effect(0.7)
    assert Effect.parse("none") == Effect()
    assert parse_group_sizes("10,20") == (10, 20)
    for text in ("", "1,2", "ten"):
        with pytest.raises(ReportError, match="--groups"):
            parse_group_sizes(text)


def test_a_measure_that_is_none_is_refused():
    with pytest.raises(ReportError, match=", ".join(MEASURES)):
        compute_values(episodes(), "speed")
