from collections.abc import Iterator

from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.experiment.keys import assign_keys
from minihuman.experiment.machine.inputs import KeyDown, KeyUp, Stop
from minihuman.experiment.machine.screens import PlayScreen, TextScreen
from minihuman.runtime.demo import FreePlay, run_free_play

WORLD = "minigrid:MiniGrid-Empty-5x5-v0"  # the goal is two steps ahead, a turn, two steps
TO_THE_GOAL = ("up", "up", "right", "up", "up")


def taps(*keys: str) -> Iterator[KeyDown | KeyUp]:
    for number, key in enumerate(keys, start=1):
        yield KeyDown(number * 10, key)
        yield KeyUp(number * 10 + 5, key)


def played(*keys: str) -> tuple[int, ScriptedWindow]:
    clock = VirtualClock()
    window = ScriptedWindow(taps(*keys), clock)
    return run_free_play(FreePlay(WORLD, seed=3), window, clock), window


def test_arrows_move_and_the_keys_are_on_the_screen() -> None:
    begun, window = played(*TO_THE_GOAL, "escape")
    first, *_, last = window.screens
    assert begun == 1
    assert isinstance(first, PlayScreen)
    assert dict(first.legend)["up"] == "forward"
    assert "Seed 3" in first.progress
    assert isinstance(last, TextScreen)
    assert last.title == "Goal reached"


def test_enter_goes_on_to_the_next_layout_and_backspace_gives_up_on_one() -> None:
    begun, window = played(*TO_THE_GOAL, "enter", "up", "backspace", "escape")
    assert begun == 3
    assert isinstance(window.screens[-1], PlayScreen)
    assert "Seed 5" in window.screens[-1].progress


def test_keys_without_an_action_do_nothing() -> None:
    _, window = played("q", "f3", "escape")
    assert len(window.screens) == 1


def test_keys_that_arrive_together_are_all_played() -> None:
    clock = VirtualClock()
    strokes = [KeyDown(5, "up"), KeyUp(5, "up"), KeyDown(5, "right"), KeyUp(5, "right"), KeyDown(5, "escape")]
    window = ScriptedWindow(strokes, clock)
    run_free_play(FreePlay(WORLD), window, clock)
    assert [screen.step for screen in window.screens if isinstance(screen, PlayScreen)] == [0, 1, 2]


def test_closing_the_window_ends_it() -> None:
    clock = VirtualClock()
    window = ScriptedWindow([Stop(5, "window_closed")], clock)
    assert run_free_play(FreePlay(WORLD), window, clock) == 1


def test_actions_without_a_usual_key_get_digits() -> None:
    actions = ("turn_left", "turn_right", "move_forward", "jump", "left")
    assert assign_keys(actions) == {
        "left": "turn_left",
        "right": "turn_right",
        "up": "move_forward",
        "1": "jump",
        "2": "left",
    }
