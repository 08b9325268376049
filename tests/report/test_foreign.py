"""Studies that have nothing to do with the published one: every block in the report, and no line of another study."""

from pathlib import Path

import pytest

from minihuman.dataset.tables import select
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from tests.counts import count
from tests.report.reports import write_report

pytestmark = pytest.mark.program

HEAD = """
[study]
name = "{name}"
version = "2"
seed = 3
participants = 12
[keys]
keyboard_check = false
[[groups]]
name = "early"
blocks = [{blocks}]
[[groups]]
name = "late"
blocks = [{blocks}]
"""
UPSTREAM = """
[[blocks]]
name = "practice"
world = "minigrid:MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
[[blocks]]
name = "door"
world = "minigrid:MiniGrid-DoorKey-5x5-v0"
episodes = 2
actions = ["left", "right", "forward", "pickup", "toggle"]
max_steps = 40
"""
ARCADE = """
[[blocks]]
name = "paddle"
world = "tests.worlds.paddle:tests/Paddle-v0"
success = "terminated and reward > 0"
episodes = 3
actions = ["noop", "left", "right"]
max_steps = 60
"""
REAL_TIME = """
[[blocks]]
name = "slow"
world = "minihuman/MiniGrid-Dynamic-Obstacles-6x6-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 30
pace = "real_time"
step_period_ms = 500
[[blocks]]
name = "fast"
world = "minihuman/MiniGrid-Dynamic-Obstacles-6x6-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 30
pace = "real_time"
step_period_ms = 150
"""
QUESTIONS = """
[study]
name = "survey"
version = "1"
seed = 5
participants = 8
[[groups]]
name = "everyone"
parts = ["welcome", "mood"]
[keys]
keyboard_check = false
[[pages]]
name = "welcome"
text = "A few questions."
[[questions]]
name = "mood"
[[questions.items]]
name = "how"
kind = "likert"
ask = "How are you?"
points = 5
[[questions.items]]
name = "age"
kind = "number"
ask = "How old are you?"
"""
STUDIES = {
    "upstream": (UPSTREAM, ("practice", "door")),
    "arcade": (ARCADE, ("paddle",)),
    "clockwork": (REAL_TIME, ("slow", "fast")),
}


@pytest.mark.nightly(by_day=["upstream"])
@pytest.mark.parametrize("name", STUDIES)
def test_a_foreign_study_has_every_block_in_its_report_and_no_line_of_another(name: str, tmp_path: Path) -> None:
    blocks_toml, blocks = STUDIES[name]
    listed = ", ".join(f'"{block}"' for block in blocks)
    protocol = decode_protocol((HEAD.format(name=name, blocks=listed) + blocks_toml).encode())
    for _ in simulate(protocol, tmp_path, participants=count(4, 12), seed=1, player="random"):
        pass
    where, *_ = write_report(select(tmp_path / name, processes=1), tmp_path / "out")
    text = where.read_text()
    for block in blocks:
        assert f'<h2 id="block-{block}">Block {block}</h2>' in text
        assert f"Measures of block {block}" in text
        assert f"over the episodes of block {block}" in text
        assert f"Block {block}:" in text, "the methods name it"
    for other in ("Published", "Chevalier", "FourRooms", "Transfer", "transfer"):
        assert other not in text
    assert "Played by: random" in text
    assert "Time-outs" not in text, "an episode may end without the goal in other ways"
    assert f"Protocol of study {name}: version 2, SHA-256 {protocol.sha256}" in text
    assert not any(word in text for word in (">nan<", "None<", "<td></td>"))


def test_a_study_of_questions_only_has_its_answers_in_the_report(tmp_path: Path) -> None:
    protocol = decode_protocol(QUESTIONS.encode())
    for _ in simulate(protocol, tmp_path, participants=3, seed=1, player="random"):
        pass
    where, *_ = write_report(select(tmp_path / "survey", processes=1), tmp_path / "out")
    text = where.read_text()
    for words in (">Answers</h2>", "mood", "how", "age", "3 participants took part"):
        assert words in text
    for other in ("Block", "Paths", "Published", "Transfer", "FourRooms", ">nan<", "pooled", "no episode counts"):
        assert other not in text
    assert "3 participants and 0 episodes are included" in text
    assert "Protocol version 1" in text
