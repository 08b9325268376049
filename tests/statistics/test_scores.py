"""Scores on simulated truth: the crossed bootstrap's intervals hold it, and say when nothing can be told apart."""

import os

import numpy as np
import pytest

from minihuman.statistics.scores import Runs, _estimate, _excludes, score_player

REPLICATIONS = 2_000 if os.environ.get("MINIHUMAN_NIGHTLY") else 150
LIMIT, FEWEST = 60.0, 10.0


def play(rng: np.random.Generator, runs: int, levels: np.ndarray, skill: float, spread: float) -> Runs:
    """Runs whose skills and levels whose difficulties vary, with chance in each episode."""
    skills = skill + rng.normal(0, spread, (runs, 1))
    success = (rng.random((runs, len(levels))) < 1 / (1 + np.exp(-skills - levels))).astype(float)
    longer = np.exp(np.abs(rng.normal(0.4 - 0.06 * skills, 0.3, success.shape)))
    steps = np.where(success > 0, np.minimum(LIMIT, FEWEST * longer), LIMIT)
    return Runs(success, success * FEWEST / steps, steps)


PEOPLE, MODEL, RANDOM = (1.5, 0.7), (0.5, 0.4), (-2.0, 0.1)


@pytest.mark.nightly(sample=True)
def test_intervals_over_people_and_levels_hold_the_truth() -> None:
    rng = np.random.default_rng(9)
    levels = rng.normal(0, 1, 4_000)
    people, model, floor = (play(rng, 400, levels, *skill) for skill in (PEOPLE, MODEL, RANDOM))
    least = floor.efficiency.mean()
    truths = {
        "normalised": (model.efficiency.mean() - least) / (people.efficiency.mean() - least),
        "relative_efficiency": people.steps.mean() / model.steps.mean(),
        "success": model.success.mean(),
        "difference": model.success.mean() - people.success.mean(),
    }
    held = dict.fromkeys(truths, 0)
    for replication in range(REPLICATIONS):
        rng = np.random.default_rng(replication)
        levels = rng.normal(0, 1, 20)
        people, model, floor = (play(rng, 10, levels, *skill) for skill in (PEOPLE, MODEL, RANDOM))
        score = score_player(model, people, floor, seed=replication, draws=400)
        for name, truth in truths.items():
            held[name] += getattr(score, name).holds(truth)
    print({name: round(count / REPLICATIONS, 4) for name, count in held.items()}, "of", REPLICATIONS)
    assert {name: count / REPLICATIONS for name, count in held.items() if count / REPLICATIONS < 0.93} == {}


def test_too_few_people_cannot_separate_a_model_and_many_can() -> None:
    rng = np.random.default_rng(3)
    levels = rng.normal(0, 1, 40)
    few = score_player(play(rng, 3, levels[:4], *PEOPLE), play(rng, 3, levels[:4], *PEOPLE), None)
    assert not few.separable
    many = score_player(play(rng, 20, levels, -1.0, 0.2), play(rng, 40, levels, 2.5, 0.2), None)
    assert many.separable
    assert many.relative_efficiency.high < 1


def test_the_reference_scores_one_and_missing_episodes_are_left_out() -> None:
    rng = np.random.default_rng(4)
    people = play(rng, 12, rng.normal(0, 1, 10), *PEOPLE)
    score = score_player(people, people, None)
    assert (score.normalised.value, score.relative_efficiency.value) == (1.0, 1.0)
    assert score.normalised.low < 1 < score.normalised.high
    hole = np.eye(12, 10, dtype=bool)
    gaps = Runs(*(np.where(hole, np.nan, one) for one in (people.success, people.efficiency, people.steps)))
    assert score_player(gaps, gaps, None).success.value == pytest.approx(np.nanmean(gaps.success, axis=0).mean())


def test_two_tests_share_an_error_of_five_percent() -> None:
    """A value at the draws' 2 % quantile lies outside their 95 % interval, and inside that of 97.5 %."""
    drawn = np.concatenate([[0.5], np.linspace(-0.02, 0.98, 1_001)])
    assert not _estimate(drawn).holds(0.0)
    assert not _excludes(drawn, 0.0)
    assert _excludes(drawn, -0.015)
    assert _excludes(drawn, 0.975)


def test_what_cannot_be_known_separates_nobody() -> None:
    rng = np.random.default_rng(5)
    people = play(rng, 12, rng.normal(0, 1, 10), *PEOPLE)
    nothing = np.full_like(people.success, np.nan)
    score = score_player(Runs(nothing, nothing, nothing), people, None)
    assert not score.separable
    assert np.isnan(score.difference.value)
