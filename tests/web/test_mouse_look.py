"""The mouse as an axis in the page: captured by a click on the picture, given back by every screen that is no play."""

from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import AxisMoved
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

pytestmark = [pytest.mark.program, needs("chromium")]
_TOML = """
[study]
name = "look"
version = "1"
seed = 3
closing = ""
[keys]
pool = ["up", "down"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["look"]
[[blocks]]
name = "look"
world = "minihuman/MiniWorld-FourRooms-v0"
episodes = 2
actions = ["move_forward", "move_back"]
noop_action = "rest"
key_map = "fixed"
fixed_keys = { up = "move_forward", down = "move_back" }
max_steps = 100
pace = "real_time"
step_period_ms = 50
hold = "repeat"
axes = { mouse_x = { component = 1, scale = -0.02 } }
final_frame_ms = 0
options = { control = "continuous", trig = 1 }
"""
_CAPTURED = "document.pointerLockElement !== null"
_LINE = "Click the picture to look around with the mouse."


def test_the_mouse_turns_the_body_from_a_click_on_the_picture_until_the_episode_ends(tmp_path: Path) -> None:
    path = tmp_path / "look.toml"
    path.write_text(_TOML)
    with serving(path, tmp_path) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        page = person.page
        person.until("s.welcomed && s.kind === 'text'")
        page.mouse.move(300, 300)
        person.to_play()
        person.until("s.playing && s.step >= 2")
        page.mouse.move(340, 320)  # nobody has clicked
        page.get_by_text(_LINE).wait_for()
        page.screenshot(path=str(tmp_path / "before.png"))
        page.locator("canvas").click()
        person.until(_CAPTURED)
        page.get_by_text(_LINE).wait_for(state="hidden")  # said in an event that follows the capture
        box = page.locator("canvas").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x + 30, y)
        page.mouse.move(x + 10, y + 9)
        page.screenshot(path=str(tmp_path / "captured.png"))
        person.until("s.kind === 'text'")
        person.until(f"!({_CAPTURED})")
        page.mouse.move(300, 300)
        person.to_play()
        person.until("s.playing && s.step >= 2")
        person.until(_CAPTURED, patience_s=60)  # again, as nobody took it back
        page.screenshot(path=str(tmp_path / "again.png"))
        person.to_end()
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    first, second = read_log(log).episodes
    moved = [event for event in read_log(log).part_events if isinstance(event, AxisMoved)]
    assert {event.axis for event in moved} == {"mouse_x"}
    assert sum(event.value for event in moved) == 10.0
    assert sum(turn for _, turn in first.actions_taken) == pytest.approx(-0.2, abs=2 / 1024)
    assert not any(turn for _, turn in second.actions_taken)
