from minihuman.display.windows.blocking_window import REPEAT_DELAY_NS, REPEAT_PERIOD_NS, KeyRepeater
from minihuman.experiment.machine.inputs import KeyDown, KeyUp


def test_a_press_of_a_key_that_is_down_is_the_systems_repeat() -> None:
    held = KeyRepeater()
    assert held.press(1, "1", "1") == [KeyDown(1, "1", "1")]
    assert held.press(2, "1", "1") == []
    assert held.release(3, "1", "1") == [KeyUp(3, "1", "1")]
    assert held.press(4, "1", "1") == [KeyDown(4, "1", "1")]


def test_a_held_key_repeats_after_the_delay_then_each_period() -> None:
    held = KeyRepeater()
    held.press(0, "1", "1")
    assert held.repeats(REPEAT_DELAY_NS - 1) == []
    assert held.repeats(REPEAT_DELAY_NS) == [KeyDown(REPEAT_DELAY_NS, "1", "1", repeat=True)]
    assert held.next_repeat_ns == REPEAT_DELAY_NS + REPEAT_PERIOD_NS


def test_a_loop_that_comes_late_gets_one_repeat() -> None:
    held = KeyRepeater()
    held.press(0, "1", "1")
    late_ns = REPEAT_DELAY_NS + 10 * REPEAT_PERIOD_NS
    assert len(held.repeats(late_ns)) == 1
    assert held.repeats(late_ns) == []
    assert held.next_repeat_ns == late_ns + REPEAT_PERIOD_NS


def test_the_last_key_pressed_is_the_one_that_repeats() -> None:
    held = KeyRepeater()
    held.press(0, "1", "1")
    held.press(1, "2", "2")
    held.release(2, "1", "1")
    (repeat,) = held.repeats(2 * REPEAT_DELAY_NS)
    assert repeat.key == "2"
    held.release(3, "2", "2")
    assert held.next_repeat_ns is None


def test_when_the_focus_goes_every_key_comes_up_by_no_finger() -> None:
    held = KeyRepeater()
    held.press(0, "1", "1")
    held.press(1, "2", "2")
    assert held.release_all(5) == [KeyUp(5, "1", "1", "focus_loss"), KeyUp(6, "2", "2", "focus_loss")]
    assert held.next_repeat_ns is None
    assert held.press(7, "1", "1") == [KeyDown(7, "1", "1")]


def test_a_key_that_was_down_before_the_focus_is_said_once_and_repeats_nothing() -> None:
    held = KeyRepeater()
    assert held.press(0, "1", "", "held_before_focus") == [KeyDown(0, "1", "", cause="held_before_focus")]
    assert held.press(1, "1", "1") == []
    assert held.next_repeat_ns is None
    assert held.release(2, "1", "1") == [KeyUp(2, "1", "1")]


def test_a_release_without_a_press_says_that_the_key_was_down_before() -> None:
    held = KeyRepeater()
    assert held.release(2, "1", "1") == [KeyDown(2, "1", "1", cause="held_before_focus"), KeyUp(3, "1", "1")]
