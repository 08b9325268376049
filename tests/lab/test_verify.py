"""A log that was really played replays exactly; one changed number is found and named."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.policies import verify_advice
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.errors import LogError
from minihuman.experiment.machine.events import EpisodeStarted, Event, Stepped
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.model.teaching_events import TeachingRecord
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from minihuman.worlds.pose import Pose
from tests.lab.test_next_session import PROTOCOL, play
from tests.log.played import played_events, record
from tests.log.samples import session_plan

STEPS = 15


@pytest.fixture(scope="module")
def plan() -> SessionPlan:
    return session_plan(episodes=2)


@pytest.fixture(scope="module")
def events(plan: SessionPlan) -> list[Event]:
    return played_events(plan, steps=STEPS)


def test_a_played_log_replays_exactly(tmp_path: Path, plan: SessionPlan, events: list[Event]) -> None:
    result = verify_episodes(read_log(record(tmp_path, plan, events)))
    assert (result.difference, result.episodes, result.steps) == ("", 2, 2 * STEPS)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda step: replace(step, state_hash=step.state_hash ^ 1), "state hash"),
        (lambda step: replace(step, observation_hash=step.observation_hash ^ 1), "observation hash"),
        (lambda step: replace(step, reward=0.25), "reward 0.25 in the log"),
        (lambda step: replace(step, truncated=True), "truncated True in the log"),
        (lambda step: replace(step, pose=Pose(0.5, 0, 0.5, 0)), "pose [0.5, 0.0, 0.5, 0.0] in the log"),
        (lambda step: replace(step, action=(step.action + 1) % 3), "state hash"),
    ],
)
def test_the_first_step_that_differs_is_named(
    tmp_path: Path, plan: SessionPlan, events: list[Event], change: object, named: str
) -> None:
    assert callable(change)
    changed = [
        change(event) if isinstance(event, Stepped) and (event.episode, event.step) == (1, 7) else event
        for event in events
    ]
    result = verify_episodes(read_log(record(tmp_path, plan, changed)))
    assert result.difference.startswith("episode 2 step 7: ")
    assert named in result.difference
    assert (result.episodes, result.steps) == (1, STEPS)


def test_another_start_is_named(tmp_path: Path, plan: SessionPlan, events: list[Event]) -> None:
    changed = [
        replace(event, state_hash=event.state_hash ^ 1) if isinstance(event, EpisodeStarted) else event
        for event in events
    ]
    result = verify_episodes(read_log(record(tmp_path, plan, changed)))
    assert result.difference.startswith("episode 1 reset: state hash ")


def test_a_seed_that_was_not_played_is_found(tmp_path: Path, plan: SessionPlan, events: list[Event]) -> None:
    changed = [
        replace(event, plan=session_plan(episodes=3).episodes[2]) if isinstance(event, EpisodeStarted) else event
        for event in events[: 2 + 1]
    ]
    result = verify_episodes(read_log(record(tmp_path, plan, changed)))
    assert "reset" in result.difference


def test_a_policy_is_looked_for_in_the_study_of_a_session_in_several_files_and_from_inside_it(tmp_path, monkeypatch):
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1)
    play(plan_next_session(PROTOCOL, tmp_path, participant="sub-01"), tmp_path, episodes=1, cut=True)
    folder = tmp_path / "corridor" / "sub-01" / "ses-01"
    monkeypatch.chdir(folder)
    for given in (folder, Path("sub-01_ses-01.mcap")):
        log = read_log(given)
        steered = TeachingRecord("ab" * 32, *(np.zeros(0),) * 3, (), ())
        taught = replace(log, episodes=(replace(log.episodes[0], taught=steered),))
        with pytest.raises(LogError, match=re.escape(f"is missing from {tmp_path / 'corridor' / 'policies'};")):
            list(verify_advice(taught, World))
