"""Measures that are no column of the table of blocks, and blocks compared within participants, up to the page."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from minihuman.dataset.tables import select
from minihuman.errors import ProtocolError, ReportError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.reporting.block_results import compare_adjusted
from minihuman.reporting.study_measures import add_measures, find_measure
from minihuman.runtime.simulated_session import simulate
from tests.lab_package import EXTENDING, install_lab as install_lab
from tests.report.reports import write_report

PROTOCOL = """
[study]
name = "within"
version = "1"
seed = 5
participants = 8
[keys]
pool = ["1", "2", "3"]
[[groups]]
name = "one"
[[groups]]
name = "other"
[[sessions]]
name = "only"
parts = ["about", "both"]
[[orders]]
name = "both"
parts = ["narrow", "wide"]
order = "latin-square"
[[questions]]
name = "about"
[[questions.items]]
name = "age"
kind = "number"
ask = "Your age?"
[[blocks]]
name = "narrow"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
[[blocks]]
name = "wide"
world = "minihuman/MiniGrid-Empty-8x8-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 40
[analysis]
primary_measure = "steps_at_limit_mean"
secondary_measures = ["pauses:0", "block:narrow/success"]
conditions = ["narrow", "wide"]
covariates = ["answer:about.age"]
[design]
primary_effect = "groups"
"""


@pytest.mark.program
def test_a_labs_measure_an_answer_and_conditions_reach_the_page(tmp_path: Path, install_lab) -> None:
    (code,) = re.findall(r'```python title="measures.py"\n(.*?)```', EXTENDING, re.S)
    install_lab("a-lab", code, measures=["pauses = a_lab:LongPauses"])
    for _ in simulate(decode_protocol(PROTOCOL.encode()), tmp_path, participants=8, seed=1, player="random"):
        pass
    page, *tables = write_report(select(tmp_path / "within", processes=1), tmp_path / "out")
    text = re.sub(r"\s+", " ", page.read_text())
    asked = "steps to the goal between groups one and other in block wide, and within participants between blocks"
    assert f"Asked: differences in {asked}" in text
    assert text.index("within participants: narrow minus wide is \N{MINUS SIGN}") < text.index("<nav>")
    assert "Adjusted for the covariates. Steps to the goal, block wide" in text
    assert "Blocks narrow and wide. Each comparison is over the participants with a value in all conditions" in text
    for words in ("episodes over 0 s", "success in block narrow", ">position<", ">secondary<"):
        assert words in text
    assert ">carry-over<" not in text, "two positions cannot tell it from condition and participants"
    blocks = pd.read_parquet(next(path for path in tables if path.name == "blocks.parquet"))
    wide = blocks.pivot(index="participant", columns="block", values="steps_at_limit_mean")
    difference = (wide["narrow"] - wide["wide"]).mean()
    assert f"narrow minus wide is {difference:+.1f}".replace("-", "\N{MINUS SIGN}")[:-2] in text


def tables() -> dict[str, pd.DataFrame]:
    """Two participants; the load is asked after each block, the age once."""
    asked = [("a", 1, 2, "load", 10.0), ("a", 1, 4, "load", 30.0), ("b", 1, 2, "load", 20.0), ("b", 1, 4, "load", 50.0)]
    asked += [("a", 1, 0, "age", 20.0), ("b", 1, 0, "age", 40.0)]
    answers = pd.DataFrame(asked, columns=["participant", "session", "part", "questions", "number"]).assign(item="x")
    played = [("a", 1, "narrow"), ("a", 3, "wide"), ("b", 1, "wide"), ("b", 3, "narrow")]
    parts = pd.DataFrame(played, columns=["participant", "part", "name"]).assign(session=1, what="started")
    blocks = parts[["participant", "session", "name"]].rename(columns={"name": "block"})
    blocks = blocks.assign(exclusion_reason=None, success=[0.1, 0.2, 0.3, 0.4])
    return {"answers": answers, "parts": parts, "blocks": blocks}


def test_an_answer_belongs_to_the_block_before_it_or_to_the_session() -> None:
    found = add_measures(tables()["blocks"], tables(), ["answer:load.x", "answer:age", "block:narrow/success"])
    assert found["answer:load.x"].tolist() == [10.0, 30.0, 20.0, 50.0]
    assert found["answer:age"].tolist() == [20.0, 20.0, 40.0, 40.0]
    assert found["block:narrow/success"].tolist() == [0.1, 0.1, 0.4, 0.4]


@pytest.mark.parametrize("name", ["answer:", "teaching:speed", "block:narrow", "unheard:of"])
def test_a_measure_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ReportError, match="measure"):
        find_measure(name)


def test_conditions_and_covariates_of_a_protocol_are_checked() -> None:
    for old, new, words in (
        ('conditions = ["narrow", "wide"]', 'conditions = ["narrow"]', "name two or more"),
        ('conditions = ["narrow", "wide"]', 'conditions = ["narrow", "high"]', "'high', which is not a block"),
        ('primary_measure = "steps_at_limit_mean"', "", "adjust the primary measure"),
        ('covariates = ["answer:about.age"]', 'covariates = ["age"]', "'age', which is not a measure"),
    ):
        with pytest.raises(ProtocolError, match=words):
            decode_protocol(PROTOCOL.replace(old, new).encode())


def test_adjusting_takes_out_what_a_covariate_predicts() -> None:
    rng = np.random.default_rng(3)
    age = rng.normal(40, 10, 60)
    group = np.repeat(["a", "b"], 30)
    each = pd.DataFrame({"group": group, "participant": range(60), "answer:age": age})
    each["reward_mean"] = 0.5 * age + 1.0 * (group == "a") + rng.normal(0, 0.5, 60)
    named = AnalysisSpec(primary_measure="reward_mean", covariates=("answer:age",))
    (found,) = compare_adjusted(each, named, ["a", "b"])
    assert found.difference == pytest.approx(1.0, abs=0.4)
    assert np.ptp(found.interval) < 1
    assert found.p < 0.001
    assert compare_adjusted(each, AnalysisSpec(primary_measure="reward_mean"), ["a", "b"]) == ()


def test_slopes_of_few_participants_reject_no_true_null_too_often() -> None:
    rng, rejected = np.random.default_rng(5), 0
    named = AnalysisSpec(primary_measure="reward_mean", covariates=("answer:age", "answer:years"))
    for _ in range(200):
        each = pd.DataFrame({"group": ["a"] * 5 + ["b"] * 5, "answer:age": rng.normal(size=10)})
        each["answer:years"] = rng.normal(size=10)
        each["reward_mean"] = each["answer:age"] + rng.normal(size=10)
        (found,) = compare_adjusted(each, named, ["a", "b"])
        rejected += found.p < 0.05
        assert (found.p < 0.05) == (found.interval[0] > 0 or found.interval[1] < 0)
    assert rejected <= 18  # 200 at 0.05 exceed it in 1 of 100; permuting residuals as known rejected in 0.126


def test_too_few_participants_for_the_slopes_are_a_reason() -> None:
    rng = np.random.default_rng(5)
    each = pd.DataFrame({"group": ["a"] * 4 + ["b"] * 4, "answer:age": rng.normal(size=8)})
    each = each.assign(**{"answer:years": rng.normal(size=8), "reward_mean": rng.normal(size=8)})
    named = AnalysisSpec(primary_measure="reward_mean", covariates=("answer:age", "answer:years"))
    (found,) = compare_adjusted(each, named, ["a", "b"])
    assert np.isnan(found.p)
    assert "too few" in found.reason
