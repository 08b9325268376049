"""What stands first on the page is true of the study: verdicts, teams, times, contrasts, changes and limits."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from minihuman.dataset.recording_quality import measure_recording_quality
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign, Factor
from minihuman.reporting.answers import state_answers
from minihuman.reporting.block_results import compute_block_results
from minihuman.reporting.design_methods import name_allocated
from minihuman.reporting.interactions import compute_interaction, interaction_table, state_interaction
from minihuman.reporting.result_tables import list_missing_parts
from minihuman.reporting.results import Results
from minihuman.reporting.sections import quality_section
from minihuman.reporting.statements import difference_statement, paired_statement
from minihuman.reporting.template import ReportFigure, format_number
from minihuman.reporting.within_results import compare_within
from minihuman.statistics.comparison import compare_groups
from minihuman.statistics.paired import compare_conditions
from tests.builders import session
from tests.report.pages import page
from tests.report.test_results import played
from tests.report.test_sessions import two_days

TWO_GROUPS = (Factor("group", ("a", "b"), is_within=False),)
MINUS = "\N{MINUS SIGN}"
TIMES = "\N{MULTIPLICATION SIGN}"


def compared(a: list[float], b: list[float]) -> str:
    rows = pd.DataFrame({"group": ["a"] * len(a) + ["b"] * len(b), "success": a + b})
    (comparison,) = compare_groups(rows, ["success"])
    return difference_statement(comparison, "room")


def block_of_teams(episodes_of: str = "played") -> tuple[pd.DataFrame, pd.DataFrame, dict[str, str]]:
    """Rows, episodes and units of three teams of two people in group a, and of six people in b."""
    rows, episodes = played(6)
    if episodes_of == "points":  # collected, without a goal to reach
        episodes = episodes.assign(success=False, outcome="timeout", reward=20.0)
    return rows, episodes, {f"a-{number}": f"team-{number // 2}" for number in range(6)}


def test_simulated_times_are_called_the_simulated_players() -> None:
    quality = measure_recording_quality(session(episodes=1, blocks=("grid",)))
    simulated = replace(quality, displays=({"window": "simulated"},))
    lead = quality_section([simulated, simulated]).lead
    assert lead.startswith("2 sessions were simulated: reaction and playing times are the simulated player's")
    assert quality_section([replace(quality, displays=())]).lead.startswith("1 session recorded no display")


def test_an_episode_of_a_team_counts_once() -> None:
    rows, episodes, units = block_of_teams()
    block = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec(), units)
    assert block.waits.without_goal == ["a 3 of 9", "b 6 of 18"]
    assert block.episodes == 9 + 18


def test_episodes_without_the_goal_are_of_a_group_only_where_there_are_several() -> None:
    rows, episodes = played(6)
    block = compute_block_results("grid", rows[rows["group"] == "a"], episodes, ["a"], AnalysisSpec())
    assert block.waits.without_goal == ["6 of 18"]


def test_too_few_teams_are_called_teams() -> None:
    rows, episodes, units = block_of_teams()
    episodes.loc[episodes["episode_in_block"] == 1, "reward"] = 0.0
    block = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec(), units)
    assert list_missing_parts(block.parts)[0] == f"odds, a {MINUS} b: fewer than 4 teams in a"


def test_where_points_are_collected_nothing_is_said_of_a_goal() -> None:
    rows, episodes, units = block_of_teams("points")
    block = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec(), units)
    assert block.waits.without_goal == []
    never = compute_block_results("grid", rows, episodes.assign(reward=0.0), ["a", "b"], AnalysisSpec(), units)
    assert never.waits.without_goal == ["a 9 of 9", "b 18 of 18"]


def test_the_smallest_possible_p_and_a_missing_interval_are_called_so() -> None:
    sentence = compared([0.1, 0.2, 0.15], [0.8, 0.9, 0.7, 0.85, 0.95, 0.75])
    assert "(too few for a 95 % interval; permutation p 0.012, the smallest possible with so few;" in sentence
    assert "n/a" not in sentence
    assert "the smallest possible" not in compared([0.1, 0.9, 0.15], [0.8, 0.9, 0.7, 0.85, 0.95, 0.1])


def test_an_answer_ends_in_a_verdict() -> None:
    low, high = [0.1, 0.2, 0.15, 0.12, 0.18], [0.8, 0.9, 0.7, 0.85, 0.95]
    assert compared(low, high).endswith(" The value is larger in b than in a.")
    assert compared(high, low).endswith(" The value is larger in a than in b.")
    assert compared(low, low[::-1]).endswith(" No difference is shown.")


def test_a_verdict_that_correction_undoes_says_so() -> None:
    rows = pd.DataFrame({"group": [*"aaaaabbbbb"], "success": [0.1, 0.2, 0.15, 0.3, 0.5, 0.3, 0.4, 0.6, 0.7, 0.8]})
    (comparison,) = compare_groups(rows, ["success"])
    undone = replace(comparison, p=0.04, p_holm=0.2)
    assert difference_statement(undone, "room").endswith("but not after Holm's correction (as in the tables).")


def test_a_difference_within_participants_that_correction_undoes_is_not_shown_after_it() -> None:
    (comparison,) = compare_conditions({"log_excess_steps_mean": conditions()[["near-open", "near-doors"]]})
    undone = paired_statement(replace(comparison, p=0.03, p_holm=0.06))
    assert undone.endswith("12 participants). After Holm's correction no difference is shown.")
    ratio = math.exp(comparison.difference)
    assert f"; as a ratio of excess steps + 1: {format_number(ratio)}, " in undone


def conditions(shift: float = 1.0) -> pd.DataFrame:
    rng = np.random.default_rng(4)
    means = {"near-open": 1.0, "near-doors": 1.0 + shift, "far-open": 2.0, "far-doors": 2.0 + shift}
    return pd.DataFrame({name: mean + rng.normal(0, 0.1, 12) for name, mean in means.items()})


def test_the_means_of_a_contrast_are_means() -> None:
    table = conditions()
    twice = {"far-doors": 1.0, "near-doors": 1.0, "far-open": -1.0, "near-open": -1.0}
    half = {name: weight / 2 for name, weight in twice.items()}
    of_sums, of_means = compare_conditions({"success": table}, contrasts={"sums": twice, "means": half})
    assert of_sums.means == pytest.approx(of_means.means)
    assert of_means.means[0] == pytest.approx(table[["far-doors", "near-doors"]].to_numpy().mean())
    assert of_sums.difference == pytest.approx(2 * of_means.difference)
    assert paired_statement(of_means).endswith(" The positive side of the contrast is larger.")


def test_contrasts_are_defined_with_their_direction() -> None:
    rows = (
        conditions().melt(var_name="block", value_name="success", ignore_index=False).reset_index(names="participant")
    )
    rows = rows.assign(group="a", session=1, participant=rows["participant"].astype(str))
    doors = Contrast("doors", (("near-doors", 0.5), ("far-doors", 0.5), ("near-open", -0.5), ("far-open", -0.5)))
    apart = Contrast("apart", (("far-doors", 1.0), ("near-open", 1.0), ("far-open", -1.0), ("near-doors", -1.0)))
    design = ExperimentDesign(primary_effect="conditions", contrasts=(doors, apart))
    analysis = AnalysisSpec(primary_measure="success", conditions=tuple(conditions().columns))
    within = compare_within(rows, analysis, design.contrasts)
    answers = state_answers(Results((), "", ("a",), within, (12, 48)), None, design, "")
    assert answers[-1] == (
        "Contrasts, in this direction: doors: the mean of near-doors and far-doors minus the mean of near-open and "
        "far-open; apart: (far-doors + near-open) minus (far-open + near-doors)."
    )


def reaction_times(n_conditions: int = 2) -> pd.DataFrame:
    rng = np.random.default_rng(3)
    return pd.DataFrame(
        {"participant": f"{group}{who}", "group": group, "block": f"c{at}", "session": 1}
        | {"response_median_ms": float(np.exp(rng.normal(6, 0.2)))}
        for group in "ab"
        for who in range(9)
        for at in range(n_conditions)
    )


def test_a_ratio_of_times_is_written_as_a_ratio_with_a_verdict() -> None:
    design = ExperimentDesign((*TWO_GROUPS, Factor("condition", ("c0", "c1"), is_within=True)), "", "interaction")
    design = replace(design, condition_of_block=(("c0", "c0"), ("c1", "c1")))
    analysis = AnalysisSpec(primary_measure="response_median_ms")
    found = compute_interaction(reaction_times(), design, analysis, ("a", "b"))
    assert found is not None
    (sentence,) = state_interaction(found)
    apart = reaction_times()
    slower = (apart["group"] == "b") & (apart["block"] == "c0")
    apart.loc[slower, "response_median_ms"] *= 3.0
    larger = compute_interaction(apart, design, analysis, ("a", "b"))
    assert larger is not None
    assert next(state_interaction(larger)).endswith(" The ratio between conditions is larger in b than in a.")
    assert ": c0 / c1, a / b is \N{MULTIPLICATION SIGN}" in sentence
    assert sentence.endswith(" The ratio between conditions is not shown to depend on the group.")
    assert "c0 / c1" in interaction_table(found).rows[0]
    doors = (Contrast("x", (("c0", 1.0), ("c1", -1.0))), Contrast("y", (("c0", -1.0), ("c1", 1.0))))
    several = compute_interaction(reaction_times(), replace(design, contrasts=doors), analysis, ("a", "b"))
    assert several is not None
    first, *pairs = state_interaction(several)
    assert first == (
        "Median reaction time (ms), interaction of group and condition: in none of 2 comparisons is a ratio between "
        "conditions shown to depend on the group (in brackets 95 % intervals; p by permutation, after Holm; 9 in a, 9 "
        "in b)."
    )
    assert [pair.partition(" (")[0] for pair in pairs] == [
        f"{contrast}: a / b {TIMES}{format_number(math.exp(sign * found.headline[0].groups.difference))}"
        for contrast, sign in (("x", 1), ("y", -1))
    ]
    assert all(pair.endswith(f"), p {several.headline[0].groups.p_holm:.3f}.") for pair in pairs)
    shown = compute_interaction(apart, replace(design, contrasts=doors), analysis, ("a", "b"))
    assert shown is not None
    assert (
        "in 2 of 2 comparisons a ratio between conditions depends on the group: x is larger in b than in a; y is "
        "larger in a than in b (in brackets"
    ) in next(state_interaction(shown))


def test_changes_between_sessions_come_before_the_mean_over_them() -> None:
    rows, episodes = two_days()
    block = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec())
    answers = state_answers(Results((block,), "grid", ("a", "b"), None, (16, 62)), None, ExperimentDesign(), "grid")
    assert [sentence.partition(" block grid")[2][:33] for sentence in answers[:3]] == [
        ", from session 1 to 2, difference",
        ", from session 1 to 2: a changes ",
        ", from session 1 to 2: b changes ",
    ]
    assert answers[0].endswith(" The value is larger in a than in b.")
    assert answers[1].endswith(")."), "that one changes and the other does not would not tell them apart"
    assert answers[3].startswith("Mean over the sessions. Reward, block grid: a minus b is ")


def test_a_cell_of_which_a_third_is_at_the_limit_is_named_first() -> None:
    rows, episodes = played(6)
    late = episodes.assign(
        success=episodes["success"] & ((episodes["group"] == "b") | (episodes["episode_in_block"] > 2))
    )
    answers = {}
    for name, part in (("few", episodes), ("many", late)):
        block = compute_block_results("grid", rows, part, ["a", "b"], AnalysisSpec())
        results = Results((block,), "grid", ("a", "b"), None, (12, 36))
        answers[name] = state_answers(results, None, ExperimentDesign(), "grid")
    assert answers["few"][-1].startswith(
        "The measure counts an episode that did not reach the goal with its worst value ("
    )
    assert not any("at the limit" in sentence for sentence in answers["few"])
    assert "Many values are at the limit" in answers["many"][-1]
    assert "did not reach the goal (grid of a 12 of 18)." in answers["many"][-1]


def test_the_page_speaks_of_groups_only_where_there_are_several() -> None:
    assert name_allocated([], has_groups=False, has_keys=True) == "Keys"
    assert name_allocated([], has_groups=True, has_keys=True) == "Groups and keys"


def test_trials_are_called_trials_and_the_links_lead_to_the_paths(tmp_path: Path) -> None:
    assert "0 trials are included" in re.sub(r"\s+", " ", page(are_trials=True))
    png = tmp_path / "paths.png"
    png.write_bytes(b"")
    text = page(figures=[ReportFigure("", png, "Paths of one.")])
    assert '<li><a href="#paths">Paths</a></li>' in text
    assert "<summary>A participant</summary>" in text
    assert "#paths" not in page()
