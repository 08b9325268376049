"""Two sticks on a phone: thumbs move and turn the body together, and a stick without a thumb rests."""

from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import AxisMoved
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.web.test_phone import PHONE_PX

pytestmark = [pytest.mark.program, needs("chromium")]
_TOML = """
[study]
name = "thumbs"
version = "1"
seed = 3
closing = ""
[keys]
pool = ["up", "down", "x"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniWorld-FourRooms-v0"
episodes = 1
actions = ["move_forward", "move_back"]
noop_action = "rest"
key_map = "fixed"
fixed_keys = { up = "move_forward", down = "move_back" }
max_steps = 60
pace = "real_time"
step_period_ms = 50
hold = "repeat"
final_frame_ms = 0
options = { control = "continuous", trig = 1 }
[blocks.axes]
touch_left_y = { component = 0, scale = -1.0 }
touch_right_x = { component = 1, scale = -0.5 }
[web]
require_keyboard = false
"""
_MIDDLES = """[...document.querySelectorAll(".stick")].map((stick) => {
  const { x, y, width, height } = stick.getBoundingClientRect();
  return [x + width / 2, y + height / 2, width];
})"""


@pytest.mark.nightly
def test_two_thumbs_move_and_turn_and_let_go(tmp_path: Path) -> None:
    path = tmp_path / "thumbs.toml"
    path.write_text(_TOML)
    with serving(path, tmp_path) as served, browsing(size=PHONE_PX) as sit_down:
        url = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        person = sit_down(url, has_touch=True, is_mobile=True, device_scale_factor=2)
        page = person.page
        touch = page.context.new_cdp_session(page)
        person.until_seen("s.welcomed && s.kind === 'text'")
        assert page.locator(".stick").count() == 0
        page.locator("#touch [data-key=enter]").tap()
        person.until("s.playing && s.confirmed >= 2")
        (left_x, left_y, width), (right_x, right_y, _) = page.evaluate(_MIDDLES)
        assert not page.locator("#touch [data-key=up]").is_visible(), "sticks are where arrows would be"

        def put(kind: str, *places: tuple[float, float]) -> None:
            points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(places)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        put("touchStart", (left_x, left_y), (right_x, right_y))
        put("touchMove", (left_x, left_y - width), (right_x + 0.198 * width, right_y))
        person.until("s.confirmed >= 20")
        page.screenshot(path=str(tmp_path / "both.png"))
        put("touchEnd")
        person.to_end()
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    session = read_log(log)
    moved = [(event.axis, event.value) for event in session.part_events if isinstance(event, AxisMoved)]
    assert ("touch_left_y", -1.0) in moved
    assert moved[-2:] == [("touch_left_y", 0.0), ("touch_right_x", 0.0)]
    taken = session.episodes[0].actions_taken
    assert (1.0, -0.25) in taken
    assert taken[0] == taken[-1] == (0.0, 0.0)
