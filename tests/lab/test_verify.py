"""A log that was really played replays exactly; one changed number is found and named."""

from dataclasses import replace
from pathlib import Path

import pytest

from minihuman.lab.verify import verify
from minihuman.log.read.open_log import open_log
from minihuman.study.events import EpisodeStarted, Event, Stepped
from minihuman.study.plan import SessionPlan
from minihuman.worlds.pose import Pose
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
    result = verify(open_log(record(tmp_path, plan, events)))
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
    result = verify(open_log(record(tmp_path, plan, changed)))
    assert result.difference.startswith("episode 2 step 7: ")
    assert named in result.difference
    assert (result.episodes, result.steps) == (1, STEPS)


def test_another_start_is_named(tmp_path: Path, plan: SessionPlan, events: list[Event]) -> None:
    changed = [
        replace(event, state_hash=event.state_hash ^ 1) if isinstance(event, EpisodeStarted) else event
        for event in events
    ]
    result = verify(open_log(record(tmp_path, plan, changed)))
    assert result.difference.startswith("episode 1 reset: state hash ")


def test_a_seed_that_was_not_played_is_found(tmp_path: Path, plan: SessionPlan, events: list[Event]) -> None:
    changed = [
        replace(event, plan=session_plan(episodes=3).episodes[2]) if isinstance(event, EpisodeStarted) else event
        for event in events[: 2 + 1]
    ]
    result = verify(open_log(record(tmp_path, plan, changed)))
    assert "reset" in result.difference
