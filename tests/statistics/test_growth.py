import math
from collections import Counter

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.statistics.comparison import compare_groups
from minihuman.statistics.mixed_model import fit_mixed_model
from minihuman.statistics.paired import compare_growth
from tests.counts import count
from tests.recompute.page import mixed_model


def people(rng, groups, *, episodes=8, slope_sd=0.0, slopes=None, level_sd=0.2):
    """Rows of people whose own levels and slopes vary round those of their group."""
    rows = []
    for group, size in groups.items():
        for person in range(size):
            own, slope = rng.normal(0, level_sd), (slopes or {}).get(group, 0.0) + rng.normal(0, slope_sd)
            rows += [
                {
                    "participant": f"{group}-{person}",
                    "group": group,
                    "episode_in_block": episode,
                    "reward": 0.5 + own + slope * episode + rng.normal(0, 0.1),
                }
                for episode in range(1, episodes + 1)
            ]
    return pd.DataFrame(rows)


def named(found):
    return {term.name: term for term in found.terms}


def test_it_finds_levels_slopes_and_their_difference_against_a_named_reference():
    rows = people(np.random.default_rng(1), {"a": 20, "b": 20}, slopes={"a": 0.0, "b": 0.05})
    found = compare_growth(rows, "reward", order=("b", "a"))
    assert found.reference == "a"
    terms = named(found)
    assert list(terms) == [
        "a: reward in the middle of the block",
        "b minus a: reward in the middle of the block",
        "a: change an episode",
        "b minus a: change an episode",
    ]
    assert terms["b minus a: change an episode"].estimate == pytest.approx(0.05, abs=0.01)
    assert terms["b minus a: change an episode"].p < 0.001
    assert terms["a: change an episode"].interval[0] < 0 < terms["a: change an episode"].interval[1]


@pytest.mark.parametrize("sizes", [(2, 9), (4, 9), (8, 8)])
def test_the_same_difference_has_the_same_p_and_interval_as_in_the_comparison_of_means(sizes):
    rows = people(np.random.default_rng(9), {"a": sizes[0], "b": sizes[1]})
    means = rows.groupby(["group", "participant"])["reward"].mean().reset_index()
    (compared,) = compare_groups(means, ["reward"], order=("a", "b"))
    term = named(compare_growth(rows, "reward", order=("a", "b")))["a minus b: reward in the middle of the block"]
    assert term.estimate == pytest.approx(compared.difference)
    assert term.p == compared.p
    assert term.interval == pytest.approx(compared.interval, abs=1e-5, nan_ok=True)


def test_a_group_of_one_is_left_out_by_name_and_the_others_stay():
    rows = people(np.random.default_rng(2), {"a": 6, "b": 3, "c": 1})
    found = compare_growth(rows, "reward")
    assert found.left_out == ("c: 1 with 3 episodes or more",)
    assert found.reference == "b"
    assert compare_growth(rows[rows["group"] == "c"], "reward") is None


def test_people_who_are_all_alike_have_an_estimate_and_no_interval():
    rows = people(np.random.default_rng(3), {"a": 2, "b": 2}).assign(reward=0.5)
    terms = named(compare_growth(rows, "reward"))
    assert terms["b: change an episode"].estimate == pytest.approx(0)
    assert all(math.isnan(term.p) for term in terms.values())


@pytest.mark.nightly
def test_where_peoples_own_slopes_differ_a_true_null_is_rejected_as_rarely_as_it_should_be():
    rng, studies = np.random.default_rng(5), count(60, 1000)
    small = {"b: change an episode": 0, "a minus b: change an episode": 0}
    for _ in range(studies):
        terms = named(compare_growth(people(rng, {"a": 10, "b": 10}, episodes=10, slope_sd=0.01), "reward"))
        for name in small:
            small[name] += terms[name].p < 0.05
    for name, rejected in small.items():
        print(f"{name}: {rejected / studies:.3f} of {studies} studies reject a true null")
        assert scipy.stats.binomtest(rejected, studies, 0.05).pvalue > 0.001


def mixed_rows(rng, n, slope_sd):
    """Episodes of two groups of n people: levels 2 and 2.6, changes -0.15 and -0.05 an episode."""
    rows = []
    for person in range(2 * n):
        in_a, level, own = person % 2, rng.normal(2, 0.4), rng.normal(0, slope_sd)
        for at in range(1, 9):
            value = level + 0.6 * in_a + (-0.15 + 0.1 * in_a + own) * (at - 4.5) + rng.normal(0, 0.3)
            rows.append((f"p{person}", "ba"[in_a], at, value))
    return pd.DataFrame(rows, columns=["participant", "group", "episode_in_block", "value"])


def test_a_mixed_model_of_complete_episodes_has_the_estimates_of_lines():
    rows = mixed_rows(np.random.default_rng(4), 20, 0.08)
    found = fit_mixed_model(rows, "value", ["a", "b"])
    assert found.has_slopes
    lines = compare_growth(rows, "value", order=["a", "b"])
    assert [one.name for one in found.terms] == [one.name for one in lines.terms]
    assert [one.estimate for one in found.terms] == pytest.approx([one.estimate for one in lines.terms], abs=1e-4)
    truth = dict(zip((one.name for one in found.terms), (2.0, 0.6, -0.15, 0.1), strict=True))
    assert all(one.interval[0] < truth[one.name] < one.interval[1] for one in found.terms)
    assert np.isnan(found.terms[0].p)


def test_without_slopes_of_their_own_only_the_intercept_is_random():
    found = fit_mixed_model(mixed_rows(np.random.default_rng(1), 12, 0.0), "value", ["a", "b"])
    assert not found.has_slopes
    assert len(found.terms) == 4


def test_too_few_people_have_no_mixed_model_and_a_constant_none_that_converges():
    rows = mixed_rows(np.random.default_rng(4), 2, 0.1)
    assert fit_mixed_model(rows[rows["participant"] != "p0"], "value", ["a", "b"]) is None
    constant = mixed_rows(np.random.default_rng(4), 6, 0.1).assign(value=1.0)
    assert fit_mixed_model(constant, "value", ["a", "b"]).terms == ()


def test_what_participants_differ_in_by_little_is_found_where_an_analysis_of_variance_finds_it():
    """The likelihood is level at an SD of 0, where one long step from the start once ended."""
    rng, n, episodes = np.random.default_rng(1), 24, 16
    n_found = 0
    for _ in range(40):
        values = rng.normal(0, 0.23, n)[:, None] + rng.normal(0, 1, (n, episodes))
        rows = pd.DataFrame(
            {
                "participant": np.repeat([f"p{number}" for number in range(n)], episodes),
                "group": np.repeat(["a", "b"], n * episodes // 2),
                "episode_in_block": np.tile(np.arange(1, episodes + 1), n),
                "value": values.ravel(),
            }
        )
        between = episodes * sum(np.var(half.mean(axis=1), ddof=1) for half in np.split(values, 2)) / 2
        within = float(np.var(values, axis=1, ddof=1).mean())
        if between > 1.3 * within:
            n_found += 1
            assert len(fit_mixed_model(rows, "value", ["a", "b"]).terms) == 4
    assert n_found >= 20


@pytest.mark.nightly
def test_a_second_program_finds_the_same_model_in_small_studies():
    rng, kept = np.random.default_rng(11), Counter()
    for number in range(count(9, 200)):
        rows = mixed_rows(rng, int(rng.integers(3, 7)), (0.0, 0.1, 0.3)[number % 3])
        rows = rows[rng.random(len(rows)) < 0.8]  # not everybody has the same episodes
        found = fit_mixed_model(rows, "value", ["a", "b"])
        kind, expected = mixed_model(rows, [term.name for term in found.terms] or list("abcd"), ["a", "b"])
        assert (kind == "table") == bool(found.terms)
        kept["slopes" if found.has_slopes else "intercept" if found.terms else "none"] += 1
        for term, (name, people, (estimate,), (low, _, high), *_) in zip(found.terms, expected[1:], strict=True):
            assert (term.name, str(term.people)) == (name, people)
            for ours, theirs in zip((term.estimate, *term.interval), (estimate, low, high), strict=True):
                assert ours == pytest.approx(theirs.value, abs=theirs.error)
    assert min(kept["slopes"], kept["intercept"]) >= count(2, 30), kept


def test_where_statsmodels_finds_the_maximum_its_estimates_and_errors_are_ours():
    from statsmodels.regression.mixed_linear_model import MixedLM

    rows = mixed_rows(np.random.default_rng(4), 20, 0.08)
    rows["value"] *= 10  # statsmodels warns of a variance below 0.01, whatever its unit
    found = fit_mixed_model(rows, "value", ["a", "b"])
    rows = rows.assign(at=rows["episode_in_block"] - rows["episode_in_block"].mean(), in_a=1.0 * (rows["group"] == "a"))
    theirs = MixedLM.from_formula("value ~ in_a * at", rows, groups="participant", re_formula="~ at").fit(reml=True)
    for term, name in zip(found.terms, ("Intercept", "in_a", "at", "in_a:at"), strict=True):
        assert term.estimate == pytest.approx(theirs.fe_params[name], rel=1e-4)
        half = (term.interval[1] - term.interval[0]) / 2
        assert half / scipy.stats.t.ppf(0.975, 38) == pytest.approx(theirs.bse_fe[name], rel=1e-3)
