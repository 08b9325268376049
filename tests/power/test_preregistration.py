from pathlib import Path

import pytest

import minihuman
from minihuman.errors import ReportError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.planning.preregistration import build_preregistration, write_preregistration
from tests.seats.test_drawn_group import STUDY

TOML = (Path(__file__).parents[2] / "protocols" / "fourrooms-transfer.toml").read_bytes()
NAMED = (
    TOML
    + b"""
[analysis]
primary_measure = "log_excess_steps_mean"
secondary_measures = ["success"]
equivalence_margin = 0.1
"""
)


def of(toml: bytes) -> str:
    protocol = decode_protocol(toml)
    return build_preregistration(
        protocol, expand_protocol(protocol, enrol_participant(protocol, 0)), power="0.85 at 20"
    )


def test_what_the_protocol_fixes_is_in_it():
    protocol = decode_protocol(NAMED)
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    said = of(NAMED)
    for part in (
        plan.protocol_sha256,
        plan.allocation_sha256,
        "Primary: log_excess_steps_mean",
        "Secondary: success",
        "less than 0.1",
        "10 episodes in minihuman/MiniWorld-FourRooms-v0",
        "A participant whose completed_share is below 0.5",
        "60 places (30 in grid-first, 30 in direct)",
        "0.85 at 20",
        "Hypotheses",
        "Groups are compared on block first-person",
        "a layout for every episode, drawn for each participant",
        "on the keys of the block before where one was played",
        "Left out unless named here",
        "Differences are grid-first minus direct.",
        "Group grid-first goes through grid, then first-person.",
        f"minihuman {minihuman.__version__}",
        "Holm's correction",
        "ln(1 + steps \N{MINUS SIGN} shortest)",
    ):
        assert part in said


def test_the_ratio_of_steps_is_a_measure_where_it_is_named_alone():
    assert "- `log_steps_ratio_mean`: log of steps" not in of(TOML)
    said = of(NAMED.replace(b"log_excess_steps_mean", b"log_steps_ratio_mean"))
    assert "Primary: log_steps_ratio_mean" in said
    assert "ln(steps / shortest)" in said


def test_a_study_that_names_no_primary_measure_is_told_so():
    assert "No primary measure is named" in of(TOML)
    assert "with Holm's correction over all of them" in of(TOML)


def test_one_group_is_compared_with_nobody():
    alone = TOML[: TOML.index(b'[[groups]]\nname = "direct"')] + TOML[TOML.index(b"[[blocks]]") :]
    assert "There is one group, so nothing is compared." in of(alone)


def test_a_preregistration_is_not_written_over(tmp_path):
    protocol = decode_protocol(TOML)
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    assert (
        write_preregistration(protocol, plan, tmp_path / "out.md")
        .read_text()
        .startswith("# Preregistration of fourrooms-transfer")
    )
    with pytest.raises(ReportError, match="already exists"):
        write_preregistration(protocol, plan, tmp_path / "out.md")


def test_strata_are_told_with_the_question_and_their_lists():

    said = build_preregistration(STUDY, expand_protocol(STUDY, enrol_participant(STUDY, 0)), power="")
    assert "a list of 60 places" in said
    assert "after the answer to you.hand: the next place of their stratum (left, right)" in said
    assert "30 places (groups in ratio 2:1)" in said
