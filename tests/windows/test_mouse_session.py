"""A session at the desk that is steered by the mouse: every pixel of a hand is in its steps, and none of a pause's."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import AxisMoved
from minihuman.experiment.machine.inputs import ScreenShown
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock
from tests.counts import PATIENCE_S
from tests.window_host import HostedWindow
from tests.xserver import Typist

pytestmark = pytest.mark.program

PROTOCOL = """
[study]
name = "mouse"
version = "1"
seed = 1
closing = ""
[keys]
pool = ["x", "y"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["levers"]
[[blocks]]
name = "levers"
world = "tests.worlds.levers:tests/Levers-v0"
success = "terminated and reward > 0"
options = { kind = "box" }
episodes = 1
actions = ["axis_1_plus"]
key_map = "fixed"
fixed_keys = { x = "axis_1_plus" }
max_steps = 20000
pace = "real_time"
step_period_ms = 25
noop_action = "rest"
hold = "repeat"
final_frame_ms = 0
axes = { mouse_x = { component = 0, scale = 0.002 } }
"""


class WatchedWindow(HostedWindow):
    """A window whose last screen can be looked at."""

    shown: Screen | None = None

    def show(self, screen: Screen) -> ScreenShown:
        flip = super().show(screen)
        self.shown = screen
        return flip


def play(window: WatchedWindow, typist: Typist) -> None:
    """Turn, ask to leave, move the free mouse, stay, and turn again until the session is left."""

    def wait_for(holds: Callable[[Screen | None], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not holds(window.shown):
            assert time.monotonic() < deadline_s, f"on the screen: {type(window.shown).__name__}"
            time.sleep(0.005)

    def wait_for_step(later: int) -> None:
        step = getattr(window.shown, "step", 0) + later
        wait_for(lambda screen: isinstance(screen, PlayScreen) and screen.step >= step)

    def sweep(right_px: int, times: int) -> None:
        for _ in range(times):
            typist.move(right_px, 1)
            time.sleep(0.01)

    wait_for(lambda screen: isinstance(screen, TextScreen))
    typist.focus(TITLE)
    typist.tap("enter")
    wait_for_step(2)
    sweep(10, 20)
    wait_for_step(4)  # what was moved last has had its tick
    typist.tap("escape")
    wait_for(lambda screen: isinstance(screen, TextScreen))
    sweep(7, 10)
    typist.tap("enter")
    wait_for(lambda screen: isinstance(screen, PlayScreen))
    sweep(-3, 10)
    wait_for_step(4)
    typist.tap("escape")
    wait_for(lambda screen: isinstance(screen, TextScreen))
    typist.press("escape")  # for as long as it takes: the session ends


@pytest.mark.parametrize("kind", ["pygame", "pyglet"])
def test_the_mouse_steers_a_session_and_a_question_gives_it_back(kind: str, display: str, tmp_path: Path) -> None:
    typist, window = Typist(display), WatchedWindow(kind, display, size_px=(320, 240))
    study = decode_protocol(PROTOCOL.encode())
    clock = SessionClock()
    clock.started_monotonic_ns = 0  # as the window's, which is in a process of its own
    player = Thread(target=play, args=(window, typist), daemon=True)
    player.start()
    try:
        host_session(expand_protocol(study, enrol_participant(study, 0)), window, clock, tmp_path)
    finally:
        player.join(PATIENCE_S if sys.exception() is None else 0)
        typist.release("escape")
        window.end()
        typist.close()
    [path] = tmp_path.rglob("*.mcap")
    assert all(ok for _, ok in verify_session(path))
    log = read_log(path)
    moved = [event for event in log.part_events if isinstance(event, AxisMoved)]
    assert {event.axis for event in moved} == {"mouse_x"}
    assert sum(event.value for event in moved) == 200 - 30
    [episode] = log.episodes
    assert sum(action[0] for action in episode.actions_taken) == pytest.approx(170 * 0.002)
