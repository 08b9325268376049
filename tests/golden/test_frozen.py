"""Logs frozen when their version was the newest: every later one reads, proves, reports and exports them."""

import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from minihuman.data.marks import read_marks
from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.export.run import export
from minihuman.lab.verify import verify
from minihuman.log.read.open_log import open_log
from minihuman.report.build import build

HERE = Path(__file__).parent
LOGS = sorted([*HERE.glob("v*/*/sub-*/ses-*/*.mcap"), *HERE.glob("v*/*/sub-*/ses-*/*.mcap.part")])
STUDIES = sorted({log.parents[2] for log in LOGS})

# what each held when it was frozen: how its episodes ended, their steps, and how the session ended
HELD = {
    "v1/cut-off/sub-01": ("goal cut_off", [5, 4], "cut_off"),
    "v1/first-person/sub-01": ("goal goal", [4, 27], "complete"),
    "v1/foreign/sub-01": ("timeout timeout goal", [30, 30, 12], "complete"),
    "v1/guest/sub-01": ("goal abandoned goal goal", [5, 2, 5, 5], "complete"),
    "v1/marked/sub-01": ("goal goal goal", [5, 5, 5], "complete"),
    "v1/mixed/sub-01": ("goal goal", [5, 21], "complete"),
    "v1/no-episode/sub-01": ("", [], "window_closed"),
    "v1/no-step/sub-01": ("abandoned", [0], "quit"),
    "v1/observations/sub-01": ("goal goal", [5, 5], "complete"),
    "v1/plain/sub-01": ("goal goal", [18, 16], "complete"),
    "v1/plain/sub-02": ("timeout timeout", [50, 50], "complete"),
    "v1/real-time/sub-01": ("goal goal goal", [6, 6, 6], "complete"),
    "v1/recovered/sub-01": ("goal", [5], "cut_off"),
    "v1/taught/sub-01": ("goal timeout goal goal", [5, 12, 9, 6], "complete"),
    "v1/resumed/sub-01": ("goal abandoned goal goal", [5, 2, 5, 5], "complete"),
}


def name_of(path: Path) -> str:
    return "/".join(path.relative_to(HERE).parts[:3])


@pytest.mark.parametrize("path", LOGS, ids=name_of)
def test_a_frozen_log_says_what_it_said_and_plays_again_to_the_bit(path):
    log = open_log(path)
    outcomes, steps, end_reason = HELD[name_of(path)]
    assert [episode.outcome_word for episode in log.episodes] == outcomes.split()
    assert [len(episode.actions) for episode in log.episodes] == steps
    assert log.end_reason == end_reason
    proof = verify(log)
    assert (proof.episodes, proof.steps, proof.difference) == (len(steps), sum(steps), "")


def test_every_kind_of_log_is_among_them():
    assert {name_of(path) for path in LOGS} == set(HELD)
    assert sum(len(path.read_bytes()) for path in LOGS) < 1_000_000


def test_the_frozen_marks_still_choose():
    [log] = [open_log(path) for path in LOGS if "/marked/" in str(path)]
    assert [mark.tag for mark in read_marks(log.path)] == ["exclude", "slow", "doubt", "doubt"]
    assert [played.plan.episode for played in Selection().judge(log).episodes] == [0, 2]
    assert Selection(only=("doubt",)).judge(log).episodes == ()


@pytest.mark.program
@pytest.mark.parametrize("study", STUDIES, ids=name_of)
def test_a_frozen_study_makes_tables(study, tmp_path):
    steps = [steps for log in LOGS if log.is_relative_to(study) for steps in HELD[name_of(log)][1]]
    export("parquet", _copy(study, tmp_path), tmp_path / "out", Selection())
    episodes = pq.read_table(tmp_path / "out" / "episodes.parquet").to_pylist()
    assert [row["steps"] for row in episodes] == steps


@pytest.mark.program
@pytest.mark.parametrize("study", [HERE / "v1/plain", HERE / "v1/resumed"], ids=name_of)
def test_a_frozen_study_is_reported(study, tmp_path):
    written = build(Sessions(_copy(study, tmp_path)), tmp_path / "out")
    assert any(path.name == "report.html" for path in written)


def _copy(study: Path, folder: Path) -> Path:
    """What reads a study may keep a table of it beside it: not in the repository."""
    shutil.copytree(study, folder / study.name)
    return folder / study.name
