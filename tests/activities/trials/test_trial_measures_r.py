"""Stop-signal reaction time, d' and congruency effect are those of base R, written from the formulas."""

import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from minihuman.activities.trials.stop_signal import estimate_people
from minihuman.activities.trials.trial_measures import measure_conditions
from tests.machine import need, needs

pytestmark = [pytest.mark.program, pytest.mark.nightly]


def draw_trials(seed: int) -> pd.DataFrame:
    """Trials of one person in three blocks; omissions, wrong and premature responses among them."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(240):
        time = rng.normal(430, 60) + rng.exponential(80)
        delay = 50.0 * rng.integers(2, 8)
        is_stop = number % 4 == 0
        is_made = time < delay + 240 if is_stop else rng.random() < 0.97
        rows.append(
            ("stop", "none" if is_stop else "left", time if is_made else math.nan, delay if is_stop else math.nan)
        )
    for number in range(80):
        is_signal = number % 2 == 0
        is_made = rng.random() < (0.85 if is_signal else 0.3)
        rows.append(("detect", "left" if is_signal else "none", rng.normal(400, 50) if is_made else math.nan, math.nan))
    for number in range(96):
        time = 100.0 if number == 5 else rng.normal(500 + 60 * (number % 2), 60) + 900 * (number == 9)
        rows.append(("stroop", "left", time, math.nan))
    frame = pd.DataFrame(rows, columns=["block", "correct", "response_ms", "delay_ms"])
    congruent = [{"congruent": "no" if at % 2 else "yes"} for at in range(len(frame))]
    response = frame["correct"].where(frame["correct"].ne("none") & (rng.random(len(frame)) < 0.93), "right")
    response = response.where(frame["response_ms"].notna(), "none")
    return frame.assign(
        participant="sub-01", session=1, group="all", trial=range(1, len(frame) + 1), response=response,
        is_correct=response.eq(frame["correct"]), congruent=[labels["congruent"] for labels in congruent],
        labels=[json.dumps(labels) for labels in congruent],
        stimulus=[json.dumps({} if math.isnan(delay) else {"delay_ms": delay}) for delay in frame["delay_ms"]],
    )  # fmt: skip


@needs("r")
@pytest.mark.parametrize("seed", range(5))
def test_measures_of_trials_are_those_of_base_r(tmp_path: Path, seed: int) -> None:
    trials = draw_trials(seed)
    trials.rename(columns={"block": "task"}).to_csv(tmp_path / "trials.csv", index=False)
    shutil.copy(Path(__file__).with_name("trial_measures.R"), tmp_path)
    subprocess.run([need("r"), "trial_measures.R"], cwd=tmp_path, check=True, capture_output=True, text=True)
    (in_r,) = pd.read_csv(tmp_path / "measures.csv").to_dict("records")
    ((_, _, _, estimate),) = estimate_people(trials[trials["block"] == "stop"])
    assert estimate.ssrt_ms == pytest.approx(in_r["ssrt"], rel=1e-9)
    # a quantile that lies between two go times (type 6) differs by a few milliseconds at most
    assert estimate.ssrt_ms == pytest.approx(in_r["ssrt_interpolated"], abs=5)
    measured = measure_conditions(trials).set_index(["block", "level"])
    assert measured.loc[("detect", "all"), "d_prime"] == pytest.approx(in_r["d_prime"], rel=1e-9)
    assert measured.loc[("detect", "all"), "criterion"] == pytest.approx(in_r["criterion"], rel=1e-9)
    times = measured["response_mean_ms"]
    assert times["stroop", "no"] - times["stroop", "yes"] == pytest.approx(in_r["effect"], rel=1e-9)
