"""Statistics where the answer is known."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.statistics import regroupings
from minihuman.statistics.comparison import compare_groups, holm_correction, standardise
from minihuman.statistics.permutation import permutation_tests, smallest_p
from minihuman.statistics.regroupings import RESAMPLES, SEED
from minihuman.statistics.t_tests import compare_means, compute_power, t_test_power
from tests.counts import count


def the_p(a, b):
    (test,) = permutation_tests([(np.asarray(a, float), np.asarray(b, float))])
    return test.p()


def welch(a, b, axis):
    """|Welch's t|; very large where groups without any spread differ, 0 where they do not."""
    apart = np.abs(a.mean(axis=axis) - b.mean(axis=axis))
    error = np.sqrt(a.var(axis=axis, ddof=1) / a.shape[axis] + b.var(axis=axis, ddof=1) / b.shape[axis])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(apart < 1e-12, 0.0, np.minimum(apart / error, 1e9))


def groups(**values):
    return pd.DataFrame([{"group": group, "reward": value} for group, them in values.items() for value in them])


def test_p_is_the_share_of_all_regroupings_at_least_as_far_apart():
    a, b = [3.0, 4.0, 6.0], [1.0, 2.0, 2.5]
    (found,) = compare_groups(groups(a=a, b=b), ["reward"])
    everyone = np.array(a + b)
    apart = []
    for chosen in itertools.combinations(range(6), 3):
        rest = [place for place in range(6) if place not in chosen]
        apart.append(abs(scipy.stats.ttest_ind(everyone[list(chosen)], everyone[rest], equal_var=False).statistic))
    observed = abs(scipy.stats.ttest_ind(a, b, equal_var=False).statistic)
    assert found.p == pytest.approx(np.mean(np.array(apart) >= observed - 1e-9))
    assert found.difference == pytest.approx(np.mean(a) - np.mean(b))
    assert found.n == (3, 3)


KINDS = {
    "numbers": lambda values: values,
    "with ties": np.round,
    "yes and no": lambda values: (values > 0).astype(float),
    "no spread": lambda values: np.full(len(values), 1.5 + len(values)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_p_is_scipys_to_the_last_bit_whichever_pairs_are_asked_for_together(kind, monkeypatch):
    monkeypatch.setattr(regroupings, "_AT_ONCE", 60_000)  # several batches
    rng = np.random.default_rng(1)
    sizes = [(2, 2), (5, 5), (9, 30), (2, 9), (9, 30), (8, 8), (60, 50)]  # three of which are drawn from
    pairs = [(KINDS[kind](rng.normal(0, 1, n)), KINDS[kind](rng.normal(0.4, 2, m))) for n, m in sizes]
    peers = [
        scipy.stats.permutation_test(
            pair, welch, n_resamples=RESAMPLES, batch=500, vectorized=True, alternative="greater",
            rng=np.random.default_rng(SEED),
        ).pvalue
        for pair in pairs
    ]  # fmt: skip
    assert [test.regrouped_p() for test in permutation_tests(pairs)] == peers
    assert [permutation_tests([pair])[0].regrouped_p() for pair in pairs] == peers


def test_a_pair_with_one_alone_has_no_p_beside_others_that_have():
    a, b = np.array([1.0, 2.0, 5.0]), np.array([7.0, 8.0])
    found = permutation_tests([(a[:1], b), (a, b)])
    assert found[0] is None
    assert found[1].p() == the_p(a, b)


def test_welchs_interval_and_p_are_scipys():
    rng = np.random.default_rng(5)
    for n, m in rng.integers(2, 40, (20, 2)):
        a, b = rng.normal(0, 1, n), rng.normal(0.5, 3, m)
        peer = scipy.stats.ttest_ind(a, b, equal_var=False)
        assert compare_means(a, b).p == pytest.approx(peer.pvalue, rel=1e-12)
        assert compare_means(a, b).interval() == pytest.approx(tuple(peer.confidence_interval()), rel=1e-12)


@pytest.mark.parametrize("sizes", [(12, 7), (5, 5), (4, 9), (20, 25)])
def test_the_interval_ends_where_the_test_of_shifted_values_begins_to_reject(sizes):
    rng = np.random.default_rng(0)
    a, b = rng.normal(1, 1, sizes[0]), rng.normal(0, 3, sizes[1])
    (found,) = compare_groups(groups(a=a, b=b), ["reward"])
    width = found.interval[1] - found.interval[0]
    for bound, outwards in zip(found.interval, (-1, 1), strict=True):
        inside, outside = (bound - 1e-3 * width * outwards, bound + 1e-3 * width * outwards)
        assert the_p(a - inside, b) >= 0.05 > the_p(a - outside, b)
    assert found.interval[0] < found.difference < found.interval[1]


DRAWS = (
    lambda rng, n: rng.normal(rng.normal(0, 1), rng.choice([0.3, 1, 3]), n),
    lambda rng, n: rng.lognormal(rng.normal(0, 0.5), 1, n),
    lambda rng, n: rng.binomial(10, rng.beta(9, 1), n) / 10,
    lambda rng, n: rng.choice(5, n) * 1.0,
)


def test_interval_p_and_g_never_contradict_each_other():
    rng, checked = np.random.default_rng(8), 0
    for number in range(count(120, 2000)):
        n, m = rng.integers(2, 20, 2)
        draw = DRAWS[number % len(DRAWS)]
        (found,) = compare_groups(groups(a=draw(rng, n), b=draw(rng, m)), ["reward"])
        for low, high in (found.interval, found.g_interval):
            if not math.isnan(low):
                assert (found.p < 0.05) != (low <= 0 <= high), (number, found)
                checked += 1
    assert checked > 100


def test_groups_without_any_spread_still_have_a_difference():
    (found,) = compare_groups(groups(a=[1.0, 1.0], b=[1.0, 1.0]), ["reward"])
    assert (found.difference, found.p) == (0.0, 1.0)
    assert math.isnan(found.g)


def test_a_group_of_one_stays_in_the_table_with_the_reason():
    (found,) = compare_groups(groups(a=[1.0, 2.0], b=[1.0]), ["reward"])
    assert found.reason == "1 in b: two a group are the least"
    assert found.means == (1.5, 1.0)
    assert math.isnan(found.p)
    assert math.isnan(found.p_holm)


def test_a_group_where_everybody_timed_out_has_a_difference_and_no_standardised_one():
    (found,) = compare_groups(groups(a=[40.0, 60.0, 50.0], b=[250.0, 250.0, 250.0]), ["reward"])
    assert found.reason == "everybody in b is at 250: no standardised difference"
    assert np.isnan(found.interval).all()  # three and three cannot have p < 0.05, so no interval can tell
    assert math.isnan(found.g)


def test_nobody_differs_next_to_nothing_means_no_huge_g():
    (found,) = compare_groups(groups(a=[1.0, 1.001, 1.0, 1.0, 1.0], b=[2.0, 2.0, 2.001, 2.0, 2.0]), ["reward"])
    assert found.reason == "spreads are next to nothing: no standardised difference"


def test_the_smallest_p_of_the_papers_five_and_five_cannot_survive_ten_measures():
    assert smallest_p((5, 5)) == pytest.approx(2 / 252)
    apart = compare_groups(groups(a=np.arange(5.0), b=np.arange(5.0) + 100), ["reward"])[0]
    assert apart.p == pytest.approx(apart.smallest_p)
    assert holm_correction([apart.p] + [0.5] * 9)[0] > 0.05
    assert smallest_p((4, 7)) == pytest.approx(1 / 330)
    assert smallest_p((40, 40)) == pytest.approx(1e-4)


def test_g_of_equal_groups_is_hedges_g_of_statsmodels():
    from statsmodels.stats.meta_analysis import effectsize_smd

    rng = np.random.default_rng(3)
    a, b = rng.normal(1, 1, 14), rng.normal(0, 1, 14)
    b = (b - b.mean()) / b.std(ddof=1) * a.std(ddof=1)  # of one SD, so that both standardisers are the same
    g, variance = effectsize_smd(a.mean(), a.std(ddof=1), 14, b.mean(), b.std(ddof=1), 14)
    (found,) = compare_groups(groups(a=a, b=b), ["reward"])
    assert found.g == pytest.approx(g, rel=2e-3)
    assert np.ptp(found.g_interval) / 2 == pytest.approx(1.96 * math.sqrt(variance), rel=0.1)


def test_below_five_a_group_nothing_is_standardised():
    (found,) = compare_groups(groups(a=[1.0, 2.0, 4.0, 3.5], b=[2.0, 3.0, 5.0, 8.0, 9.0]), ["reward"])
    assert math.isnan(found.g)
    assert found.reason == ""


def test_a_measure_of_logarithms_has_geometric_means():
    (found,) = compare_groups(
        groups(a=np.log([2.0, 8.0, 4.0]), b=np.log([1.0, 1.0, 8.0])), ["reward"], log_measures=("reward",)
    )
    assert found.means == pytest.approx((4.0, 2.0))
    assert math.exp(found.difference) == pytest.approx(2.0)


@pytest.mark.nightly(by_day=["1.0"])
@pytest.mark.parametrize("truth", [0.0, 1.0, 2.0])
def test_the_interval_of_g_holds_the_truth_where_the_small_group_varies_more(truth):
    rng, studies, held = np.random.default_rng(21), count(150, 2000), 0
    for _ in range(studies):
        a, b = rng.normal(truth * math.sqrt((2.5**2 + 1) / 2), 2.5, 6), rng.normal(0, 1, 18)
        (test,) = permutation_tests([(a, b)])
        low, high = standardise(a, b, test.interval())[1]
        held += low <= truth <= high
    print(f"g {truth}: {held / studies:.3f} of {studies} intervals hold it")
    assert scipy.stats.binomtest(held, studies, 0.93, alternative="less").pvalue > 0.01


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize(
    ("sizes", "spreads", "at_most"),
    [
        ((5, 25), (3, 1), 0.065),
        ((8, 16), (2, 1), 0.065),
        ((10, 10), (3, 1), 0.065),
        ((12, 12), (1, 1), 0.065),
        ((4, 20), (2.5, 1), 0.065),
        ((2, 18), (2.5, 1), 0.065),
    ],
)
def test_a_true_null_is_rejected_as_rarely_as_it_should_be(sizes, spreads, at_most):
    rng, studies = np.random.default_rng(11), count(60, 1000)
    rejected = 0
    for _ in range(studies):
        a, b = (rng.normal(0, spread, size) for size, spread in zip(sizes, spreads, strict=True))
        rejected += the_p(a, b) < 0.05
    print(f"{sizes} SD {spreads}: {rejected / studies:.3f} of {studies} studies reject a true null")
    assert scipy.stats.binomtest(rejected, studies, at_most, alternative="greater").pvalue > 0.01
    if sizes[0] == sizes[1]:
        assert scipy.stats.binomtest(rejected, studies, 0.035, alternative="less").pvalue > 0.01


def test_three_groups_make_three_pairs_and_p_is_corrected_over_all():
    found = compare_groups(groups(a=[1.0, 2, 3], b=[2.0, 3, 4], c=[9.0, 10, 11]), ["reward"])
    assert [(one.first, one.second) for one in found] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert all(one.p_holm >= one.p for one in found)
    smallest = min(found, key=lambda one: one.p)
    assert smallest.p_holm == pytest.approx(3 * smallest.p)


def test_power_is_the_textbooks():
    found = compute_power((26, 26))
    assert found.needed_for_large == 26
    assert found.power_for_large == pytest.approx(0.807, abs=0.002)
    assert found.detectable_g == pytest.approx(0.79, abs=0.01)
    assert math.isnan(compute_power((1, 5)).power_for_large)


@pytest.mark.parametrize(("d", "n"), [(0.8, (26, 26)), (0.3, (5, 25)), (1.5, (4, 4))])
def test_power_agrees_with_statsmodels(d, n):
    from statsmodels.stats.power import TTestIndPower

    peer = TTestIndPower().power(d, n[0], 0.05, ratio=n[1] / n[0])
    assert t_test_power(d, n) == pytest.approx(peer, abs=1e-6)


@pytest.mark.parametrize("n", [(2, 2), (3, 5), (26, 26), (2, 1000), (4000, 4000)])
def test_the_difference_that_is_found_with_a_chance_of_80_percent_has_that_power(n):
    assert t_test_power(compute_power(n).detectable_g, n) == pytest.approx(0.8, abs=1e-6)


def test_holm_agrees_with_statsmodels_and_passes_over_what_is_unknown():
    from statsmodels.stats.multitest import multipletests

    ps = [0.04, 0.001, 0.03, 0.2]
    assert holm_correction(ps) == pytest.approx(list(multipletests(ps, method="holm")[1]))
    with_unknown = holm_correction([0.04, float("nan"), 0.03])
    assert np.isnan(with_unknown[1])
    assert with_unknown[::2] == pytest.approx([0.06, 0.06])


def test_a_group_that_alone_is_skewed_is_named_and_normal_groups_are_not():
    rng = np.random.default_rng(8)
    skewed, level = rng.lognormal(0, 1.2, 12), rng.normal(2, 1, 40)
    (found,) = compare_groups(groups(a=skewed, b=level), ["reward"])
    assert found.caution.startswith("values of a are skewed")
    assert found.p > 0  # it is said beside p, not in its place
    (found,) = compare_groups(groups(a=rng.normal(0, 1, 12), b=level), ["reward"])
    assert found.caution == ""
    (found,) = compare_groups(groups(a=[1.0, 1.0, 1.0, 1.0], b=[1.0, 1.0, 1.0, 1.0]), ["reward"])
    assert found.caution == ""
