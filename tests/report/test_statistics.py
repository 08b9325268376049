"""Statistics where the answer is known."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from minihuman.report import statistics
from minihuman.report.published import published
from minihuman.report.results import exclusions, group_rewards, target_block
from minihuman.report.statistics import compare_groups, mixed_model, power


def groups(**values):
    return pd.DataFrame([{"group": group, "reward": value} for group, them in values.items() for value in them])


def test_p_is_the_share_of_all_regroupings_at_least_as_far_apart():
    a, b = [3.0, 4.0, 6.0], [1.0, 2.0, 2.5]
    (found,) = compare_groups(groups(a=a, b=b), ["reward"])
    everyone = np.array(a + b)
    apart = []
    for chosen in itertools.combinations(range(6), 3):
        rest = [place for place in range(6) if place not in chosen]
        apart.append(everyone[list(chosen)].mean() - everyone[rest].mean())
    observed = np.mean(a) - np.mean(b)
    assert found.p == pytest.approx(2 * np.mean(np.array(apart) >= observed - 1e-9))
    assert found.difference == pytest.approx(observed)
    assert found.n == (3, 3)


def test_the_interval_is_welchs():
    rng = np.random.default_rng(0)
    a, b = rng.normal(1, 1, 12), rng.normal(0, 3, 7)
    (found,) = compare_groups(groups(a=a, b=b), ["reward"])
    variances = a.var(ddof=1) / 12, b.var(ddof=1) / 7
    error = math.sqrt(sum(variances))
    freedom = sum(variances) ** 2 / (variances[0] ** 2 / 11 + variances[1] ** 2 / 6)
    half = stats.t.ppf(0.975, freedom) * error
    assert found.interval == pytest.approx((found.difference - half, found.difference + half))
    pooled = math.sqrt((11 * a.var(ddof=1) + 6 * b.var(ddof=1)) / 17)
    assert found.g == pytest.approx(found.difference / pooled * (1 - 3 / (4 * 17 - 1)), rel=1e-3)


def test_groups_without_any_spread_still_have_a_difference():
    (found,) = compare_groups(groups(a=[1.0, 1.0], b=[1.0, 1.0]), ["reward"])
    assert (found.difference, found.p) == (0.0, 1.0)
    assert math.isnan(found.g)


def test_a_group_of_one_is_not_compared():
    assert compare_groups(groups(a=[1.0, 2.0], b=[1.0]), ["reward"]) == ()


def test_three_groups_make_three_pairs_and_p_is_corrected_over_all():
    found = compare_groups(groups(a=[1.0, 2, 3], b=[2.0, 3, 4], c=[9.0, 10, 11]), ["reward"])
    assert [(one.first, one.second) for one in found] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert all(one.p_holm >= one.p for one in found)
    smallest = min(found, key=lambda one: one.p)
    assert smallest.p_holm == pytest.approx(3 * smallest.p)


def episodes_of(*, effect: float, people: int, seed: int) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    rows = []
    for person in range(people):
        group, own = ("a", "b")[person % 2], rng.normal(0, 0.2)
        for episode in range(1, 9):
            reward = 0.5 + effect * (group == "b") + 0.03 * episode + own + rng.normal(0, 0.1)
            rows.append({"participant": f"sub-{person}", "group": group, "episode_in_block": episode, "reward": reward})
    return pd.DataFrame(rows)


def test_the_mixed_model_finds_the_effect_and_the_slope_it_was_made_with():
    found = mixed_model(episodes_of(effect=0.6, people=24, seed=1), "reward")
    assert found.terms == ("Intercept", "group: b", "episode")
    estimates = dict(zip(found.terms, found.estimates, strict=True))
    assert estimates["group: b"] == pytest.approx(0.6, abs=0.2)
    assert estimates["episode"] == pytest.approx(0.03, abs=0.01)
    low, high = found.intervals[1]
    assert low < estimates["group: b"] < high
    assert (found.participants, found.episodes, found.note) == (24, 192, "")


def test_a_balanced_model_judges_groups_as_a_t_test_of_participants_means_does():
    rows = episodes_of(effect=0.6, people=8, seed=1)
    means = rows.groupby(["group", "participant"])["reward"].mean()
    peer = stats.ttest_ind(means["b"], means["a"])
    found = mixed_model(rows, "reward")
    assert found.intervals[1] == pytest.approx(tuple(peer.confidence_interval(0.95)), abs=1e-3)
    assert found.p[1] == pytest.approx(peer.pvalue, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_a_model_of_participants_who_are_alike_says_so_in_a_sentence(seed):
    rows = episodes_of(effect=0, people=8, seed=0)
    rows["reward"] = np.random.default_rng(seed).normal(0.8, 0.1, len(rows))
    found = mixed_model(rows, "reward")
    assert found.note.startswith("Participants differ no more than their episodes do")
    low, high = found.intervals[1]
    assert 0 < high - low < 0.2


def test_a_fit_that_failed_says_do_not_rely_on_it(monkeypatch):
    monkeypatch.setattr(statistics, "_OPTIMISERS", ["bfgs"])
    rows = episodes_of(effect=0, people=8, seed=0)
    rows["reward"] = np.random.default_rng(1).normal(0.8, 0.1, len(rows))
    assert mixed_model(rows, "reward").note == "The fit did not converge; do not rely on these numbers."


def test_a_measure_that_never_differs_has_no_model():
    assert mixed_model(episodes_of(effect=0, people=4, seed=0).assign(reward=0.0), "reward") is None


def test_a_model_of_one_group_is_not_made():
    rows = episodes_of(effect=0, people=4, seed=0)
    assert mixed_model(rows[rows["group"] == "a"], "reward") is None


def test_power_is_the_textbooks():
    found = power((26, 26))
    assert found.needed_for_large == 26
    assert found.power_for_large == pytest.approx(0.807, abs=0.002)
    assert found.detectable_g == pytest.approx(0.79, abs=0.01)
    assert math.isnan(power((1, 5)).power_for_large)


def test_the_published_subject_means_are_the_papers():
    rows = published().groupby("group")["reward_mean"].apply(list)
    assert rows["Minigrid then Miniworld"] == [0.93, 0.84, 0.74, 0.89, 0.93]
    assert rows["directly Miniworld"] == [0.89, 0.91, 0.94, 0.82, 0.94]
    means = group_rewards(published()).set_index("group")["reward_mean"]
    assert means["Minigrid then Miniworld"] == pytest.approx(0.866)
    assert means["directly Miniworld"] == pytest.approx(0.900)


def test_groups_are_compared_on_the_last_block_they_all_played():
    blocks = pd.DataFrame({"group": ["a", "a", "b"], "block": ["grid", "room", "room"]})
    assert target_block(blocks) == "room"
    assert target_block(blocks.iloc[:0]) == ""


def test_what_was_left_out_is_listed_with_its_reason():
    people = pd.DataFrame({"left_out": ["asleep", None], "participant": ["s1", "s2"], "session": [1, 1]})
    rows = pd.DataFrame(
        {
            "left_out": [None, "slow"],
            "participant": ["s1", "s2"],
            "session": [1, 1],
            "episode": [1, 4],
            "attempt": [1, 1],
        }
    )
    listed = exclusions(rows, people)
    assert listed[["left_out", "level", "participant"]].to_numpy().tolist() == [
        ["asleep", "participant", "s1"],
        ["slow", "episode", "s2"],
    ]
    assert listed["episode"].tolist()[1] == 4
