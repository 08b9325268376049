"""Earlier logs in which a key that was down before the focus was accepted are named."""

from pathlib import Path

import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.dataset.recording_quality import measure_recording_quality
from minihuman.experiment.machine.inputs import FocusChanged, KeyDown, KeyUp, Stop, Tick
from minihuman.experiment.machine.session import KEY_RULES, SessionMachine
from minihuman.log.model.doubtful_presses import describe_doubtful_presses, find_doubtful_presses
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.sections import quality_section
from minihuman.worlds.adapters.world import World
from tests.log.played import record
from tests.study.sessions import MS, corridor_plan

PLAN = corridor_plan(consent="May we?")


def play(folder: Path, facts: dict[str, str], *, pressed_ms: int, taken_ms: int = 1000) -> Path:
    """A session in which the focus came after 1 s, and Enter, pressed then, was taken then."""
    machine = SessionMachine(PLAN, World, {"player": "human"} | facts)
    events = machine.receive(Tick(0))
    events += machine.receive(FocusChanged(1 * MS, False))
    events += machine.receive(FocusChanged(1000 * MS, True))
    events += machine.receive(KeyDown(pressed_ms * MS, "enter"), at_ns=taken_ms * MS)
    events += machine.receive(KeyUp(2500 * MS, "enter"))
    events += machine.receive(Stop(3000 * MS, "window_closed"))
    return record(folder, PLAN, events)


@pytest.mark.parametrize(
    ("facts", "pressed_ms", "taken_ms", "certain"),
    [
        ({"window": "pygame"}, 600, 1000, [True]),  # its own record says when the key went down
        ({"window": "pygame"}, 980, 1000, [False]),  # as close as a window that was busy may be
        ({"window": "pygame"}, 1001, 1001, []),
        ({"window": "pyglet"}, 1248, 1248, [False]),  # the system's auto-repeat, or a finger
        ({"window": "pyglet"}, 3_100, 3_100, []),
        ({"window": "pygame", "key_rules": KEY_RULES}, 600, 1000, []),
        ({}, 1001, 1001, []),
    ],
)
def test_which_presses_are_named(
    facts: dict[str, str], pressed_ms: int, taken_ms: int, certain: list[bool], tmp_path: Path
) -> None:
    log = read_log(play(tmp_path, facts, pressed_ms=pressed_ms, taken_ms=taken_ms))
    presses = find_doubtful_presses(log)
    assert [press.is_certain for press in presses] == certain
    assert [press.key for press in presses] == ["enter"] * len(certain)


def test_verify_and_the_report_name_them(tmp_path: Path) -> None:
    path = play(tmp_path, {"window": "pygame"}, pressed_ms=600)
    words = (
        "keys that were down before the window had the focus were accepted: 1 for certain, 0 possibly "
        "(enter at 1.000 s)"
    )
    assert (words, True) in list(verify_session(path))
    assert words in quality_section([measure_recording_quality(read_log(path))]).lead
    assert describe_doubtful_presses([]) == ""


def test_a_session_that_never_lost_the_focus_has_none(tmp_path: Path) -> None:
    machine = SessionMachine(PLAN, World, {"player": "human", "window": "pygame"})
    events = machine.receive(Tick(0)) + machine.receive(KeyDown(1 * MS, "enter"))
    events += machine.receive(Stop(2 * MS, "window_closed"))
    assert find_doubtful_presses(read_log(record(tmp_path, PLAN, events))) == []
