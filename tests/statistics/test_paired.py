"""Comparisons within a participant, where the answer is known."""

import math

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.statistics.paired import compare_conditions, fit_crossover, paired_test
from tests.counts import count


@pytest.mark.parametrize("n", [2, 6, 11, 13])
def test_p_is_scipys(n):
    rng = np.random.default_rng(n)
    for values in (rng.normal(0.4, 1, n), np.round(rng.normal(0.4, 1, n))):
        peer = scipy.stats.permutation_test(
            (values,), np.mean, permutation_type="samples", n_resamples=np.inf, vectorized=True
        )
        assert paired_test(values).p() == pytest.approx(peer.pvalue)


def test_the_interval_ends_where_the_test_begins_to_reject_and_never_contradicts_p():
    rng = np.random.default_rng(1)
    for number in range(60):
        values = rng.normal(rng.normal(0, 0.6), 1, 6 + number % 20)
        test = paired_test(values if number % 2 else np.round(values, 1))
        low, high = test.interval()
        assert (test.p() < 0.05) != (low <= 0 <= high)
        if number % 2:
            for bound, outwards in ((low, -1), (high, 1)):
                assert test.p(bound - 1e-3 * outwards) >= 0.05 > test.p(bound + 1e-2 * outwards)


def test_too_few_differences_have_no_interval_and_say_how_small_p_can_be():
    test = paired_test(np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    assert test.p() == test.smallest_p == pytest.approx(2 / 32)
    assert np.isnan(test.interval()).all()
    assert paired_test(np.array([1.0])) is None


def test_conditions_are_compared_over_who_has_both_and_corrected_together():
    values = pd.DataFrame(
        {"x": [1.0, 2, 3, 4, 5, 6, 7, np.nan], "y": [2.0, 3, 5, 5, 7, 7, 9, 1], "z": [0.5, 1.9, 3.2, 4, 5.1, 6, 7, 2]}
    )
    found = compare_conditions({"m": values})
    assert [(one.first, one.second, one.n) for one in found] == [("x", "y", 7), ("x", "z", 7), ("y", "z", 8)]
    assert found[0].difference == pytest.approx(-10 / 7)
    assert found[0].p_holm == pytest.approx(3 * found[0].p)
    (ratio,) = compare_conditions({"m": np.log(values[["x", "y"]])}, log_measures=["m"])
    assert ratio.is_log
    assert ratio.means[0] == pytest.approx(math.exp(np.log(values["x"]).mean()))


ORDERS = ("abcd", "bdac", "cadb", "dcba")  # Williams: each condition follows each other one once


def crossover(rng, people=16, *, position=0.0, carry=0.0):
    rows = []
    for person in range(people):
        own, before = rng.normal(0, 1), ""
        for at, condition in enumerate(ORDERS[person % 4]):
            value = own + 0.8 * (condition == "a") + position * at + carry * (before == "a") + rng.normal(0, 0.5)
            rows.append((person, condition, at + 1, before, value))
            before = condition
    return pd.DataFrame(rows, columns=["participant", "condition", "position", "before", "value"])


def test_the_effects_of_order_are_statsmodels():
    import statsmodels.formula.api as smf

    rows = crossover(np.random.default_rng(2), position=0.3, carry=0.5)
    terms = {term.effect: term for term in fit_crossover("m", rows)}
    assert [*terms] == ["position", "carry-over"]  # conditions are compared by their own test
    rows = rows.assign(**{f"after_{name}": 1.0 * (rows["before"] == name) - (rows["before"] == "d") for name in "abc"})
    columns = {"condition": "C(condition)", "position": "C(position)", "carry-over": "after_a + after_b + after_c"}
    model = smf.ols(f"value ~ C(participant) + {' + '.join(columns.values())}", rows).fit()
    for effect, term in terms.items():
        rest = " + ".join(["C(participant)", *(column for name, column in columns.items() if name != effect)])
        f, p, freedom = model.compare_f_test(smf.ols(f"value ~ {rest}", rows).fit())
        assert term.f == pytest.approx(f)
        assert term.freedom == (freedom, model.df_resid)
        assert term.p == pytest.approx(p, abs=0.02)  # values are normal with equal variances


def test_a_participant_without_a_condition_is_left_out_of_the_effects_of_order():
    rows = crossover(np.random.default_rng(3), people=9)
    assert fit_crossover("m", rows.drop(index=35)) == fit_crossover("m", rows[rows["participant"] < 8])


def test_one_order_for_all_but_a_few_has_no_test_of_order():
    rows = crossover(np.random.default_rng(3), people=4)
    assert fit_crossover("m", rows[rows["participant"] < 2]) == ()  # two orders can be exchanged in two ways


@pytest.mark.nightly(sample=True)
def test_without_an_effect_of_order_none_is_found_too_often_and_a_real_one_is():
    studies = count(40, 1000)
    rng = np.random.default_rng(6)
    none = [{one.effect: one.p for one in fit_crossover("m", crossover(rng))} for _ in range(studies)]
    real = [{one.effect: one.p for one in fit_crossover("m", crossover(rng, carry=0.6))} for _ in range(studies // 4)]
    for effect in ("position", "carry-over"):
        hits = sum(one[effect] < 0.05 for one in none)
        print(f"{effect}: {hits / studies:.3f} of {studies} studies without one")
        assert scipy.stats.binomtest(hits, studies, 0.05, alternative="greater").pvalue > 0.001
    assert np.mean([one["carry-over"] < 0.05 for one in real]) > 0.5


def test_a_contrast_compares_the_weighted_sides_of_each_participant():
    rng = np.random.default_rng(3)
    values = pd.DataFrame(rng.normal(size=(9, 3)), columns=["x", "y", "z"])
    values.loc[0, "z"] = np.nan
    (compared,) = compare_conditions({"m": values}, contrasts={"first": {"x": 1.0, "y": -0.5, "z": -0.5}})
    scores = (values["x"] - values["y"] / 2 - values["z"] / 2).dropna().to_numpy()
    test = paired_test(scores)
    assert (compared.first, compared.second, compared.n) == ("first", "", 8)
    assert compared.p == compared.p_holm == pytest.approx(test.p())
    assert compared.interval == pytest.approx(test.interval())
    known = values.dropna()
    assert compared.means == pytest.approx((known["x"].mean(), (known["y"] + known["z"]).mean() / 2))
