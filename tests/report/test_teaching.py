"""What the report says of teaching, and what the replay shows of it, from a log with all of its kinds."""

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from minihuman.data.study import Sessions
from minihuman.figures.rated import shares_of_good
from minihuman.log.read.open_log import open_log
from minihuman.replay.recording import save_recording
from minihuman.report.build import build
from minihuman.report.teaching import agreement, blocks_of, gained_per_min, taught_logs, teaching_section

TAUGHT = Path(__file__).parents[1] / "golden" / "v1" / "taught"


@pytest.fixture(scope="module")
def log():
    [path] = TAUGHT.rglob("*.mcap")
    return open_log(path)


def test_the_page_says_who_steered_and_what_was_preferred(log):
    page = "".join(teaching_section({"sub-01 session 1": log}))
    told = re.sub(r"<[^>]+>", " ", page)
    assert "Teaching" in told
    for block in blocks_of(log):
        assert block in told
    assert str(len(log.comparisons)) in told


def test_a_study_without_an_agent_has_no_such_section():
    assert taught_logs([], pd.DataFrame({"participant": [], "session": []})) == {}
    assert teaching_section({}) == []


def test_agreement_is_over_the_persons_steps_alone(log):
    told = [one for block in blocks_of(log).values() for one in block]
    same = total = 0
    for episode, taught in told:
        for step, action in enumerate(episode.actions):
            if taught.by_person[step] and taught.policy_actions[step] >= 0:
                total += 1
                same += int(taught.policy_actions[step] == action)
    assert total > 0
    assert agreement(told) == pytest.approx(same / total)
    assert np.isnan(gained_per_min(told[:1])), "one episode tells nothing of growth"


def test_the_replay_has_the_policys_actions_and_the_persons_as_lanes(log, tmp_path):
    rr.set_strict_mode(True)
    path = save_recording([log], tmp_path / "taught.rrd")
    rr.set_strict_mode(False)
    lanes = {str(chunk.entity_path) for chunk in RrdReader(path).stream().to_chunks()}
    assert {"/sub-01_ses-01/steering/policy", "/sub-01_ses-01/steering/person"} <= lanes


def test_the_report_of_a_taught_study_has_the_figure(tmp_path):
    study = tmp_path / "taught"
    shutil.copytree(TAUGHT, study)
    files = build(Sessions(study, processes=1), tmp_path / "report")
    assert any("steering" in path.name for path in files)
    assert any("ratings" in path.name for path in files)


def test_the_share_of_good_presses_is_of_the_latest_alone():
    shares = shares_of_good(np.array([1.0, -1, 1, 1, -1, -1, -1]), latest=3)
    assert shares == pytest.approx([1, 1 / 2, 2 / 3, 2 / 3, 2 / 3, 1 / 3, 0])
