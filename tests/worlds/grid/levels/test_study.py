"""A study of instructions: played, logged clause by clause, verified, and read as tables."""

import re
from pathlib import Path

import pytest

from minihuman.lab.protocol_file import read_protocol
from minihuman.lab.verify import verify
from minihuman.log.read.open_log import open_log, read_events
from minihuman.seats.simulate import simulate
from minihuman.study.events import ClauseDone, EpisodeStarted, Stepped
from minihuman.study.well_formed import complaints
from minihuman.worlds.grid.instructions.language import clauses, parse

pytestmark = [pytest.mark.program, pytest.mark.filterwarnings("ignore:.*out of date")]

STUDY = read_protocol(Path(__file__).parents[4] / "protocols" / "instructions.toml")


@pytest.mark.parametrize("player", ["exploring", "human-like"])
def test_a_session_of_eight_levels_is_played_and_verifies(tmp_path, player):
    (path,) = simulate(STUDY, tmp_path, participants=1, seed=3, player=player)
    log = open_log(path)
    assert log.end_reason == "complete"
    assert verify(log).difference == ""
    events = list(read_events(path))
    assert complaints(events) == []
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


def test_the_code_in_the_docs_runs():
    page = (Path(__file__).parents[4] / "docs" / "instructions.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.S)
    assert len(blocks) >= 5
    exec(compile("\n".join(blocks), "instructions.md", "exec"), {"__name__": "instructions"})
