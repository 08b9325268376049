"""A study of instructions: played, logged clause by clause, verified, and read as tables."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import ClauseDone, EpisodeStarted, SessionStarted, Stepped
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from minihuman.worlds.grid.babyai.language import clauses, parse

pytestmark = [pytest.mark.program, pytest.mark.filterwarnings("ignore:.*out of date")]

STUDY = read_protocol(Path(__file__).parents[4] / "protocols" / "instructions.toml")


@pytest.mark.parametrize("player", ["exploring", "human-like"])
def test_a_session_of_eight_levels_is_played_and_verifies(tmp_path, player):
    (path,) = simulate(STUDY, tmp_path, participants=1, seed=3, player=player)
    log = read_log(path)
    assert log.end_reason == "complete"
    assert verify_episodes(log).difference == ""
    events = list(read_events(path))
    assert find_violations(events) == []
    missions = {event.plan.episode: event.mission for event in events if isinstance(event, EpisodeStarted)}
    said = [event for event in events if isinstance(event, ClauseDone)]
    for event in said:
        assert str(clauses(parse(missions[event.episode]))[event.clause]) == event.text
        following = events[events.index(event) + 1 :]
        step = next(each for each in following if isinstance(each, Stepped))
        assert (step.episode, step.step) == (event.episode, event.step)
    if player == "exploring":
        assert {episode.outcome for episode in log.episodes} == {"goal"}
        assert len(said) >= len(log.episodes)


def test_from_inside_clauses_are_told_too_and_logs_of_before_they_were_are_proven(tmp_path):
    study = decode_protocol(
        b"""
        keys.pool = ["1", "2", "3", "4", "5", "6", "7"]
        [study]
        name = "inside"
        version = "1"
        participants = 1
        seed = 1
        [[groups]]
        name = "all"
        blocks = ["walk"]
        [[blocks]]
        name = "walk"
        world = "minihuman/BabyAI-GoToLocal-v0"
        options = { view = "first_person" }
        episodes = 1
        max_steps = 64
        seeds = [0]
        actions = ["left", "right", "forward"]
        """
    )
    (path,) = simulate(study, tmp_path, participants=1, seed=3, player="optimal")
    events = list(read_events(path))
    assert [event.clause for event in events if isinstance(event, ClauseDone)] == [0]
    assert list(compare_replay(events, World)) == []
    without = [event for event in events if not isinstance(event, ClauseDone)]
    assert "ClauseDone" in next(compare_replay(without, World))
    first = without[0]
    assert isinstance(first, SessionStarted)
    earlier = {name: value for name, value in first.facts.items() if name != "clauses"}
    assert list(compare_replay([replace(first, facts=earlier), *without[1:]], World)) == []


def test_the_code_in_the_docs_runs():
    page = (Path(__file__).parents[4] / "docs" / "grid-worlds.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page.partition("\n## BabyAI levels\n")[2], re.S)
    assert len(blocks) >= 5
    exec(compile("\n".join(blocks), "grid-worlds.md", "exec"), {"__name__": "levels"})
