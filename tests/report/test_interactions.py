"""A mixed design: its value, what the protocol may state of it, and the interaction that answers its question."""

import numpy as np
import pandas as pd
import pytest

from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign, Factor, derive_design
from minihuman.reporting.interactions import compute_interaction, state_interaction
from minihuman.reporting.within_results import compare_within, measure_levels
from minihuman.statistics.permutation import permutation_tests

GROUPS = '[[groups]]\nname = "a"\nblocks = ["low", "high"]\n[[groups]]\nname = "b"\nblocks = ["low", "high"]\n'
BLOCK = """
[[blocks]]
name = "{name}"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 20
options = {{ size = {size} }}
"""


def read(design="", groups=GROUPS, conditions='conditions = ["low", "high"]'):
    blocks = "".join(BLOCK.format(name=name, size=size) for name, size in (("low", 5), ("high", 6)))
    text = (
        '[study]\nname = "mixed"\nversion = "1"\nseed = 1\nparticipants = 8\n[keys]\npool = ["1", "2", "3"]\n'
        f'[analysis]\nprimary_measure = "reward_mean"\n{conditions}\n{design}\n{groups}\n{blocks}'
    )
    return decode_protocol(text.encode())


def block_rows(shift):
    rng = np.random.default_rng(5)
    return pd.DataFrame(
        {"participant": f"{group}{who}", "group": group, "block": block, "session": 1,
         "reward_mean": rng.normal(shift if (group, block) == ("a", "high") else 0.0)}
        for group, people in (("a", 9), ("b", 14)) for who in range(people) for block in ("low", "high")
    )  # fmt: skip


def test_a_design_follows_from_groups_and_conditions():
    mixed = derive_design(read())
    assert [(factor.name, factor.levels, factor.is_within) for factor in mixed.factors] == [
        ("group", ("a", "b"), False), ("condition", ("low", "high"), True),
    ]  # fmt: skip
    assert mixed.is_mixed
    assert mixed.primary_effect == "interaction"
    assert derive_design(read(conditions="")).primary_effect == "groups"
    alone = derive_design(read(groups=GROUPS.partition('[[groups]]\nname = "b"')[0]))
    assert (alone.primary_effect, alone.is_mixed) == ("conditions", False)


def test_conditions_are_levels_of_an_option_where_the_protocol_says_so():
    assert derive_design(read('[design]\ncondition = "option:size"')).conditions == ("5", "6")


@pytest.mark.parametrize(
    ("design", "words"),
    [
        ('condition = "option:colour"', "block 'low' does not set"),
        ('condition = "size"', "write option:NAME"),
        ('contrasts = [{ name = "x", weights = { low = 1, medium = -1 } }]', "conditions: high, low"),
        ('contrasts = [{ name = "x", weights = { low = 1, high = 1 } }]', "sum to 0"),
        ('contrasts = [{ name = "x", weights = { low = 0, high = 0 } }]', "no finite weight"),
    ],
)
def test_a_design_that_the_study_does_not_have_is_refused(design, words):
    with pytest.raises(ProtocolError, match=words):
        read(f"[design]\n{design}")


def test_an_interaction_of_one_degree_of_freedom_is_the_groups_test_of_contrast_scores():
    protocol, rows = read(), block_rows(3.0)
    found = compute_interaction(rows, derive_design(protocol), protocol.analysis, ("a", "b"))
    (compared,) = found.contrasts
    wide = rows.pivot(index=["group", "participant"], columns="block", values="reward_mean")
    scores = wide["low"] - wide["high"]
    (test,) = permutation_tests([(scores["a"].to_numpy(), scores["b"].to_numpy())])
    assert (compared.groups.p, compared.groups.interval) == (test.p(), test.interval())
    assert found.omnibus == ()
    (sentence,) = state_interaction(found)
    assert "low - high, a - b is -" in sentence.replace("\N{MINUS SIGN}", "-")
    assert "9 and 14 participants" in sentence


def test_an_interaction_of_several_degrees_of_freedom_is_answered_in_a_sentence(monkeypatch):
    monkeypatch.setattr("minihuman.statistics.interaction.RESAMPLES", 199)
    design = ExperimentDesign(
        factors=(Factor("group", ("a", "b"), is_within=False), Factor("condition", ("x", "y", "z"), is_within=True)),
        condition_of_block=(("x", "x"), ("y", "y"), ("z", "z")),
    )
    analysis = AnalysisSpec(primary_measure="reward_mean")
    for shift, verdict in ((0.0, "are not shown to depend"), (4.0, "depend")):
        rng = np.random.default_rng(8)
        rows = [
            (group, f"{group}{who}", block, 1, rng.normal(shift if (group, block) == ("a", "z") else 0.0))
            for group in "ab" for who in range(10) for block in "xyz"
        ]  # fmt: skip
        frame = pd.DataFrame(rows, columns=["group", "participant", "block", "session", "reward_mean"])
        (sentence,) = state_interaction(compute_interaction(frame, design, analysis, ("a", "b")))
        assert f"differences between conditions {verdict} on the group (permutation p" in sentence
        assert " of their variance, 90 % interval " in sentence
        assert sentence.endswith("; 10 in a, 10 in b).")


def test_a_participant_without_a_condition_is_left_out_and_said_so():
    protocol, rows = read(), block_rows(0.0)
    found = compute_interaction(rows.iloc[1:], derive_design(protocol), protocol.analysis, ("a", "b"))
    assert found.contrasts[0].groups.n == (8, 14)
    assert [*state_interaction(found)][-1].startswith("1 participants without a value in every condition")


def test_groups_alone_have_no_interaction():
    protocol = read(conditions="")
    assert compute_interaction(block_rows(0.0), derive_design(protocol), protocol.analysis, ("a", "b")) is None


def test_levels_of_a_label_of_trials_are_conditions_that_groups_are_crossed_with():
    rng = np.random.default_rng(6)
    rows = [
        {"group": group, "participant": f"{group}{who}", "session": 1, "labels": f'{{"cue": "{level}"}}',
         "success": bool(rng.random() < (0.2 if (group, level) == ("a", "late") else 0.9)), "reward": 0.0,
         "response_median_ms": 500.0}
        for group in "ab" for who in range(8) for level in ("early", "late") for _ in range(20)
    ]  # fmt: skip
    levels = measure_levels(pd.DataFrame(rows), "cue")
    groups = Factor("group", ("a", "b"), is_within=False)
    design = ExperimentDesign((groups,), primary_effect="interaction", condition_label="cue").add_levels(
        ("early", "late")
    )
    found = compute_interaction(levels, design, AnalysisSpec(primary_measure="success"), ("a", "b"))
    (compared,) = found.contrasts
    assert (found.conditions, compared.contrast, compared.groups.n) == (
        ("early", "late"), "early \N{MINUS SIGN} late", (8, 8),
    )  # fmt: skip
    assert compared.groups.difference == pytest.approx(0.7, abs=0.15)
    assert compared.groups.p < 0.01


def test_a_contrast_of_a_level_that_no_trial_has_is_not_compared():
    contrast = Contrast("early or never", (("early", 1.0), ("never", -1.0)))
    groups = Factor("group", ("a", "b"), is_within=False)
    design = ExperimentDesign((groups,), contrasts=(contrast,), condition_label="cue").add_levels(("early", "late"))
    rows = block_rows(0.0).replace({"block": {"low": "early", "high": "late"}})
    analysis = AnalysisSpec(primary_measure="reward_mean", conditions=("early", "late"))
    found = compute_interaction(rows, design, analysis, ("a", "b"))
    assert "not compared (" in " ".join(state_interaction(found))
    assert compare_within(rows, analysis, design.contrasts).comparisons == ()
