import os
import re
import signal
import time
from collections.abc import Sequence

import pytest

from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.errors import LogError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    Event,
    FrameShown,
    KeyPressed,
    SessionEnded,
    Stepped,
)
from minihuman.experiment.machine.inputs import FocusChanged, Input, KeyDown, KeyUp
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.words import InterfaceWords
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, corridor_plan, key_of

PLAN = corridor_plan(episodes=1)
FORWARD = key_of(PLAN, "forward")


def taps(*keys: str, from_ms: int = 10, every_ms: int = 20) -> list[Input]:
    script: list[Input] = []
    for number, key in enumerate(keys):
        at = (from_ms + number * every_ms) * MS
        script += [KeyDown(at, key, key), KeyUp(at + 5 * MS, key, key)]
    return script


def run(script: list[Input], plan=PLAN, *, frame_ns: int = 0):
    clock = VirtualClock()
    window, recorder = ScriptedWindow(script, clock, frame_ns=frame_ns), MemoryRecorder()
    run_session(SessionMachine(plan, World, {}), window, recorder, clock)
    assert find_violations(recorder.events) == []
    return window, recorder.events


def of(events: Sequence[Event], kind):
    return [event for event in events if isinstance(event, kind)]


def test_a_script_of_keys_becomes_a_complete_log():
    window, events = run(taps("enter", FORWARD, FORWARD, FORWARD))
    assert [event.outcome for event in of(events, EpisodeEnded)] == ["goal"]
    assert of(events, SessionEnded)[0].reason == "complete"
    assert [screen.step for screen in window.screens if isinstance(screen, PlayScreen)] == [0, 1, 2]


def test_two_taps_within_one_frame_both_step():
    plan = corridor_plan(episodes=1, max_steps=9)
    both = [KeyDown(50 * MS, FORWARD), KeyUp(50 * MS, FORWARD), KeyDown(50 * MS, FORWARD), KeyUp(50 * MS, FORWARD)]
    window, events = run([*taps("enter"), *both], plan)
    assert [event.step for event in of(events, Stepped)] == [1, 2]
    assert [screen.step for screen in window.screens if isinstance(screen, PlayScreen)] == [0, 1, 2]


def test_every_new_picture_is_shown_once_and_logged_with_its_times():
    _, events = run(taps("enter", FORWARD, FORWARD, FORWARD, from_ms=60, every_ms=40), frame_ns=16 * MS)
    told = [(event.step, event.flip_ns - event.submit_ns) for event in of(events, FrameShown)]
    assert told == [(0, 16 * MS), (1, 16 * MS), (2, 16 * MS)]
    # pressed 40 ms after the last press, whose picture took 16 ms to be seen
    assert [event.rt_ms for event in of(events, Stepped)] == [24.0, 24.0, 24.0]


def test_what_is_shown_was_written_before():
    clock = VirtualClock()
    recorder = MemoryRecorder()

    class Watchful(ScriptedWindow):
        def show(self, screen: Screen):
            if isinstance(screen, PlayScreen) and screen.step:
                assert of(recorder.events, Stepped)[-1].step == screen.step
            return super().show(screen)

    window = Watchful(taps("enter", FORWARD, FORWARD, FORWARD), clock)
    run_session(SessionMachine(PLAN, World, {}), window, recorder, clock)
    assert of(recorder.events, SessionEnded)[0].reason == "complete"


def test_a_real_time_block_is_ticked_without_any_key():
    plan = corridor_plan(episodes=1, max_steps=3, more='pace = "real_time"\nstep_period_ms = 100\nnoop_action = "stay"')
    _, events = run([*taps("enter"), FocusChanged(5_000 * MS, focused=True)], plan)
    assert [event.t_ns // MS for event in of(events, Stepped)] == [110, 210, 310]


def test_closing_the_window_mid_episode_says_abandoned():
    _, events = run(taps("enter", FORWARD))
    assert [event.outcome for event in of(events, EpisodeEnded)] == ["abandoned"]
    assert of(events, SessionEnded)[0].reason == "window_closed"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_session_not_the_process(number):
    class Interrupted(ScriptedWindow):
        def wait(self, until_ns):
            inputs = super().wait(until_ns)
            if any(isinstance(happened, KeyUp) and happened.key == FORWARD for happened in inputs):
                os.kill(os.getpid(), number)
                time.sleep(0)  # let the handler run
            return inputs

    clock, recorder = VirtualClock(), MemoryRecorder()
    before = signal.getsignal(number)
    window = Interrupted([*taps("enter", FORWARD), KeyDown(9_000 * MS, "q")], clock)
    run_session(SessionMachine(PLAN, World, {}), window, recorder, clock)
    end = of(recorder.events, SessionEnded)[0]
    assert (end.reason, end.detail) == ("signal", signal.Signals(number).name)
    assert signal.getsignal(number) is before
    assert not any(event.key == "q" for event in of(recorder.events, KeyPressed))


class FullDisk(MemoryRecorder):
    """Takes three steps, then has no room left."""

    closed = False

    def begin(self, events: Sequence[Event]) -> None:
        if self.durable_steps >= 3:
            raise LogError("recording stopped: no space left on device")
        super().begin(events)

    def close(self) -> None:
        self.closed = True


def test_a_full_disk_stops_the_session_visibly_and_keeps_what_was_written():
    plan = corridor_plan(episodes=1, max_steps=50)
    clock, recorder = VirtualClock(), FullDisk()
    window = ScriptedWindow(taps("enter", *[key_of(plan, "back")] * 9), clock)
    with pytest.raises(LogError, match="no space left"):
        run_session(SessionMachine(plan, World, {}), window, recorder, clock)
    assert recorder.closed
    assert len(of(recorder.events, Stepped)) == 3
    assert_says(window, "disk_full", "over.kept_in_part")


class FullBehind(MemoryRecorder):
    """Takes what it is given, and says only when it is waited for that there was no room."""

    def settle(self) -> None:
        if self.durable_steps > 3:
            raise LogError("recording stopped: no space left on device")


def test_the_picture_of_a_step_that_could_not_be_written_is_not_shown():
    plan = corridor_plan(episodes=1, max_steps=50)
    clock = VirtualClock()
    window = ScriptedWindow(taps("enter", *[key_of(plan, "back")] * 9), clock)
    with pytest.raises(LogError, match="no space left"):
        run_session(SessionMachine(plan, World, {}), window, FullBehind(), clock)
    assert max(screen.step for screen in window.screens if isinstance(screen, PlayScreen)) == 3
    assert_says(window, "disk_full", "over.kept_in_part")


def test_a_world_that_breaks_is_said_on_the_screen_until_a_key_is_pressed():
    plan = corridor_plan(episodes=1)
    window, events = run(taps("enter", key_of(plan, "crash"), "enter", "q"), plan)
    assert of(events, SessionEnded)[0].reason == "world_error"
    assert "collapsed" in of(events, SessionEnded)[0].detail
    assert_says(window, "world_error", "over.kept")


class FullAtTheEnd(MemoryRecorder):
    """Has no room for the session's end."""

    def settle(self) -> None:
        if any(isinstance(event, SessionEnded) for event in self.events):
            raise LogError("recording stopped: no space left on device")


@pytest.mark.parametrize("last", ["crash", "forward"], ids=["the world failed", "the goal was reached"])
def test_an_end_that_could_not_be_written_is_never_said_to_be_kept(last: str) -> None:
    plan = corridor_plan(episodes=1)
    clock = VirtualClock()
    window = ScriptedWindow(taps("enter", *[key_of(plan, last)] * 3), clock)
    with pytest.raises(LogError, match="no space left"):
        run_session(SessionMachine(plan, World, {}), window, FullAtTheEnd(), clock)
    assert_says(window, "disk_full", "over.kept_in_part")


def assert_says(window: ScriptedWindow, reason: str, kept: str) -> None:
    """Look at the last screen: what happened, what is kept, and a code in place of the error."""
    screen = window.screens[-1]
    assert isinstance(screen, TextScreen)
    words = InterfaceWords("en")
    body, _, code = screen.body.partition("\n\n")
    assert (screen.title, body) == (words[f"over.{reason}"], words[kept])
    assert re.fullmatch(r"[A-Z]-[0-9A-F]{4}", code)


def test_a_screen_nobody_acknowledges_goes_away_by_itself():
    plan = corridor_plan(episodes=1)
    clock, recorder = VirtualClock(), MemoryRecorder()
    script = [*taps("enter", key_of(plan, "crash")), FocusChanged(10**15, focused=True)]
    run_session(SessionMachine(plan, World, {}), ScriptedWindow(script, clock), recorder, clock, last_screen_s=3.0)
    assert clock() < 4_000 * MS


def test_a_window_that_breaks_leaves_a_finished_log_and_says_so():
    class Breaks(ScriptedWindow):
        def show(self, screen: Screen):
            if isinstance(screen, PlayScreen):
                raise RuntimeError("display gone")
            return super().show(screen)

    clock, recorder = VirtualClock(), MemoryRecorder()
    with pytest.raises(RuntimeError, match="display gone"):
        run_session(SessionMachine(PLAN, World, {}), Breaks(taps("enter"), clock), recorder, clock)
    assert [event.outcome for event in of(recorder.events, EpisodeEnded)] == ["abandoned"]
    assert of(recorder.events, SessionEnded)[0].reason == "internal_error"
    assert find_violations(recorder.events) == []
