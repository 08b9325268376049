"""Thirty rooms on three floors, walked through along the shortest path: in a window and in a browser, and proved."""

import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.inputs import ScreenShown
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.figures.path_figures import session_paths
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock
from tests.counts import PATIENCE_S
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.window_host import HostedWindow
from tests.worlds.first_person.buildings import ThirtyRooms
from tests.xserver import Typist

pytestmark = [pytest.mark.program, pytest.mark.nightly]

_KEYS = {"turn_left": "left", "turn_right": "right", "move_forward": "up"}
_PARAMETERS = {"forward_step": 0.6, "turn_step": 30}  # long steps, so that a session is short
_TOML = """
[study]
name = "building"
version = "1"
seed = 5
participants = 1
closing = ""
[keys]
pool = ["left", "right", "up"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "tests.worlds.first_person.buildings:tests/ThirtyRooms-v0"
episodes = 1
actions = ["turn_left", "turn_right", "move_forward"]
key_map = "fixed"
fixed_keys = { left = "turn_left", right = "turn_right", up = "move_forward" }
max_steps = 1000
final_frame_ms = 0
options = { trig = 1, parameters = { forward_step = 0.6, turn_step = 30 } }
"""


class WatchedWindow(HostedWindow):
    """A window whose last screen can be looked at."""

    shown: Screen | None = None

    def show(self, screen: Screen) -> ScreenShown:
        flip = super().show(screen)
        self.shown = screen
        return flip


def find_keys(study: Protocol) -> list[str]:
    """Return the keys that lead through the only episode of a study."""
    (episode,) = expand_protocol(study, enrol_participant(study, 0)).episodes
    world = ThirtyRooms(trig=1, parameters=_PARAMETERS)
    world.reset(seed=episode.seed)
    return [_KEYS[world.action_names[action]] for action in world.shortest_path()]


def check_log(path: Path, keys: list[str]) -> None:
    """Check that a log is proved, reached the goal by these keys, and is drawn with a plan for each floor."""
    assert all(ok for _, ok in verify_session(path))
    log = read_log(path)
    (episode,) = log.episodes
    assert episode.outcome == "goal"
    assert len(episode.actions) == len(keys)
    assert episode.start.map.levels == (0.0, 3.0, 6.0)
    heights = episode.poses[:, 1]
    assert (heights[0], heights[-1]) == (0, 6)
    assert np.abs(np.diff(heights)).max() < 0.6
    (axes, *_) = [ax for ax in session_paths(log).axes if ax.collections]
    assert [text.get_text() for text in axes.texts] == ["floor 0", "floor 1", "floor 2"]


def test_a_building_is_walked_through_in_a_window(display: str, tmp_path: Path) -> None:
    typist, window = Typist(display), WatchedWindow("pyglet", display, size_px=(320, 240))
    study = decode_protocol(_TOML.encode())
    keys = find_keys(study)

    def wait_for(holds: Callable[[Screen | None], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not holds(window.shown):
            assert time.monotonic() < deadline_s, f"on the screen: {type(window.shown).__name__}"
            time.sleep(0.002)

    def play() -> None:
        wait_for(lambda screen: isinstance(screen, TextScreen))
        typist.focus(TITLE)
        typist.tap("enter")
        for step, key in enumerate(keys):
            wait_for(lambda screen, step=step: isinstance(screen, PlayScreen) and screen.step == step)
            typist.tap(key)  # after the last one, the session ends

    clock = SessionClock()
    clock.started_monotonic_ns = 0  # as the window's, which is in a process of its own
    player = Thread(target=play, daemon=True)
    player.start()
    try:
        host_session(expand_protocol(study, enrol_participant(study, 0)), window, clock, tmp_path)
    finally:
        player.join(PATIENCE_S)
        window.end()
        typist.close()
    [path] = tmp_path.rglob("*.mcap")
    check_log(path, keys)


@needs("chromium")
def test_a_building_is_walked_through_in_a_browser(tmp_path: Path) -> None:
    path = tmp_path / "building.toml"
    path.write_text(_TOML)
    keys = find_keys(decode_protocol(_TOML.encode()))
    with serving(path, tmp_path, options=("--trust",)) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        person.to_play()
        for step, key in enumerate(keys):
            person.until_seen(f"s.playing && s.step >= {step}")
            person.press(key)
            if step == len(keys) // 2:
                person.page.screenshot(path=str(tmp_path / "halfway.png"))
        person.until("s.kind === 'text'")
        person.to_end()
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    check_log(log, keys)
