"""The scripts of mixed models that a report writes: they run, find what was put in, and agree with each other."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from minihuman.errors import ReportError
from minihuman.reporting.build import write_scripts
from minihuman.reporting.results import MEASURES, compute_results

GROUP, CHANGE, STEEPER = 0.6, -0.15, 0.1  # of group a, per episode, and of a's change


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report's folder: two groups of 20 participants, 8 episodes each, own levels and own changes."""
    rng, out = np.random.default_rng(4), tmp_path_factory.mktemp("report")
    rows = []
    for person in range(40):
        in_a, level, own = person % 2, rng.normal(2, 0.4), rng.normal(0, 0.08)
        for at in range(1, 9):
            value = level + GROUP * in_a + (CHANGE + STEEPER * in_a + own) * (at - 4.5) + rng.normal(0, 0.3)
            rows.append({"participant": f"sub-{person:02}", "group": "ab"[1 - in_a], "log_excess_steps": value})
            rows[-1] |= {"episode_in_block": at, "episode": at, "success": at > 1 or person % 3 > 0}
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
    assert "random intercept and slope; converged" in done.stdout
    return pd.read_csv(scripts / "analysis_python.csv").set_index("term")


@pytest.mark.program
def test_the_python_script_finds_the_effects_that_were_put_in(in_python: pd.DataFrame) -> None:
    truth = [2.0, GROUP, CHANGE, STEEPER]
    apart = (in_python["estimate"] - truth) / in_python["error"]
    assert apart.abs().max() < 4
    assert (in_python["error"] < 0.3).all()


@pytest.mark.program
def test_the_r_script_agrees_to_three_digits(scripts: Path, in_python: pd.DataFrame) -> None:
    rscript = shutil.which("Rscript")
    if rscript is None or subprocess.run([rscript, "-e", "library(lme4)"], capture_output=True, check=False).returncode:
        pytest.skip("R with lme4 is not installed")
    done = subprocess.run([rscript, "analysis.R"], cwd=scripts, capture_output=True, text=True, check=True)
    assert "random intercept and slope; converged" in done.stdout
    in_r = pd.read_csv(scripts / "analysis_r.csv")
    assert in_r["estimate"].to_numpy() == pytest.approx(in_python["estimate"].to_numpy(), rel=1e-3, abs=1e-3)
    assert "success, log odds" in done.stdout


def test_one_group_has_nothing_to_model(tmp_path: Path) -> None:
    nothing = pd.DataFrame(columns=["group", "participant", "session", "block", "exclusion_reason", *MEASURES])
    found = compute_results(nothing, nothing, nothing)
    with pytest.raises(ReportError, match="no block is played by two groups"):
        write_scripts(tmp_path, "none", found, nothing, ("r",))
