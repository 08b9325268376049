"""One study through every consumer: curves, tables, paths, statistics, replay, clone and every export count the same.

Ten people in two groups: one whom the protocol excludes, one episode that a reviewer marked, a group that mostly times
out, an episode that was abandoned, and two versions of the protocol.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.selection import Selection, format_version
from minihuman.dataset.sessions import StudySessions, read_selected_sessions
from minihuman.dataset.tables import select
from minihuman.experiment.plan.expansion import enrol_participant
from minihuman.experiment.plan.participant_codes import parse_participant_code
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.exporters.exporter import export_study, list_exporters
from minihuman.figures.figure_data import collect_learning_curves
from minihuman.figures.gallery import collect_rewards, draw_all_figures
from minihuman.learn.demonstrations import read_demonstrations
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.results import compute_results
from tests.golden.make import segment
from tests.report.reports import write_report

pytestmark = pytest.mark.program

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
PROTOCOL = """
[study]
name = "counted"
version = "{version}"
seed = 11
participants = 10
[keys]
pool = ["1", "2", "3", "4"]
[[groups]]
name = "good"
blocks = ["small"]
[[groups]]
name = "lost"
blocks = ["small"]
[[blocks]]
name = "small"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 9
episodes = 3
[[exclusions]]
reason = "went home"
level = "participant"
measure = "completed_share"
below = 0.5
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("data")
    versions = [decode_protocol(PROTOCOL.format(version=version).encode()) for version in "12"]
    for number in range(1, 11):
        who, protocol = f"sub-{number:02}", versions[number > 5]
        how = {"after_steps": 2, "key": "escape"} if number == 3 else {}  # in the first episode
        if number == 7:
            how = {"after_steps": 11, "key": "escape"}  # in the third
        group = enrol_participant(protocol, parse_participant_code(who), None).group
        segment(data, protocol, "optimal" if group == "good" or how else "random", participant=who, **how)
    folder = data / "counted"
    marked = next((folder / "sub-01").rglob("*.mcap"))
    add_annotation(read_log(marked), Annotation("exclude", "2026-11-22T09:00:00Z", episode=2, note="the phone rang"))
    shutil.copytree(folder / "sub-05", folder / "backup")
    return folder


@pytest.fixture(scope="module")
def counting(study) -> set[tuple[str, int, int]]:
    """Participant, episode and attempt of what counts, worked out here by hand: three a person, less what was said."""
    everything = {(f"sub-{number:02}", episode, 1) for number in range(1, 11) for episode in (1, 2, 3)}
    gone = {("sub-03", episode, 1) for episode in (1, 2, 3)}
    return everything - gone - {("sub-01", 2, 1), ("sub-07", 3, 1)}


def places(rows) -> set[tuple[str, int, int]]:
    return {(row["participant"], row["episode"], row["attempt"]) for row in rows}


def test_the_selection_itself(study, counting):
    sessions = StudySessions(study)
    found = [(one.log, episode) for one in sessions for episode in one.episodes]
    assert {(log.plan.participant.id, one.number, one.attempt) for log, one in found} == counting
    assert sessions.account.episodes == len(counting)
    assert sessions.account.left_out == {
        ("participant", "went home"): 1,
        ("episode", "tagged exclude"): 1,
        ("episode", "not played to an end"): 1,
    }
    assert len(sessions.account.versions) == 2
    told = "\n".join(sessions.account.lines())
    assert f"{len(counting)} episodes of 9 sessions included" in told
    assert "session 1 of sub-05" in told
    assert "several versions of the protocol: 1 (" in told


OF_TEAMS = {"pettingzoo", "overcooked"}  # tests/activities/team exports with them


@pytest.mark.parametrize("name", sorted(set(list_exporters()) - OF_TEAMS))
def test_every_export(study, counting, tmp_path, monkeypatch, name):
    import minari
    from datasets import load_from_disk

    written, card = export_study(name, study, tmp_path / "out", Selection())
    assert written.episodes == card.account.episodes == len(counting)
    text = (tmp_path / "out" / "README.md").read_text()
    for said in (f"{len(counting)} episodes", "went home", "tagged exclude", "not played to an end", "sub-05"):
        assert said in text
    out = tmp_path / "out"
    match name:
        case "minari":
            monkeypatch.setenv("MINARI_DATASETS_PATH", str(out))
            (dataset_id,) = minari.list_local_datasets()
            storage = minari.load_dataset(dataset_id).storage
            assert places(storage.get_episode_metadata(range(storage.total_episodes))) == counting
            assert storage.metadata["algorithm_name"] == "minihuman sessions played by: optimal, random"
        case "lerobot":
            (meta,) = out.glob("*/meta/episodes/*/*.parquet")
            rows = [
                {key.removeprefix("minihuman/"): value for key, value in row.items()}
                for row in pq.read_table(meta).to_pylist()
            ]
            assert places(rows) == counting
        case "imitation":
            (data,) = (path for path in out.iterdir() if path.is_dir())
            assert places(json.loads(row["infos"][0]) for row in load_from_disk(str(data))) == counting
        case "parquet":
            rows = pq.read_table(out / "episodes.parquet").to_pylist()
            assert places(row for row in rows if not row["exclusion_reason"]) == counting
            assert len(rows) == 28  # all that was begun: of sub-03 one episode


def test_the_report_its_curves_and_its_statistics(study, counting, tmp_path):
    page, *_ = write_report(select(study, processes=1), tmp_path / "out")
    frames = [
        pd.read_parquet(tmp_path / f"out/tables/{name}.parquet") for name in ("episodes", "blocks", "participants")
    ]
    found = compute_results(*frames)
    assert found.included == (9, len(counting))
    assert sum(block.subjects["episodes"].sum() for block in found.blocks) == len(counting)
    (reward,) = [one for one in found.target_block.comparisons if one.measure == "reward_mean"]
    assert sum(reward.n) == 9
    growth = found.target_block.growth
    assert growth is None or max(term.people for term in growth.terms) <= 9
    counted = frames[0][frames[0]["exclusion_reason"].isna()]
    assert sum(int((~np.isnan(curve)).sum()) for curve in collect_learning_curves(counted).values()) == len(counting)
    text = page.read_text()
    assert "2 versions of the protocol are pooled here" in text
    assert "10 sessions read, 1 skipped" in text


def test_figures_of_the_study_and_of_each_person(study, counting, tmp_path):
    logs, account = read_selected_sessions([study], Selection())
    assert account.episodes == sum(len(log.episodes) for log in logs) == len(counting)
    curves = collect_learning_curves(collect_rewards(logs))
    assert sum(int((~np.isnan(curve)).sum()) for curve in curves.values()) == len(counting)
    assert sum(len(curve) for curve in curves.values()) == 9
    drawn = {path.parent.name for path in draw_all_figures(select(study, Selection(participant=("sub-03",))), tmp_path)}
    assert not drawn  # who does not count has no paths


def test_a_replay_shows_what_counts_and_what_was_not_finished(study, counting, tmp_path):
    """The command takes unfinished episodes, and people whom a rule leaves out, too: who looks wants to see those."""
    from rerun.chunk import RrdReader

    from minihuman.replay.recording import save_recording

    for selection, expected in ((Selection(), len(counting)), (Selection(with_=("unfinished", "rules")), 27)):
        logs, account = read_selected_sessions([study], selection)
        saved = save_recording(logs, tmp_path / "all.rrd")
        rows = [row for chunk in RrdReader(saved).stream().to_chunks() for row in chunk.to_record_batch().to_pylist()]
        lines = [str(row.get("TextLog:text")) for row in rows]
        assert sum(" begins: " in line for line in lines) == account.episodes == expected


def test_what_a_clone_learns_from(study, counting):
    found = read_demonstrations(study, WORLD, ObservationEncoder(missions=False), Selection())
    assert len(found.episodes) == len(counting)
    assert found.account.episodes == len(counting)


def test_what_is_left_out_can_be_taken_back_in_and_one_version_taken_alone(study):
    def count(**selection) -> int:
        return sum(len(one.episodes) for one in StudySessions(study, Selection(**selection)))

    assert count(with_=("exclude",)) == 26
    assert count(with_=("exclude", "unfinished", "rules")) == 28
    assert count(version=("1",)) + count(version=("2",)) == 25
    (first,) = {
        format_version(one.log.plan) for one in StudySessions(study, Selection(version=("1",))) if any(one.selected)
    }
    assert count(version=(first,)) == count(version=("1",))


def test_a_session_that_began_no_episode_is_one_of_its_protocol_version() -> None:
    """Else a report says "version 1 in 10 sessions; 15 sessions read"."""
    sessions = StudySessions(Path(__file__).parents[1] / "golden/v1/no-episode")
    assert [len(one.log.episodes) for one in sessions] == [0]
    assert sum(sessions.account.versions.values()) == 1
