"""A study of drawn tasks: played, recorded and verified."""

from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import EpisodeStarted
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.runtime.simulated_session import simulate

pytestmark = pytest.mark.program

STUDY = read_protocol(Path(__file__).parents[4] / "protocols" / "rules.toml")


def test_a_session_of_twenty_drawn_tasks_is_played_and_verifies(tmp_path):
    (path,) = simulate(STUDY, tmp_path, participants=1, seed=3, player="random")
    log = read_log(path)
    assert log.end_reason == "complete"
    assert len(log.episodes) == 20
    assert verify_episodes(log).difference == ""
    events = list(read_events(path))
    assert find_violations(events) == []
    missions = [event.mission for event in events if isinstance(event, EpisodeStarted)]
    assert all(mission.startswith("Goal: ") for mission in missions)
    assert all("Rule" in mission for mission in missions[5:])
    assert len(set(missions)) == 20
