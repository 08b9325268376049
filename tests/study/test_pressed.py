"""What was down before the window had the focus, shortcuts, and releases by no finger: in the log, without effect."""

import pytest

from minihuman.experiment.machine.events import Event, KeyPressed, Noted, PointerUsed, Stepped
from minihuman.experiment.machine.inputs import (
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerPressed,
    PointerReleased,
    Tick,
)
from minihuman.experiment.machine.session import KEY_RULES, SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import compare_replay
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, corridor_plan, key_of

NOW = {"key_rules": KEY_RULES}
PLAN = corridor_plan(consent="May we?")
FORWARD = key_of(PLAN, "forward")
TO_PLAY = (KeyDown(1, "enter"), KeyUp(2, "enter"), KeyDown(3, "enter"), KeyUp(4, "enter"))


def run(*inputs: Input, facts: dict[str, str] = NOW) -> tuple[SessionMachine, list[Event]]:
    """A session that has had these inputs, a millisecond apart, and whose log replays to the same events."""
    machine = SessionMachine(PLAN, World, facts)
    events = machine.receive(Tick(0))
    for place, given in enumerate(inputs, 1):
        fields = {name: getattr(given, name) for name in given.__dataclass_fields__}
        events += machine.receive(type(given)(**fields | {"t_ns": place * MS}))
    assert list(compare_replay(events, World)) == []
    return machine, events


def list_verdicts(events: list[Event]) -> list[str]:
    return [event.verdict for event in events if isinstance(event, KeyPressed)]


def test_enter_that_was_down_before_the_focus_does_not_consent() -> None:
    machine, events = run(FocusChanged(0, True), KeyDown(0, "enter", cause="held_before_focus"), KeyUp(0, "enter"))
    assert machine.phase is Phase.CONSENT
    assert list_verdicts(events) == ["held_before_focus", "release"]
    assert not any(isinstance(event, Noted) and event.kind == "consent" for event in events)


def test_a_session_that_began_under_the_first_rules_goes_on_under_them() -> None:
    machine, events = run(KeyDown(0, "enter", cause="held_before_focus"), facts={})
    assert machine.phase is not Phase.CONSENT
    assert list_verdicts(events) == ["accepted"]


@pytest.mark.parametrize("cause", ["held_before_focus", "shortcut"])
def test_in_an_episode_such_a_key_makes_no_step(cause) -> None:
    machine, events = run(*TO_PLAY, KeyDown(0, FORWARD, cause=cause), KeyUp(0, FORWARD), KeyDown(0, FORWARD))
    assert machine.phase is Phase.PLAYING
    assert list_verdicts(events)[-3:] == [cause, "release", "accepted"]
    assert sum(isinstance(event, Stepped) for event in events) == 1


@pytest.mark.parametrize("keys", [("f9", "f12"), ("escape",), ("f8",)])
def test_such_keys_neither_end_nor_pause_the_session(keys: tuple[str, ...]) -> None:
    machine, _ = run(*TO_PLAY, *(KeyDown(0, key, cause="held_before_focus") for key in keys))
    assert machine.phase is Phase.PLAYING


def test_a_release_that_no_finger_made_is_marked_and_leaves_the_question_open() -> None:
    machine, events = run(KeyDown(0, "escape"), KeyDown(0, "escape"), KeyUp(0, "escape", "", "focus_loss"))
    assert machine.phase is Phase.QUIT_QUESTION
    assert list_verdicts(events)[-1] == "release_at_focus_loss"


def test_the_click_that_brings_the_focus_presses_no_button() -> None:
    click = (PointerPressed(0, 0.5, 0.9, "go_on", cause="held_before_focus"), PointerReleased(0, 0.5, 0.9, "go_on"))
    machine, events = run(FocusChanged(0, True), *click)
    assert machine.phase is Phase.CONSENT
    assert [event.what for event in events if isinstance(event, PointerUsed)] == ["held_before_focus", "released"]
    machine, _ = run(FocusChanged(0, True), *click, PointerPressed(0, 0.5, 0.9, "go_on"))
    assert machine.phase is not Phase.CONSENT


def test_a_press_that_the_browser_took_over_is_cancelled() -> None:
    _, events = run(PointerPressed(0, 0.5, 0.5, ""), PointerReleased(0, 0.5, 0.5, "", cause="cancelled"))
    assert [event.what for event in events if isinstance(event, PointerUsed)] == ["pressed", "cancelled"]
