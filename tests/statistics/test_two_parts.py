import math

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.statistics.two_part_model import (
    compare_two_parts,
    fit_gee,
    has_mass_at_zero,
    summarise_people,
    two_parts_p,
)
from tests.counts import count


def study(rng, sizes=(10, 10), *, episodes=10, out_of_time=(0.1, 0.1), faster=0.0):
    """Episodes of two groups: people differ in how often they run out of time and in how much they get otherwise."""
    rows = []
    for group, size in enumerate(sizes):
        for who in range(size):
            odds = math.log(out_of_time[group] / (1 - out_of_time[group])) + rng.normal(0, 0.7)
            level = 0.9 + rng.normal(0, 0.03) + (faster if group == 0 else 0.0)
            for _ in range(episodes):
                late = rng.random() < 1 / (1 + math.exp(-odds))
                reward = 0.0 if late else min(level + rng.normal(0, 0.03), 1.0)
                rows.append(("ab"[group], f"{group}-{who}", reward))
    return pd.DataFrame(rows, columns=["group", "participant", "reward"])


@pytest.mark.parametrize("odds", [True, False])
def test_a_groups_marginal_mean_is_that_of_statsmodels(odds):
    sm = pytest.importorskip("statsmodels.api")
    rng = np.random.default_rng(7)
    people = [
        (rng.random(n) < rng.beta(8, 2)).astype(float) if odds else rng.normal(rng.normal(0.8, 0.1), 0.05, n)
        for n in rng.integers(3, 12, 12)
    ]
    values, who = np.concatenate(people), np.repeat(np.arange(12), [len(one) for one in people])
    family = sm.families.Binomial() if odds else sm.families.Gaussian()
    model = sm.GEE(values, np.ones((len(values), 1)), who, family=family, cov_struct=sm.cov_struct.Exchangeable())
    theirs, ours = model.fit(cov_type="bias_reduced", maxiter=200), fit_gee(people, odds=odds)
    assert ours.at == pytest.approx(theirs.params[0], abs=1e-4)
    assert ours.error == pytest.approx(theirs.bse[0], rel=1e-3)


def test_groups_that_fail_more_differ_in_the_first_part_alone():
    found = compare_two_parts(study(np.random.default_rng(1), (30, 30), out_of_time=(0.4, 0.05)), "reward", ("a", "b"))
    assert found.any.interval[1] < 1
    assert found.any.p < 0.001
    assert found.amount.interval[0] < 0 < found.amount.interval[1]
    assert found.p < 0.01


def test_groups_that_are_faster_differ_in_the_second_part_alone():
    found = compare_two_parts(study(np.random.default_rng(2), (30, 30), faster=0.05), "reward", ("a", "b"))
    assert found.amount.interval[0] > 0
    assert found.any.interval[0] < 1 < found.any.interval[1]
    assert found.p < 0.01


def test_a_group_that_never_fails_has_no_odds_but_its_amounts_are_compared():
    rows = study(np.random.default_rng(3), out_of_time=(0.2, 0.2))
    rows.loc[(rows["group"] == "a") & (rows["reward"] == 0), "reward"] = 0.9
    found = compare_two_parts(rows, "reward", ("a", "b"))
    assert found.any.reason == "no episode of a is at 0"
    assert math.isnan(found.any.estimate)
    assert math.isfinite(found.amount.estimate)
    assert 0 < found.p <= 1


def test_two_people_a_group_are_too_few():
    found = compare_two_parts(study(np.random.default_rng(4), (2, 5)), "reward", ("a", "b"))
    assert found.any.reason == found.amount.reason == "fewer than 4 participants in a"
    assert math.isnan(found.p)


def test_which_measures_have_two_parts():
    assert has_mass_at_zero(np.array([0.0, 0.5, np.nan]))
    assert not has_mass_at_zero(np.array([0.1, 0.5]))
    assert not has_mass_at_zero(np.array([0.0, 0.0]))
    assert not has_mass_at_zero(np.array([-1.0, 0.0, 1.0]))


def test_people_of_no_success_have_a_share_but_no_amount():
    rows = pd.DataFrame({"participant": ["x", "x", "y"], "reward": [0.0, 0.8, 0.0]})
    assert summarise_people(rows, "reward") == pytest.approx(np.array([[0.5, 0.8], [0.0, np.nan]]), nan_ok=True)


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("sizes", [(10, 10), (20, 20), (8, 16)])
def test_without_a_difference_each_part_finds_one_as_rarely_as_it_should(sizes):
    rng, studies = np.random.default_rng([5, *sizes]), count(20, 1000)
    found = [compare_two_parts(study(rng, sizes), "reward", ("a", "b")) for _ in range(studies)]
    for name, ps in (
        ("odds", [one.any.p for one in found]),
        ("amount", [one.amount.p for one in found]),
        ("both", [one.p for one in found]),
    ):
        told = [p for p in ps if not math.isnan(p)]
        hits = sum(p < 0.05 for p in told)
        print(f"{sizes} {name}: {hits / len(told):.3f} of {len(told)} studies")  # shown by pytest -s
        assert scipy.stats.binomtest(hits, len(told), 0.065).pvalue > 0.001 or hits / len(told) < 0.065


def test_p_of_both_is_the_share_of_regroupings_that_are_as_far_apart():
    rng = np.random.default_rng(6)
    a, b = rng.normal(0, 1, (8, 2)), rng.normal((3.0, 0.0), 1, (8, 2))
    assert two_parts_p(a, b) < 0.01
    assert two_parts_p(a, a.copy()) == 1.0
