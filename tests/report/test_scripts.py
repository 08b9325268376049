"""The scripts of mixed models that a report writes: they run, find what was put in, and agree with each other."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from minihuman.errors import ReportError
from minihuman.experiment.protocol.study_design import derive_design
from minihuman.reporting.block_measures import MEASURES
from minihuman.reporting.interactions import compute_interaction
from minihuman.reporting.results import compute_results
from minihuman.reporting.scripts import write_scripts
from tests.machine import need, needs
from tests.report.test_interactions import block_rows, read

GROUP, CHANGE, STEEPER = 0.6, -0.15, 0.1  # of group a, per episode, and of a's change


STUDIES = {  # participants, groups, the SD of their own changes per episode
    "own changes": (40, 2, 0.08),
    "own levels alone": (24, 2, 0.0),
    "three groups": (45, 3, 0.08),
}


@pytest.fixture(scope="module", params=STUDIES)
def scripts(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report's folder: groups whose first is GROUP above the others, 8 episodes per participant."""
    n, groups, spread = STUDIES[request.param]
    rng, out = np.random.default_rng(4), tmp_path_factory.mktemp("report")
    rows = []
    for person in range(n):
        group = "abc"[(person + 1) % groups]
        in_a, level, own = group == "a", rng.normal(2, 0.4), rng.normal(0, 1) * spread
        for at in range(1, 9):
            value = level + GROUP * in_a + (CHANGE + STEEPER * in_a + own) * (at - 4.5) + rng.normal(0, 0.3)
            rows.append({"participant": f"sub-{person:02}", "group": group, "log_excess_steps": value})
            rows[-1] |= {"episode_in_block": at, "episode": at, "success": (at + person) % 4 > 0}
    episodes = pd.DataFrame(rows).assign(
        block="room", session=1, exclusion_reason=None, world="w", reward=0.5, steps=30, max_steps=90, playing_s=9.0
    )
    episodes["outcome"] = np.where(episodes["success"], "goal", "timeout")
    means = episodes.groupby(["group", "participant"])["log_excess_steps"].mean().rename("log_excess_steps_mean")
    blocks = means.reset_index().assign(session=1, block="room", exclusion_reason=None, episodes=8, reward_sd=0.1)
    blocks = blocks.assign(keys_total=0, **{name: np.nan for name in MEASURES if name not in blocks})
    people = blocks[["participant", "session", "exclusion_reason"]]
    found = compute_results(episodes, blocks, people)
    (out / "tables").mkdir()
    told = episodes.assign(success=np.where(episodes["success"], "TRUE", "FALSE"))
    told.to_csv(out / "tables" / "episodes.csv", index=False)
    write_scripts(out, "known", found, episodes, ("r", "python"))
    return out


@pytest.fixture(scope="module")
def in_python(scripts: Path) -> pd.DataFrame:
    done = subprocess.run([sys.executable, "analysis.py"], cwd=scripts, capture_output=True, text=True, check=True)
    (scripts / "said.txt").write_text(done.stdout)
    assert "; converged" in done.stdout
    return pd.read_csv(scripts / "analysis_python.csv").set_index("term")


@pytest.mark.program
def test_the_python_script_finds_the_effects_that_were_put_in(in_python: pd.DataFrame) -> None:
    groups = len(in_python) // 2
    level, change = in_python.iloc[:groups], in_python.iloc[groups:]
    in_group_a = [0.0] * groups
    in_group_a[1] = 1.0  # the first group that is not the reference
    for found, base, of_a in ((level, 2.0, GROUP), (change, CHANGE, STEEPER)):
        truth = np.array(in_group_a) * of_a
        truth[0] = base
        assert ((found["estimate"] - truth) / found["error"]).abs().max() < 4
    assert (in_python["error"] < 0.3).all()


@needs("r")
@pytest.mark.program
def test_the_r_script_agrees_to_three_digits(scripts: Path, in_python: pd.DataFrame) -> None:
    rscript = need("r")
    done = subprocess.run([rscript, "analysis.R"], cwd=scripts, capture_output=True, text=True, check=True)
    said = (scripts / "said.txt").read_text()
    words = done.stdout.splitlines()[0]
    assert words.endswith("; converged")
    if len(pd.read_csv(scripts / "tables" / "episodes.csv")) != 24 * 8:  # slopes of 0 are singular to one of them alone
        assert words == said.splitlines()[0]
        assert "and slope" in words
    in_r = pd.read_csv(scripts / "analysis_r.csv")
    assert len(in_r) == len(in_python)
    assert in_r["estimate"].to_numpy() == pytest.approx(in_python["estimate"].to_numpy(), rel=1e-3, abs=1e-3)
    assert "success, log odds" in done.stdout
    assert "success over the episodes, glmmTMB" in done.stdout


def test_one_group_has_nothing_to_model(tmp_path: Path) -> None:
    nothing = pd.DataFrame(columns=["group", "participant", "session", "block", "exclusion_reason", *MEASURES])
    found = compute_results(nothing, nothing, nothing)
    with pytest.raises(ReportError, match="no block is played by two groups"):
        write_scripts(tmp_path, "none", found, nothing, ("r",))


@pytest.mark.program
def test_the_python_script_tests_the_interaction_that_the_report_tests(tmp_path: Path) -> None:
    protocol, rows = read(), block_rows(1.5)
    interaction = compute_interaction(rows, derive_design(protocol), protocol.analysis, ("a", "b"))
    assert interaction is not None
    results = compute_results(*(rows.iloc[:0].assign(exclusion_reason=None, success=None) for _ in range(3)))
    write_scripts(tmp_path, "mixed", results, rows.iloc[:0], ("r", "python"), interaction)
    subprocess.run([sys.executable, "analysis.py"], cwd=tmp_path, capture_output=True, check=True)
    (row,) = pd.read_csv(tmp_path / "interaction_python.csv").to_dict("records")
    reported = interaction.contrasts[0].groups
    assert (row["first"], row["second"], row["n_first"], row["n_second"]) == ("a", "b", 9, 14)
    assert row["difference"] == pytest.approx(reported.difference)
    assert row["p"] == pytest.approx(reported.p, abs=0.02)
    assert "Kenward-Roger" in (tmp_path / "analysis.R").read_text()
