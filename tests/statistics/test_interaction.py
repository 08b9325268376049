"""The interaction of groups and conditions: the permuted Wald-type test of contrast scores."""

import math

import numpy as np
import pytest

from minihuman.statistics import interaction
from minihuman.statistics.interaction import compare_contrast_scores


@pytest.fixture(autouse=True)
def _few_permutations(monkeypatch):
    monkeypatch.setattr(interaction, "RESAMPLES", 199)


def draw_scores(rng, sizes, spreads, shift=0.0, conditions=3):
    scores = []
    for number, (n, spread) in enumerate(zip(sizes, spreads, strict=True)):
        values = spread * rng.standard_normal((n, conditions))
        values[:, 0] += shift * number
        scores.append(np.diff(values, axis=1))
    return scores


def test_a_true_null_of_unequal_groups_is_seldom_rejected():
    rng = np.random.default_rng(1)
    ps = [compare_contrast_scores(draw_scores(rng, (8, 16), (3.0, 1.0))).p for _ in range(100)]
    assert sum(p < 0.05 for p in ps) <= 12  # of a rate of 0.05, more in one of 500 drawings


@pytest.mark.parametrize("sizes", [(12, 20), (10, 12, 14)])
def test_an_interaction_is_found_whichever_contrasts_span_the_conditions(sizes):
    scores = draw_scores(np.random.default_rng(2), sizes, (1.0,) * len(sizes), shift=2.0)
    turned = [group @ np.array([[2.0, 1.0], [0.0, -3.0]]) for group in scores]
    test, same = compare_contrast_scores(scores), compare_contrast_scores(turned)
    assert test.p < 0.02
    assert test.freedom == 2 * (len(sizes) - 1)
    assert same.statistic == pytest.approx(test.statistic)
    assert same.p == pytest.approx(test.p)


def test_what_cannot_be_tested_has_a_reason_instead_of_a_p():
    rng = np.random.default_rng(3)
    few = compare_contrast_scores(draw_scores(rng, (7, 30), (1.0, 1.0)))
    alike = compare_contrast_scores([np.zeros((9, 2)), np.zeros((9, 2))])
    dependent = compare_contrast_scores([np.repeat(rng.standard_normal((9, 1)), 2, axis=1) for _ in range(2)])
    for test in (few, alike, dependent):
        assert math.isnan(test.p)
        assert test.reason
    assert "need 8 per group" in few.reason
