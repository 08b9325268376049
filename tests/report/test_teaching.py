"""What the report says of teaching, and what the replay shows of it, from a log with all of its kinds."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from minihuman.activities.agent_blocks.report import (
    autonomy_gain_per_min,
    group_taught_by_block,
    policy_agreement,
    steering_minutes,
)
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.tables import Tables, select
from minihuman.figures.teaching_figures import compute_shares_of_good
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.activity_sections import SectionSource, build_activity_sections, join_sections
from tests.report.pages import page
from tests.report.reports import write_report

pytestmark = pytest.mark.program  # whole studies are simulated

TAUGHT = Path(__file__).parents[1] / "golden" / "v1" / "taught"


@pytest.fixture(scope="module")
def log():
    [path] = TAUGHT.rglob("*.mcap")
    return read_log(path)


def sections_of(tables: Tables, out: Path):
    return join_sections(build_activity_sections(SectionSource(tables, out)))


def test_the_page_says_who_steered_and_what_was_preferred(log, tmp_path):
    study = shutil.copytree(TAUGHT, tmp_path / "taught")
    with select(study, processes=1) as tables:
        sections = sections_of(tables, tmp_path)
    told = re.sub(r"<[^>]+>", " ", page(activities=sections))
    assert "Teaching" in told
    for block in group_taught_by_block(log):
        assert block in told
    assert str(len(log.comparisons)) in told


def test_a_study_without_an_agent_has_no_such_section(tmp_path):
    study = shutil.copytree(TAUGHT.with_name("plain"), tmp_path / "plain")
    with select(study, processes=1) as tables:
        assert sections_of(tables, tmp_path) == []


def test_agreement_is_over_the_persons_steps_alone(log):
    told = [one for block in group_taught_by_block(log).values() for one in block]
    same = total = 0
    for episode, taught in told:
        for step, action in enumerate(episode.actions):
            if taught.by_person[step] and taught.policy_actions[step] >= 0:
                total += 1
                same += int(taught.policy_actions[step] == action)
    assert total > 0
    assert policy_agreement(told) == pytest.approx(same / total)
    assert np.isnan(autonomy_gain_per_min(told[:1])), "one episode tells nothing of growth"


def test_a_pause_is_no_time_that_the_person_steered(log):
    episode, taught = next(
        one for block in group_taught_by_block(log).values() for one in block if one[1].by_person.any()
    )
    begin_ns, end_ns = (int(episode.t_ns[np.flatnonzero(taught.by_person)[0] + after]) for after in (0, 1))
    paused = replace(episode, pauses=((begin_ns, end_ns - 1_000_000),))
    shorter_ns = (steering_minutes(episode, taught) - steering_minutes(paused, taught)) * 60e9
    assert shorter_ns == pytest.approx(end_ns - 1_000_000 - begin_ns)


def test_teaching_is_told_of_the_episodes_that_count(log, tmp_path):
    study = shutil.copytree(TAUGHT, tmp_path / "taught")
    [path] = study.rglob("*.mcap")

    def told() -> dict[str, list[int]]:
        with select(study, processes=1) as tables:
            source = SectionSource(tables, tmp_path)
            logs = source.read_logs(source.table("controls"))
        return {name: [one.number for one in session.episodes if one.taught] for name, session in logs.items()}

    (everything,) = told().values()
    add_annotation(log_of := read_log(path), Annotation("exclude", "2026-11-22T09:00:00Z", episode=everything[0]))
    assert told() == {"sub-01 session 1": everything[1:]}
    add_annotation(log_of, Annotation("exclude", "2026-11-22T09:00:00Z"))
    assert told() == {}


def test_the_replay_has_the_policys_actions_and_the_persons_as_lanes(log, tmp_path):
    import rerun as rr
    from rerun.chunk import RrdReader

    from minihuman.replay.recording import save_recording

    rr.set_strict_mode(True)
    path = save_recording([log], tmp_path / "taught.rrd")
    rr.set_strict_mode(False)
    lanes = {str(chunk.entity_path) for chunk in RrdReader(path).stream().to_chunks()}
    assert {"/sub-01_ses-01/steering/policy", "/sub-01_ses-01/steering/person"} <= lanes


def test_the_report_of_a_taught_study_has_the_figure(tmp_path):
    study = tmp_path / "taught"
    shutil.copytree(TAUGHT, study)
    files = write_report(select(study, processes=1), tmp_path / "report")
    assert any("steering" in path.name for path in files)
    assert any("ratings" in path.name for path in files)


def test_the_share_of_good_presses_is_of_the_latest_alone():
    shares = compute_shares_of_good(np.array([1.0, -1, 1, 1, -1, -1, -1]), latest=3)
    assert shares == pytest.approx([1, 1 / 2, 2 / 3, 2 / 3, 2 / 3, 1 / 3, 0])
