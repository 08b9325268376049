"""Swipes over the picture on a phone: each presses an arrow key, for as long as the finger is down."""

from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.web.test_phone import PHONE_PX

pytestmark = [pytest.mark.program, needs("chromium")]
_TOML = """
[study]
name = "swipes"
version = "1"
seed = 4
closing = ""
[keys]
pool = ["left", "right", "up"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
key_map = "fixed"
fixed_keys = { left = "left", right = "right", up = "forward" }
max_steps = 4
final_frame_ms = 0
[web]
require_keyboard = false
"""
WAYS = (("right", 80, 10), ("left", -60, 20), ("down", 5, 70), ("up", 8, -70), ("right", 50, 0))


def test_swipes_over_the_picture_are_presses_of_the_arrows_that_are_played_with(tmp_path: Path) -> None:
    path = tmp_path / "swipes.toml"
    path.write_text(_TOML)
    with serving(path, tmp_path) as served, browsing(size=PHONE_PX) as sit_down:
        url = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        person = sit_down(url, has_touch=True, is_mobile=True, device_scale_factor=2)
        page = person.page
        touch = page.context.new_cdp_session(page)
        person.until_seen("s.welcomed && s.kind === 'text'")
        page.touchscreen.tap(*_middle(page, "#touch [data-key=enter]"))
        person.until("s.playing && s.confirmed === 0")
        x, y = _middle(page, "canvas")
        page.screenshot(path=str(tmp_path / "play.png"))

        def move(kind: str, dx: float = 0, dy: float = 0) -> None:
            points = [] if kind == "touchEnd" else [{"x": x + dx, "y": y + dy}]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        page.touchscreen.tap(x, y)  # no swipe
        for _, dx, dy in WAYS:
            move("touchStart")
            for share in (0.2, 0.5, 1.0):
                move("touchMove", share * dx, share * dy)
                page.wait_for_timeout(20)
            page.wait_for_timeout(60)
            move("touchEnd")
            page.wait_for_timeout(150)
        person.to_end()
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    session = read_log(log)
    [episode] = session.episodes
    presses = [press for press in episode.keys if press.key != "enter" and press.verdict != "repeat"]
    pressed = [(press.key, press.down) for press in presses]
    taken = [way for way, _, _ in WAYS if way != "down"]  # no action is on it
    assert [key for key, down in pressed if down] == taken
    assert [key for key, down in pressed if not down][: len(taken) - 1] == taken[:-1]
    assert list(episode.step_keys) == taken


def _middle(page, selector: str) -> tuple[float, float]:
    box = page.locator(selector).first.evaluate("element => element.getBoundingClientRect().toJSON()")
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
