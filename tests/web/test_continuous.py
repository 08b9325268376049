"""Continuous motion in a browser over a long line: the page steps and draws it, and the session agrees at each step."""

import random
import time
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import FrameShown, Noted, Stepped
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import line, serving

pytestmark = [pytest.mark.program, needs("chromium")]

MS = 1_000_000
STEPS = count(150, 6_000)
_TOML = """
[study]
name = "roam"
version = "1"
seed = 3
closing = ""
[keys]
pool = ["up", "down", "left", "right", "space"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["roam"]
[[blocks]]
name = "roam"
world = "minihuman/MiniWorld-PickupObjects-v0"
episodes = 1
actions = ["move_forward", "move_back", "turn_left", "turn_right", "pickup"]
noop_action = "rest"
key_map = "fixed"
pace = "real_time"
step_period_ms = 16.7
hold = "repeat"
axes = {{ mouse_x = {{ component = 1, scale = -0.02 }} }}
final_frame_ms = 0
max_steps = {steps}
options = {{ control = "continuous", acceleration = 0.3, max_steps = 10000 }}
[blocks.fixed_keys]
up = "move_forward"
down = "move_back"
left = "turn_left"
right = "turn_right"
space = "pickup"
"""


@pytest.mark.nightly
def test_free_motion_at_sixty_steps_a_second_is_stepped_in_the_page_over_a_long_line(tmp_path: Path) -> None:
    path = tmp_path / "roam.toml"
    path.write_text(_TOML.format(steps=STEPS))
    rng, rtt_ms = random.Random(9), 1_200.0  # half of it is more than a step takes, on a busy machine too
    with (
        serving(path, tmp_path) as server,
        line(server.port, rtt_ms=rtt_ms) as wire,
        browsing() as sit_down,
    ):
        person = sit_down(f"http://127.0.0.1:{wire.port}/#t={server.tokens[0]}")
        person.to_play()
        began_s, held = time.monotonic(), set()
        person.until("s.playing")
        person.page.locator("canvas").click()
        while person.state["playing"] and not person.state["ended"]:
            key = rng.choice(("ArrowUp", "ArrowUp", "ArrowLeft", "ArrowRight", "ArrowDown", "Space"))
            if key in held:
                person.page.keyboard.up(key)
            else:
                person.page.keyboard.down(key)
            held ^= {key}
            person.page.mouse.move(rng.randrange(100, 700), 300)
            person.page.wait_for_timeout(rng.choice((5, 20, 60)))
            assert time.monotonic() - began_s < PATIENCE_S
        person.page.screenshot(path=str(tmp_path / "end.png"))
        person.until("!s.playing")
        person.to_end()
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    events = list(read_events(log))
    steps = [event for event in events if isinstance(event, Stepped)]
    assert len(steps) == STEPS or steps[-1].terminated
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    vectors = np.array([step.action_vector for step in steps])
    assert ((vectors[:, 0] != 0) & (vectors[:, 1] != 0)).any(), "keys that are held together combine"
    flips = {event.step: event.flip_ns for event in reversed(events) if isinstance(event, FrameShown)}
    late_ms = [(flips[step.step] - step.t_ns) / MS for step in steps if step.step in flips]
    assert len(late_ms) > len(steps) / 8, "a busy machine draws few of sixty pictures a second"
    assert np.median(late_ms) < rtt_ms / 2, "as late as the server's word: nothing was stepped here"
    assert list(find_log_differences(log, World)) == []
