"""A page's messages as a session's inputs."""

import pytest

from minihuman.experiment.machine import inputs
from minihuman.experiment.machine.events import KeyPressed, Noted
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.web import messages
from minihuman.web.page_inputs import PageInputs


@pytest.mark.parametrize(
    ("message", "page_input"),
    [
        (messages.KeyMessage("left", True, 90, repeat=True), inputs.KeyDown(90, "left", "", repeat=True)),
        (messages.KeyMessage("left", False, 900), inputs.KeyUp(100, "left", "")),
        (messages.TickMessage(), inputs.Tick(100)),
        (messages.TextMessage("a\x00b\nc"), inputs.TextInput(100, "abc")),
        (
            messages.PointerMessage("moved", 0.5, 0.25, "go_on", 0.75, 80),
            inputs.PointerMoved(80, 0.5, 0.25, "go_on", 0.75),
        ),
        (messages.AxisMessage("pad_left_x", 0.5), inputs.AxisChanged(100, "pad_left_x", 0.5)),
        (messages.MouseMotionMessage("mouse_x", -7, 90), inputs.AxisChanged(90, "mouse_x", -7.0)),
        (messages.FocusMessage(False), inputs.FocusChanged(100, False)),
        (messages.DisplayedMessage(submit=120, flip=110), inputs.ScreenShown(100, 100, 100)),
        (messages.CommandEcho(7), None),
        (messages.GamepadMessage("pad", 4, 17), None),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, messages.PageMessage) else "",
)
def test_what_a_page_did_is_an_input_no_later_than_its_message(message, page_input) -> None:
    assert PageInputs(()).convert(message, 100, is_present=True) == page_input


def test_a_screen_that_is_gone_is_no_input() -> None:
    assert PageInputs(()).convert(messages.DisplayedMessage(1, 2), 100, is_present=False) is None


def test_a_press_that_the_log_does_not_have_was_made_in_a_tab_that_did_not_lead() -> None:
    logged = KeyPressed(70, "left", "", True, 0, "accepted", "play", waited_ns=10)
    page_inputs = PageInputs([logged])
    page_inputs.convert(messages.KeyMessage("up", True, 80), 90, is_present=False)
    [note] = page_inputs.note_missed(messages.KeyMessage("left", True, 61), 90, 100)
    assert note == Noted(100, BROWSER_NOTE, "not taken: left at 61 ns")
    for known in (("left", True, 60), ("up", True, 80), ("left", False, 61)):
        assert page_inputs.note_missed(messages.KeyMessage(*known), 90, 100) == []


def test_a_session_of_any_length_remembers_its_latest_presses_alone() -> None:
    page_inputs = PageInputs(())
    for stamp_ns in range(10_000):
        page_inputs.convert(messages.KeyMessage("up", True, stamp_ns), stamp_ns, is_present=False)
    assert len(page_inputs._keys_down) == 300
    assert page_inputs.note_missed(messages.KeyMessage("up", True, 9_990), 9_990, 10_000) == []
    assert (
        page_inputs.note_missed(messages.KeyMessage("left", True, 10), 10, 10_000) == []
    )  # forgotten: nothing is known
    assert page_inputs.note_missed(messages.KeyMessage("left", True, 9_990), 9_990, 10_000) != []


def test_a_question_to_the_page_is_answered_once() -> None:
    page_inputs = PageInputs(())
    number = page_inputs.ask(inputs.Tick)
    other = page_inputs.ask(inputs.Tick)
    assert page_inputs.open_questions == (number, other)
    echo = messages.CommandEcho(number)
    assert page_inputs.convert(echo, 50, is_present=False) == inputs.Tick(50)
    assert page_inputs.convert(echo, 60, is_present=False) is None
    assert page_inputs.open_questions == (other,)
