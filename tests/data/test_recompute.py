"""Every cell of the tables of two simulated studies is what a second program finds in their logs."""

from pathlib import Path

import pytest

from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.log.read.session_reader import read_log
from minihuman.workflow import export, report, simulate
from tests.counts import count
from tests.recompute import differences

_HEAD = """
[study]
name = "{name}"
version = "2"
seed = 11
participants = 90
closing = ""
[keys]
pool = ["1", "2", "3", "4", "5"]
keyboard_check = false
[[groups]]
name = "a"
[[groups]]
name = "b"
[[groups]]
name = "c"
[[sessions]]
name = "one"
parts = ["practice", "walk", "race"]
[[sessions]]
name = "two"
parts = ["walk", "race"]
"""
_BLOCK = """
[[blocks]]
name = "{name}"
world = "minihuman/MiniGrid-{world}-v0"
actions = ["left", "right", "forward"]
episodes = {episodes}
max_steps = {steps}
"""
_PRACTICE = _BLOCK.format(name="practice", world="Empty-5x5", episodes=1, steps=12) + "analysed = false\n"
_OVERRIDES = "group_overrides.b = { max_steps = 15 }\ngroup_overrides.c = { show_keys = true }\n"
_REAL_TIME = 'pace = "real_time"\nstep_period_ms = 200\nnoop_action = "done"\n'
_RULE = '[[exclusions]]\nreason = "{reason}"\nlevel = "{level}"\nmeasure = "{measure}"\nbelow = {below}\n'
STUDIES = {
    "walks": (
        "human-like",
        _PRACTICE
        + _BLOCK.format(name="walk", world="FourRooms", episodes=3, steps=30)
        + _OVERRIDES
        + _BLOCK.format(name="race", world="Empty-5x5", episodes=2, steps=20)
        + _REAL_TIME
        + _RULE.format(reason="too short", level="episode", measure="steps", below=6)
        + _RULE.format(reason="too few goals", level="participant", measure="success", below=0.4),
    ),
    "wanders": (
        "random",
        _PRACTICE
        + _BLOCK.format(name="walk", world="Empty-5x5", episodes=6, steps=20)
        + _BLOCK.format(name="race", world="FourRooms", episodes=2, steps=20)
        + _OVERRIDES
        + _RULE.format(reason="idle", level="participant", measure="keys_discovered", below=3),
    ),
}


@pytest.mark.parametrize("name", STUDIES)
def test_every_cell_of_an_export_and_a_report_is_what_the_logs_say(tmp_path: Path, name: str) -> None:
    player, blocks = STUDIES[name]
    protocol = tmp_path / "protocol.toml"
    protocol.write_text(_HEAD.format(name=name) + blocks)
    list(simulate(protocol, participants=count(4, 40), data=tmp_path, player=player))
    study = tmp_path / name
    first, *_, last = sorted(study.rglob("*.mcap"))
    for log, mark in (
        (first, Annotation("exclude", "2026-11-22T09:00:00Z", episode=2)),
        (first, Annotation("seen", "2026-11-22T09:00:00Z")),
        (last, Annotation("exclude", "2026-11-22T09:00:00Z", episode=1)),
        (last, Annotation("exclude", "2026-11-22T09:05:00Z", episode=1, taken_back=True)),
    ):
        add_annotation(read_log(log), mark)
    export("csv", study, tmp_path / "csv")
    assert list(differences(study, tmp_path / "csv")) == []
    report(study, tmp_path / "report")
    for table in ("steps", "presses"):  # a report has none
        (tmp_path / "csv" / f"{table}.csv").rename(tmp_path / "report" / "tables" / f"{table}.csv")
    assert list(differences(study, tmp_path / "report" / "tables")) == []
    page = tmp_path / "report" / "tables" / "episodes.csv"
    page.write_text(page.read_text().replace('"timeout"', '"goal"', 1))
    assert len(list(differences(study, tmp_path / "report" / "tables"))) == 1
