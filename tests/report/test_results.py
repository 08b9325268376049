import math

import numpy as np
import pandas as pd
import pytest

from minihuman.experiment.protocol import specs
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.reporting.analysed_rows import blank_goal_measures
from minihuman.reporting.block_measures import FORMULAS, MEASURES
from minihuman.reporting.block_results import compute_block_results, summarise_group_rewards
from minihuman.reporting.exclusions import list_exclusions
from minihuman.reporting.page import read_published_subjects
from minihuman.reporting.results import find_target_block
from minihuman.reporting.statements import difference_statement
from minihuman.statistics.survival import kaplan_meier


def test_the_published_subject_means_are_the_papers():
    rows = read_published_subjects().groupby("group")["reward_mean"].apply(list)
    assert rows["Minigrid then Miniworld"] == [0.93, 0.84, 0.74, 0.89, 0.93]
    assert rows["directly Miniworld"] == [0.89, 0.91, 0.94, 0.82, 0.94]
    means = summarise_group_rewards(read_published_subjects()).set_index("group")["reward_mean"]
    assert means["Minigrid then Miniworld"] == pytest.approx(0.866)
    assert means["directly Miniworld"] == pytest.approx(0.900)


def test_groups_are_compared_on_the_last_block_they_all_played():
    blocks = pd.DataFrame({"group": ["a", "a", "b"], "block": ["grid", "room", "room"]})
    assert find_target_block(blocks) == "room"
    assert find_target_block(blocks.iloc[:0]) == ""


def test_what_was_left_out_is_listed_with_its_reason():
    people = pd.DataFrame({"exclusion_reason": ["asleep", None], "participant": ["s1", "s2"], "session": [1, 1]})
    rows = pd.DataFrame(
        {
            "exclusion_reason": [None, "slow"],
            "participant": ["s1", "s2"],
            "session": [1, 1],
            "episode": [1, 4],
            "attempt": [1, 1],
        }
    )
    listed = list_exclusions(rows, people)
    assert listed[["exclusion_reason", "level", "participant"]].to_numpy().tolist() == [
        ["asleep", "participant", "s1"],
        ["slow", "episode", "s2"],
    ]
    assert listed["episode"].tolist()[1] == 4


def played(people, seed=1):
    """One block's rows of the block table and its episodes: two groups of so many people each."""
    rng = np.random.default_rng(seed)
    who = [(group, f"{group}-{number}") for group in ("a", "b") for number in range(people)]
    rows = pd.DataFrame(
        {"group": group, "participant": name, "session": 1, "block": "grid", "episodes": 3, "reward_sd": 0.1}
        | dict.fromkeys(MEASURES, np.nan)
        | {"keys_total": 3}
        | {"log_excess_steps_mean": rng.normal(3, 0.1), "reward_mean": rng.normal(0.8, 0.1), "success": rng.random()}
        for group, name in who
    )
    episodes = pd.DataFrame(
        {"group": group, "participant": name, "world": "w", "episode_in_block": at, "reward": rng.random()}
        | {"session": 1, "playing_s": 10.0, "steps": 40, "success": at > 1}
        | {"exclusion_reason": None, "max_steps": 40, "outcome": "goal" if at > 1 else "timeout"}
        for group, name in who
        for at in (1, 2, 3)
    )
    return rows, episodes


def test_what_was_named_before_is_judged_first_and_apart():
    named = AnalysisSpec(
        primary_measure="log_excess_steps_mean", secondary_measures=("success",), equivalence_margin=0.5
    )
    found = compute_block_results("grid", *played(12), ["a", "b"], named)
    assert [one.measure for one in found.comparisons] == ["log_excess_steps_mean", "success", "reward_mean"]
    assert found.roles == {
        "log_excess_steps_mean": "primary",
        "success": "secondary",
        "reward_mean": "exploratory",
    }
    assert all(one.p_holm == one.p for one in found.comparisons)  # each is alone in its role
    (alike,) = found.alike
    assert alike.test.alike


def test_without_a_word_before_everything_is_corrected_together():
    found = compute_block_results("grid", *played(12), ["a", "b"], AnalysisSpec())
    assert set(found.roles.values()) == {"exploratory"}
    smallest = min(found.comparisons, key=lambda one: one.p)
    assert smallest.p_holm == pytest.approx(min(1, 3 * smallest.p))
    assert found.alike == ()


def test_the_ratio_of_steps_is_compared_where_it_is_named_alone():
    rows, episodes = played(12)
    rows["log_steps_ratio_mean"] = rows["log_excess_steps_mean"] - 2
    unasked = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec())
    assert "log_steps_ratio_mean" not in unasked.roles
    (named, *_) = compute_block_results(
        "grid", rows, episodes, ["a", "b"], AnalysisSpec(primary_measure="log_steps_ratio_mean")
    ).comparisons
    assert named.measure == "log_steps_ratio_mean"
    factor = math.exp(named.difference)
    assert f"as a ratio of steps: {factor:.3f}" in difference_statement(named, "grid")


def test_the_measures_of_a_protocol_are_the_reports():
    assert set(specs.COMPARABLE_MEASURES) == set(MEASURES)
    assert set(FORMULAS) <= set(MEASURES)


def test_groups_stand_in_one_order_in_all_tables():
    found = compute_block_results("grid", *played(3), ["b", "a"], AnalysisSpec())
    for table in (found.subjects, found.groups, found.measures[found.measures["measure"] == "success"]):
        assert list(dict.fromkeys(table["group"])) == ["b", "a"]
    assert (found.comparisons[0].first, found.comparisons[0].second) == ("b", "a")


@pytest.mark.parametrize(
    ("analysis", "field", "words"),
    [
        (AnalysisSpec(primary_measure="speed"), "primary_measure", "not a measure"),
        (
            AnalysisSpec(primary_measure="success", secondary_measures=("success",)),
            "secondary_measures",
            "the primary measure already",
        ),
        (AnalysisSpec(primary_measure="success", equivalence_margin=0.0), "equivalence_margin", "more than 0"),
        (AnalysisSpec(equivalence_margin=0.1), "equivalence_margin", "name one"),
        (AnalysisSpec(block="maze"), "block", "is not a block; blocks: grid"),
    ],
)
def test_an_analysis_that_cannot_be_made_is_refused(analysis, field, words):
    ((path, complaint),) = specs.check_analysis(analysis, ("grid",))
    assert path == f"$.analysis.{field}"
    assert words in complaint


def test_a_sound_analysis_has_no_complaints():
    sound = AnalysisSpec(
        primary_measure="success", secondary_measures=("reward_mean",), equivalence_margin=0.1, block="grid"
    )
    assert list(specs.check_analysis(sound, ("grid",))) == []


def test_who_never_found_every_key_is_waited_for_to_the_last_step():
    rows, episodes = played(12)
    rows.loc[:11, "all_keys_discovered_s"] = 5.0  # group a; nobody of b ever did
    (found,) = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec()).waits.compared
    a, b, compared = found
    assert (a, b) == ("a", "b")
    assert compared.censored == (0, 12)
    assert compared.difference == pytest.approx(5.0 - 30.0)
    assert compared.logrank_p < 0.001
    assert math.isnan(compared.p), "nobody of b found them: no mean can be told from another"


def test_who_never_found_every_key_was_watched_in_what_does_not_count_too():
    rows, episodes = played(2)
    episodes.loc[episodes["episode_in_block"] == 1, "exclusion_reason"] = "not played to an end"
    rows.loc[rows["group"] == "b", "all_keys_discovered_s"] = 5.0
    keys = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec()).waits.keys["a"]
    assert keys.times.tolist() == [30.0, 30.0]


def test_where_nobody_found_every_key_nobody_is_waited_for():
    assert compute_block_results("grid", *played(4), ["a", "b"], AnalysisSpec()).waits.keys == {}


def test_a_block_without_a_goal_has_no_measures_of_reaching_one_unless_they_are_named():
    rows, episodes = played(4)
    never = episodes.assign(success=False, block="grid")
    assert (
        blank_goal_measures(rows.assign(block="grid"), never.assign(reward=0.0), AnalysisSpec())["success"]
        .notna()
        .all()
    )
    cleared = blank_goal_measures(rows.assign(block="grid"), never.assign(reward=1.0), AnalysisSpec())
    assert cleared["success"].isna().all()
    assert cleared["reward_mean"].notna().all()
    named = AnalysisSpec(primary_measure="success")
    assert blank_goal_measures(rows.assign(block="grid"), never.assign(reward=1.0), named)["success"].notna().all()


def test_waiting_for_the_goal_counts_time_outs_as_still_waiting():
    waits = compute_block_results("grid", *played(4), ["a", "b"], AnalysisSpec()).waits
    assert waits.goal["a"].observed.mean() == pytest.approx(2 / 3)


def test_who_failed_waits_for_the_goal_to_the_step_limit():
    rows, episodes = played(2)
    lost = episodes["episode_in_block"] == 1
    episodes = episodes.assign(max_steps=100, outcome=np.where(lost, "failure", "goal"))
    episodes.loc[lost, "steps"] = 3  # in the lava
    found = kaplan_meier(compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec()).waits.goal["a"])
    assert (found.times.tolist(), found.share.tolist()) == ([40.0], [pytest.approx(1 / 3)])
