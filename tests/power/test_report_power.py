"""Power that counts what the report's page says: the same p as the report's, and known rejection rates."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign, Factor, derive_design
from minihuman.planning.report_power import (
    ReportPool,
    StudyDesign,
    compare_study,
    draw_study,
    estimate_report_power,
    make_report_pool,
    plan_report_power,
)
from minihuman.reporting.block_measures import MEASURES
from minihuman.reporting.block_results import compute_block_results
from minihuman.reporting.interactions import compute_interaction
from minihuman.reporting.within_results import compare_labels, compare_within, measure_levels, select_measures
from minihuman.statistics.paired import paired_test
from minihuman.statistics.permutation import permutation_tests
from minihuman.statistics.t_tests import t_test_power
from tests.counts import count
from tests.power.test_command import PROTOCOL

CONDITIONS = ("narrow", "wide")


NAMED = AnalysisSpec(primary_measure="reward_mean", conditions=CONDITIONS)


def pool(analysis=NAMED, ratios=(1, 1), people=300):
    """Normal rewards of many participants in two blocks over two days, and three other measures that are noise."""
    rng = np.random.default_rng(5)
    rows = pd.DataFrame(
        {"group": group, "session": session, "block": block, "keys_total": 0, "exclusion_reason": None, "episodes": 2}
        | dict.fromkeys(("participant", "person", "drawn"), f"{group}{number}")
        | dict.fromkeys(MEASURES, np.nan)
        | {"reward_mean": rng.normal(), "success": rng.random(), "spl_mean": rng.normal(), "steps_at_limit_mean": 5.0}
        for group in ("a", "b")
        for number in range(people)
        for session in (1, 2)
        for block in CONDITIONS
    )
    return ReportPool(rows, dict(zip(("a", "b"), ratios, strict=True)), analysis, "wide")


@pytest.mark.parametrize("primary", ["reward_mean", ""])
def test_its_p_are_the_reports(primary):
    analysis = AnalysisSpec(primary_measure=primary, conditions=CONDITIONS)
    drawn_from = pool(analysis, ratios=(1, 2))
    rng = np.random.default_rng(1)
    for on in ("groups", "change", "conditions"):
        rows = draw_study(drawn_from, StudyDesign(0.8, on, drop_out=0.1), 9, rng)
        theirs = rows[rows["block"] == "wide"].assign(episodes=2, reward_sd=0.1)
        episodes = theirs[["group", "participant", "session"]].assign(
            world="w", episode_in_block=1, reward=0.5, playing_s=1.0, steps=4, success=False, exclusion_reason=None,
            max_steps=9, outcome="timeout",
        )  # fmt: skip
        report = compute_block_results("wide", theirs, episodes, ["a", "b"], analysis)
        measure = primary or report.headline[0].measure
        expected = {
            "groups": [one.p_holm for one in report.comparisons if one.measure == measure],
            "change": [one.p_holm for _, one in report.changes_compared if one.measure == measure],
            "conditions": [one.p_holm for one in compare_within(rows, analysis).comparisons if one.measure == measure],
        }[on]
        assert [p for _, p in compare_study(rows, drawn_from, on)] == pytest.approx(expected)
        assert expected


def test_a_shift_of_the_interaction_moves_one_cell_and_its_p_is_the_reports():
    factors = Factor("group", ("a", "b"), is_within=False), Factor("condition", CONDITIONS, is_within=True)
    design = ExperimentDesign(factors, "", "interaction", tuple((name, name) for name in CONDITIONS))
    drawn_from = dataclasses.replace(pool(people=30), design=design)
    still, moved = (
        draw_study(drawn_from, StudyDesign(shift, "interaction"), 20, np.random.default_rng(4)) for shift in (0.0, 2.0)
    )
    by = (moved["reward_mean"] - still["reward_mean"]).groupby([moved["group"], moved["block"]]).mean()
    assert by["a", "narrow"] > 1
    assert by.drop(("a", "narrow")).to_numpy() == pytest.approx(0)
    report = compute_interaction(moved, design, NAMED, ("a", "b"))
    ((name, p),) = compare_study(moved, drawn_from, "interaction")
    assert (name, p) == ("reward_mean: narrow \N{MINUS SIGN} wide, a - b", report.contrasts[0].groups.p)
    assert p < 0.01


def test_groups_have_their_ratio_and_some_drop_out():
    rows = draw_study(pool(ratios=(1, 2)), StudyDesign(drop_out=0.5), 40, np.random.default_rng(2))
    there = rows.groupby(["group", "session"])["participant"].nunique()
    assert 8 <= there["a", 1] <= 32
    assert 25 <= there["b", 1] <= 55
    assert there["a", 2] < there["a", 1]


@pytest.mark.nightly(sample=True)
def test_power_for_normal_participants_is_the_textbooks():
    drawn_from, studies = pool(), count(60, 2000)
    only_first = drawn_from.rows[drawn_from.rows["session"] == 1]
    drawn_from = dataclasses.replace(drawn_from, rows=only_first)
    (null,) = estimate_report_power(drawn_from, StudyDesign(), [15], studies=studies, seed=1)
    (groups,) = estimate_report_power(drawn_from, StudyDesign(0.8), [26], studies=studies, seed=1)
    (within,) = estimate_report_power(drawn_from, StudyDesign(0.8, "conditions"), [10], studies=studies, seed=1)
    paired = scipy.stats.nct(19, 0.8 / np.sqrt(2) * np.sqrt(20)).sf(scipy.stats.t.ppf(0.975, 19))
    print(null, groups, within, t_test_power(0.8, (26, 26)), paired)
    assert null.low - 0.03 <= 0.05 <= null.high + 0.03
    assert groups.low - 0.03 <= t_test_power(0.8, (26, 26)) <= groups.high + 0.03
    assert within.low - 0.04 <= paired <= within.high + 0.04


def test_a_design_that_is_none_is_refused():
    with pytest.raises(ReportError, match="--on 'days' is unknown"):
        StudyDesign(on="days")
    with pytest.raises(ReportError, match="--drop-out 1 is not valid; use a probability"):
        StudyDesign(drop_out=1)
    with pytest.raises(ReportError, match=r"write it as shift=0\.5"):
        plan_report_power(b"", "shift=much", [5], studies=10, people=4, player="human-like", seed=1)
    alone = pool(AnalysisSpec(primary_measure="reward_mean"))
    with pytest.raises(ReportError, match="has no comparison of"):
        estimate_report_power(alone, StudyDesign(on="conditions"), [5], studies=1, seed=1)


def test_whole_sessions_of_a_protocol_make_the_pool():
    toml = PROTOCOL.encode() + b'[analysis]\nprimary_measure = "success"\n'
    estimates, text = plan_report_power(
        toml, "shift=0.5", [4], drop_out=0.1, studies=10, people=4, player="human-like", seed=1
    )
    assert [one.measure for one in estimates] == ["success: one - other"]
    assert "after its corrections" in text


def tables(rows, teams=()):
    """A study's tables for a pool: of blocks, and who was in which team."""
    return {"blocks": rows.drop(columns=["person", "drawn"]), "teams": pd.DataFrame(teams, columns=TEAM)}


TEAM = ["block", "participant", "team"]
TWO_GROUPS = decode_protocol(
    PROTOCOL.replace('"one"', '"a"').replace('"other"', '"b"').replace('"grid"', '"wide"').encode()
    + b'[analysis]\nprimary_measure = "reward_mean"\n',
    "two groups",
)


def first_day(drawn_from):
    rows = drawn_from.rows
    return rows[(rows["session"] == 1) & (rows["block"] == "wide")].reset_index(drop=True)


def test_the_difference_is_the_designs_whatever_that_of_the_simulated_groups():
    rows = first_day(pool())
    rows["reward_mean"] += np.where(rows["group"] == "a", 0.5, 0.0)
    drawn_from = make_report_pool(TWO_GROUPS, tables(rows))
    spread = rows.groupby("group")["reward_mean"].std().mean()
    for shift in (0.0, 0.8):
        study = draw_study(drawn_from, StudyDesign(shift), 20_000, np.random.default_rng(1))
        means = study.groupby("group")["reward_mean"].mean()
        assert means["a"] - means["b"] == pytest.approx(shift * spread, abs=0.04)


@pytest.mark.parametrize("shift", [1.2, -1.2])
def test_no_share_of_successes_leaves_0_to_1(shift):
    rows = first_day(pool())
    rows["episodes"], rows["success"] = (
        4,
        np.random.default_rng(3).binomial(4, 0.3 if shift < 0 else 0.7, len(rows)) / 4,
    )
    drawn_from = dataclasses.replace(
        make_report_pool(TWO_GROUPS, tables(rows)), analysis=AnalysisSpec(primary_measure="success")
    )
    study = draw_study(drawn_from, StudyDesign(shift), 20_000, np.random.default_rng(1))
    assert set(study["success"]) == {0, 0.25, 0.5, 0.75, 1}
    means = study.groupby("group")["success"].mean()
    assert means["a"] - means["b"] == pytest.approx(shift * rows.groupby("group")["success"].std().mean(), abs=0.02)


def test_teams_are_drawn_whole_and_are_the_units():
    rows = first_day(pool(people=20))
    teams = [("wide", who, f"team-{number // 2}") for number, who in enumerate(rows["participant"])]
    drawn_from = make_report_pool(TWO_GROUPS, tables(rows, teams))
    study = draw_study(drawn_from, StudyDesign(), 12, np.random.default_rng(1))
    assert len(study) == 24
    assert study.groupby("participant")["person"].nunique().tolist() == [2] * 12
    values = study.groupby(["group", "participant"])["reward_mean"].mean()
    expected, _ = permutation_tests([(values["a"].to_numpy(), values["b"].to_numpy())] * 2)
    assert dict(compare_study(study, drawn_from, "groups")) == {"reward_mean: a - b": expected.p()}


def test_excluded_participants_take_places_of_the_groups():
    rows = first_day(pool(people=50))
    rows["exclusion_reason"] = np.where(rows.groupby("group").cumcount() < 25, "asleep", None)
    drawn_from = make_report_pool(TWO_GROUPS, tables(rows))
    study = draw_study(drawn_from, StudyDesign(), 400, np.random.default_rng(1))
    assert study.groupby("group").size().between(150, 250).all()


LABELS = """
study = {{ name = "flanker", version = "1", seed = 3 }}
keys = {{ pool = ["left", "right"], keyboard_check = false }}
analysis = {{ primary_measure = "response_median_ms", conditions = ["label:cue"] }}
groups = [{{ name = "a", parts = ["trials"] }}, {{ name = "b", parts = ["trials"] }}]
[[blocks]]
name = "trials"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = {episodes}
actions = ["left", "right"]
max_steps = 1
"""


def trials_pool(people, rng):
    """Reaction times of trials with two labels; times of one label are longer, participants differ in both."""
    people_rows = [(group, f"{group}{number}", rng.normal(6, 0.3, 2)) for group in "ab" for number in range(people)]
    episodes = pd.DataFrame(
        [
            {"group": group, "participant": code, "session": 1, "block": "trials", "exclusion_reason": None,
             "labels": f'{{"cue": "{level}"}}', "success": True, "reward": 1.0,
             "response_median_ms": float(np.exp(value + rng.normal(0, 0.2)))}
            for group, code, levels in people_rows
            for level, value in zip(("early", "late"), levels, strict=True)
            for _ in range(5)
        ]
    )  # fmt: skip
    blocks = episodes.groupby(["group", "participant", "session", "block"], as_index=False).agg(
        response_median_ms=("response_median_ms", "median"), episodes=("reward", "size")
    )
    blocks = blocks.assign(exclusion_reason=None, keys_total=0, reward_mean=1.0, success=1.0)
    return {"episodes": episodes, "blocks": blocks.reindex(columns=[*blocks, *(set(MEASURES) - {*blocks})]),
            "teams": pd.DataFrame(columns=["participant", "team", "block"])}  # fmt: skip


@pytest.mark.parametrize("on", ["conditions", "interaction"])
def test_levels_of_a_label_are_drawn_from_trials_and_their_p_are_the_reports(on):
    rng = np.random.default_rng(4)
    protocol = decode_protocol(LABELS.format(episodes=10).encode())
    drawn_from = make_report_pool(protocol, trials_pool(40, rng)).select_comparison(on)
    assert drawn_from.analysis.conditions == ("early", "late")
    rows = draw_study(drawn_from, StudyDesign(1.5, on), 12, rng)
    cells = np.log(rows["response_median_ms"]).groupby([rows["group"], rows["block"]]).mean()
    moved = cells["a", "early"] - cells["a", "late"]
    assert moved == pytest.approx(1.5 * 0.3, abs=0.3)
    ((name, p),) = compare_study(rows, drawn_from, on)
    wide = np.log(rows.pivot(index=["group", "participant"], columns="block", values="response_median_ms"))
    scores = wide["early"] - wide["late"]
    if on == "conditions":
        assert p == paired_test(scores.to_numpy()).p()
    else:
        (test,) = permutation_tests([(scores["a"].to_numpy(), scores["b"].to_numpy())])
        assert p == test.p()
    assert "early" in name


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("on", ["conditions", "interaction"])
def test_power_by_label_is_the_share_of_new_studies_whose_report_finds_the_effect(on):
    """New participants have the effect in each trial; power has a pool of others without it."""
    rng = np.random.default_rng(6)
    studies, size, shift = count(40, 2_000), 16, 0.8
    protocol = decode_protocol(LABELS.format(episodes=10).encode())
    drawn_from = make_report_pool(protocol, trials_pool(count(150, 1_000), rng))
    (power,) = estimate_report_power(drawn_from, StudyDesign(shift, on), [size], studies=studies, seed=1)
    sd = math.hypot(0.3, 0.2 * math.sqrt(math.pi / 2 / 5))  # of a participant's median of five trials
    found = 0
    for _ in range(studies):
        tables = trials_pool(size, rng)
        episodes = tables["episodes"]
        has_effect = episodes["labels"].str.contains("early") & ((on == "conditions") | (episodes["group"] == "a"))
        times = episodes["response_median_ms"] * np.exp(shift * sd * has_effect)
        levels = measure_levels(episodes.assign(response_median_ms=times), "cue")
        if on == "conditions":
            within = compare_labels(episodes.assign(response_median_ms=times), protocol.analysis)
            found += within.comparisons[0].p_holm < 0.05
        else:
            design = derive_design(protocol).add_levels(("early", "late"))
            analysis = select_measures(protocol.analysis, levels)
            interaction = compute_interaction(levels, design, analysis, ("a", "b"))
            found += interaction.contrasts[0].groups.p_holm < 0.05
    print(f"labels, {on}: power {power.power:.3f}, reports {found / studies:.3f} of {studies}")
    error = math.sqrt(2 * 0.25 / studies)
    assert abs(power.power - found / studies) < 0.03 + 3 * error
