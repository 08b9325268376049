"""A gamepad and clicks in the page: the Gamepad API read once a frame, and places in the world's picture."""

from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import AxisMoved, PointerUsed
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

pytestmark = [pytest.mark.program, needs("chromium")]
_TOML = """
[study]
name = "hands"
version = "1"
seed = 3
closing = ""
[keys]
pool = ["pad_south", "pad_east"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["sticks", "board"]
[[blocks]]
name = "sticks"
world = "tests.worlds.levers:tests/Levers-v0"
success = "terminated and reward > 0"
options = { kind = "box" }
episodes = 1
actions = ["axis_1_plus"]
key_map = "fixed"
fixed_keys = { pad_south = "axis_1_plus" }
max_steps = 40
pace = "real_time"
step_period_ms = 60
noop_action = "rest"
hold = "repeat"
final_frame_ms = 0
axes = { pad_left_x = { component = 0, scale = -1.0 } }
[[blocks]]
name = "board"
world = "tests.worlds.levers:tests/Levers-v0"
success = "terminated and reward > 0"
options = { kind = "board" }
episodes = 1
actions = ["choice_0_1"]
key_map = "fixed"
fixed_keys = { pad_south = "choice_0_1" }
max_steps = 3
final_frame_ms = 0
spot = { x = 1, y = 2, action = "choice_0_2" }
"""
_PAD = """
window.pad = { id: "Stub pad", mapping: "standard", connected: true, axes: [0, 0, 0, 0],
  buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })) };
Object.defineProperty(navigator, "getGamepads", { value: () => [null, window.pad] });
"""
_HOLD = "([button, down]) => { window.pad.buttons[button] = { pressed: down, value: Number(down) }; }"
SOUTH, START = 0, 9


def test_a_pad_and_the_mouse_play_in_the_page_and_the_log_is_proven(tmp_path: Path) -> None:
    path = tmp_path / "hands.toml"
    path.write_text(_TOML)
    with serving(path, tmp_path) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        page = person.page
        person.page.get_by_text("This study is played with a gamepad.").wait_for()
        page.screenshot(path=str(tmp_path / "no-pad.png"))
        assert not list(tmp_path.rglob("*.mcap*")), "nobody is enrolled"
        page.evaluate(_PAD + "dispatchEvent(new Event('gamepadconnected'));")

        def press(button: int, until: str) -> None:
            """Until it leads there: a press before "Ready?" is seen is not taken, nor is one between two frames."""
            for _ in range(100):
                for down in (True, False):
                    page.evaluate(_HOLD, [button, down])
                    page.wait_for_timeout(80)
                if page.evaluate(f"(() => {{ const s = minihuman.state; return {until}; }})()"):
                    return
            person.until(until, patience_s=1)

        person.until("s.welcomed && s.kind === 'text'")
        press(START, "s.playing")
        page.evaluate("window.pad.axes = [0.55, 0.05, 0, 0]")
        person.until("s.confirmed >= 6")
        page.evaluate(_HOLD, [SOUTH, True])
        person.until("s.confirmed >= 12")
        page.evaluate("window.pad.axes = [0, 0, 0, 0]")
        page.evaluate(_HOLD, [SOUTH, False])
        person.until("s.kind === 'text'")
        press(START, "s.playing")
        person.until("s.confirmed === 0")
        assert page.locator("canvas").evaluate("(canvas) => getComputedStyle(canvas).cursor") == "crosshair"
        box = page.locator("canvas").bounding_box()
        for number, (x, y) in enumerate(((0.25, 0.75), (0.5, 0.5))):
            page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            person.until(f"s.confirmed === {number + 1}")
        box = page.locator("canvas").bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] + 8)  # beside it
        page.screenshot(path=str(tmp_path / "board.png"))
        press(SOUTH, "s.finished")
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    session = read_log(log)
    sticks, board = session.episodes
    assert {(-0.5, 0.0), (-0.5, 2.0)} <= {*sticks.actions_taken}
    assert board.actions_taken == [(2.0, 16.0, 48.0), (2.0, 32.0, 32.0), (1.0, 0.0, 0.0)]
    assert {press.symbol for press in session.keys if press.down} == {"gamepad"}
    events = session.part_events
    assert {event.value for event in events if isinstance(event, AxisMoved)} == {0.5, 0.0}
    assert [event.target for event in events if isinstance(event, PointerUsed) and event.what == "pressed"] == [
        "picture"
    ] * 2
    [noted] = [note.text for note in session.segments[0].notes if "gamepad" in getattr(note, "text", "")]
    assert noted == "gamepad Stub pad: 4 axes of -1 to 1, 17 buttons, dead zone 0.1, read once a frame"
