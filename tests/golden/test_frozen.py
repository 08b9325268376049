"""Logs frozen when their version was the newest: every later one reads, proves, reports and exports them."""

import inspect
import shutil
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pyarrow.parquet as pq
import pytest

from minihuman.activities.agent_blocks.events import ControlChanged, ControlReason, LearnerAsked
from minihuman.activities.correction.events import CorrectionEnded
from minihuman.activities.preferences.events import Preferred
from minihuman.activities.rating.events import Rated
from minihuman.activities.trials.events import ResponseTaken, SoundPlayed, StimuliShown, TrialResolved
from minihuman.admin.verify.episodes import EpisodeVerification, verify_episodes
from minihuman.admin.verify.log import verify_session
from minihuman.dataset.annotations import read_annotations
from minihuman.dataset.selection import Selection
from minihuman.dataset.tables import select
from minihuman.errors import LogError, WorldError
from minihuman.experiment.machine.activity import find_kind, list_built_in_kinds
from minihuman.experiment.machine.events import Answered
from minihuman.experiment.plan.session_plan import PacePolicy
from minihuman.exporters.exporter import export_study
from minihuman.log.names import PLAIN_SCHEMA_VERSION
from minihuman.log.read.session_reader import read_log
from minihuman.log.record import live_log
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import resume_segment
from minihuman.log.salvage.summary_section import read_summary
from minihuman.plugins import QUESTION_GROUP, list_plugin_names
from minihuman.worlds.catalogue import WORLDS
from tests.golden import renamed
from tests.golden.cells import cells_of, differences, frozen_cells
from tests.golden.make import segment, study as frozen_study
from tests.report.reports import write_report

HERE = Path(__file__).parent
LOGS = sorted([*HERE.glob("v*/*/sub-*/ses-*/*.mcap"), *HERE.glob("v*/*/sub-*/ses-*/*.mcap.part")])
STUDIES = sorted({log.parents[2] for log in LOGS})

EVERY_WORLD = ("every-grid", "every-level", "every-room")

# what each held when it was frozen: how its episodes ended, their steps, and how the session ended; of others their
# frozen tables say it
NEED_GYMNASIUM = ("unruled", "outcomes")  # studies with an option of FrozenLake that Gymnasium 1.1 has not
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
    "v2/adaptive/sub-01": ("goal goal goal goal failure goal goal goal", [1] * 8, "complete"),
    "v2/chat/sub-01": ("timeout", [3], "complete"),
    "v2/chat/sub-02": ("timeout", [3], "complete"),
    "v2/feedback/sub-01": ("goal goal", [5, 5], "complete"),
    "v2/team/sub-01": ("timeout timeout", [20, 20], "complete"),
    "v2/typed/sub-01": ("", [], "complete"),
    "v2/unruled/sub-01": ("failure goal failure failure", [2, 4, 1, 7], "complete"),
    "v3/fields/sub-01": ("", [], "complete"),
    "v3/sounds/sub-01": ("abandoned" + " goal" * 7 + " failure" + " goal" * 6, [0] + [1] * 14, "complete"),
    "v3/timelines/sub-01": ("abandoned" + " goal" * 12, [0] + [1] * 12, "complete"),
    "v3/outcomes/sub-01": (
        "failure goal goal goal ended ended goal goal ended ended timeout timeout",
        [2, 4, 1, 7, 3, 7, 1, 2, 1, 2, 1, 1],
        "complete",
    ),
}


def name_of(path: Path) -> str:
    return "/".join(path.relative_to(HERE).parts[:3])


def held(path: Path) -> tuple[list[str], list[int], str]:
    if name_of(path) in HELD:
        outcomes, steps, end_reason = HELD[name_of(path)]
        return outcomes.split(), steps, end_reason
    tables = frozen_cells(path.parents[2].name)
    episodes, [end_reason] = tables["episodes"], tables["participants"]["end_reason"]
    return episodes["outcome"], [int(steps) for steps in episodes["steps"]], end_reason


def log_of(study: str):
    [path] = [path for path in LOGS if path.parents[2].name == study]
    return read_log(path)


def require_gymnasium(study):
    """Skip a study whose world has options that older releases of Gymnasium do not know."""
    if study in NEED_GYMNASIUM and not has_reward_schedule():
        pytest.skip("FrozenLake has no reward_schedule in this release of Gymnasium; install a newer one")


def has_reward_schedule():
    from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv

    return "reward_schedule" in inspect.signature(FrozenLakeEnv).parameters


@pytest.mark.parametrize("path", LOGS, ids=name_of)
def test_a_frozen_log_says_what_it_said_and_is_proven(path):
    require_gymnasium(path.parents[2].name)
    log = read_log(path)
    outcomes, steps, end_reason = held(path)
    assert [episode.outcome_word for episode in log.episodes] == outcomes
    assert [len(episode.actions) for episode in log.episodes] == steps
    assert log.end_reason == end_reason
    said = list(verify_session(path))
    against = [line for line, good in said if not good]
    assert against == []
    assert said[-1][0] == f"{len(steps)} episodes, {sum(steps)} steps, all as logged"


@pytest.mark.parametrize("study", [*EVERY_WORLD, "every-option"])
def test_every_world_plays_again_to_the_bit(study):
    log = log_of(study)
    against = []  # each by itself, so that all that differ are named
    for episode in log.episodes:
        try:
            proof = verify_episodes(replace(log, episodes=(episode,)))
        except WorldError as error:
            against.append(f"{episode.plan.world} {episode.plan.options}: {error}")
            continue
        if proof != EpisodeVerification(1, len(episode.actions), ""):
            against.append(f"{episode.plan.world} {episode.plan.options}: {str(proof)[:200]}")
    assert not against, "\n".join(against)


def test_every_world_is_among_them():
    frozen = [episode.plan.world for study in EVERY_WORLD for episode in log_of(study).episodes]
    assert len(set(frozen)) == len(frozen) == 218
    assert {renamed.WORLDS.get(world, world) for world in frozen} <= {entry.id for entry in WORLDS}


def test_every_kind_of_part_is_among_them():
    logs = [read_log(path) for path in LOGS]
    happened = [event for log in logs for event in log.part_events]
    assert {find_kind(part.kind).name for log in logs for part in log.plan.parts} == set(list_built_in_kinds())
    asked = {event.kind for event in happened if isinstance(event, Answered)}
    unfrozen = {*list_plugin_names(QUESTION_GROUP, built_in=True)} - asked
    assert not unfrozen, f"freeze a study that asks {', '.join(sorted(unfrozen))}: CONTRIBUTING.md, To freeze a study"
    assert {episode.plan.pace for log in logs for episode in log.episodes} == set(get_args(PacePolicy))
    assert {event.reason for event in happened if isinstance(event, ControlChanged)} == set(get_args(ControlReason))
    assert {event.value for event in happened if isinstance(event, Rated)} == {1.0, -1.0}
    frozen = {type(event) for event in happened}
    assert {LearnerAsked, CorrectionEnded, Preferred, TrialResolved} <= frozen
    assert {StimuliShown, SoundPlayed, ResponseTaken} <= frozen


def test_they_are_small():
    assert {name_of(path) for path in LOGS} >= HELD.keys()
    assert sum(len(path.read_bytes()) for path in LOGS) < 4_000_000


def test_the_frozen_marks_still_choose():
    [log] = [read_log(path) for path in LOGS if "/marked/" in str(path)]
    assert [mark.tag for mark in read_annotations(log.path)] == ["exclude", "slow", "doubt", "doubt"]
    assert [played.plan.episode for played in Selection().judge(log).episodes] == [0, 2]
    assert Selection(only=("doubt",)).judge(log).episodes == ()


@pytest.mark.program
@pytest.mark.parametrize("study", STUDIES, ids=name_of)
def test_a_frozen_study_makes_tables(study, tmp_path):
    steps = [steps for log in LOGS if log.is_relative_to(study) for steps in held(log)[1]]
    export_study("parquet", _copy(study, tmp_path), tmp_path / "out", Selection())
    written = tmp_path / "out" / "episodes.parquet"
    episodes = pq.read_table(written).to_pylist() if written.exists() else []
    assert [row["steps"] for row in episodes] == steps


@pytest.mark.program
@pytest.mark.parametrize("study", STUDIES, ids=name_of)
def test_a_frozen_study_has_the_cells_that_it_had(study, tmp_path):
    against = list(differences(frozen_cells(study.name), cells_of(_copy(study, tmp_path), tmp_path / "out")))
    assert not against, "\n".join([*against[:20], f"{len(against)} in all"])


def test_a_live_file_of_before_is_finished_and_the_rest_of_its_session_is_of_todays_version(tmp_path, monkeypatch):
    with monkeypatch.context() as before:
        before.setattr(live_log, "find_schema_version", lambda plan, facts: 1)
        log = segment(tmp_path, frozen_study("cut-off"), after_steps=8, part=tmp_path / "as-killed")
    log.unlink()
    part = log.with_name(f"{log.name}.part")
    shutil.move(tmp_path / "as-killed", part)
    with pytest.raises(LogError, match="was written by another version of minihuman; run: minihuman recover"):
        resume_segment(part)
    recover_log(part)
    segment(tmp_path, frozen_study("cut-off"))
    assert [facts["schema_version"] for facts in read_summary(log).starts] == ["1", str(PLAIN_SCHEMA_VERSION)]
    assert [good for _, good in verify_session(log)] == [True]
    assert read_log(log).end_reason == "complete"


def test_what_became_of_frozen_cells_is_said(monkeypatch):
    frozen = {"steps": {"reward": ["0.1", None], "key": ["a", "b"]}}
    assert list(differences(frozen, frozen)) == []
    assert list(differences(frozen, {"steps": {"reward": ["0.1000000000000001", None], "key": ["a", "b"]}})) == []
    assert list(differences(frozen, {})) == ["steps: there is no table steps"]
    assert list(differences(frozen, {"steps": {"reward": ["0.2", "0"], "press": ["a"]}})) == [
        "steps.reward row 1: '0.1' frozen, '0.2' now",
        "steps.reward row 2: None frozen, '0' now",
        "steps.key: there is no column key in steps",
    ]
    monkeypatch.setitem(renamed.TABLES, "steps", "moves")
    monkeypatch.setitem(renamed.COLUMNS, "steps.reward", "gain")
    monkeypatch.setitem(renamed.COLUMNS, "key", "press")
    assert list(differences(frozen, {"moves": {"gain": ["0.1", None], "press": ["a"], "new": ["1"]}})) == [
        "steps.key: 2 rows frozen, 1 now"
    ]


@pytest.mark.nightly(by_day=["v1/plain"])
@pytest.mark.program
@pytest.mark.parametrize("study", ["v1/plain", "v1/resumed", "v1/every-part", "v1/every-lesson", "v3/sounds"])
def test_a_frozen_study_is_reported(study, tmp_path):
    written = write_report(select(_copy(HERE / study, tmp_path)), tmp_path / "out")
    assert any(path.name == "report.html" for path in written)


def _copy(study: Path, folder: Path) -> Path:
    """What reads a study may keep a table of it beside it: not in the repository."""
    shutil.copytree(study, folder / study.name)
    return folder / study.name
