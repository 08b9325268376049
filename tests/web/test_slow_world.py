"""A world that takes longer for a step than its period: in a browser, too, it only slows down."""

from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.dataset.recording_quality import measure_recording_quality
from minihuman.experiment.machine.events import AxisMoved
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import line, serving
from tests.web.test_gamepad import _HOLD, _PAD, SOUTH, START

pytestmark = [pytest.mark.program, needs("chromium")]
EAST = 1
STEP_S, PERIOD_MS, STEPS = 0.05, 20, 160
_TOML = f"""
[study]
name = "slow"
version = "1"
seed = 3
closing = ""
[keys]
pool = ["pad_south", "pad_east"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["counter"]
[[blocks]]
name = "counter"
world = "tests.worlds.slow:tests/SlowCounter-v0"
options = {{ step_s = {STEP_S} }}
episodes = 1
actions = ["up", "down"]
key_map = "fixed"
fixed_keys = {{ pad_south = "up", pad_east = "down" }}
max_steps = {STEPS}
pace = "real_time"
step_period_ms = {PERIOD_MS}
noop_action = "rest"
final_frame_ms = 0
"""
_NOISE = """
(function move() { window.pad.axes[2] = 0.5 + 0.4 * Math.random(); requestAnimationFrame(move); })()
"""
_TO_PICTURE = """
async ([button, down]) => {
  const canvas = document.querySelector("canvas"), before = canvas.toDataURL(), began = performance.now();
  window.pad.buttons[button] = { pressed: true, value: 1 };
  while (canvas.toDataURL() === before && performance.now() - began < 20000) await new Promise(requestAnimationFrame);
  const ms = performance.now() - began;
  await new Promise((done) => setTimeout(done, 700)); // it repeats itself meanwhile
  window.pad.buttons[button] = { pressed: false, value: 0 };
  return ms;
}
"""


@pytest.mark.nightly
@pytest.mark.parametrize("hold", ["once", "repeat"])
@pytest.mark.parametrize("rtt_ms", [0.0, 200.0])
def test_key_to_picture_stays_within_a_few_steps_though_each_takes_longer_than_its_period(
    hold: str, rtt_ms: float, tmp_path: Path
) -> None:
    path = tmp_path / "slow.toml"
    path.write_text(_TOML + f'hold = "{hold}"\n')
    with serving(path, tmp_path) as served, line(served.port, rtt_ms=rtt_ms) as wire, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        page = person.page
        page.get_by_text("This study is played with a gamepad.").wait_for()
        page.evaluate(_PAD + "dispatchEvent(new Event('gamepadconnected'));" + _NOISE)
        person.until("s.welcomed && s.kind === 'text'")
        page.wait_for_timeout(3500)  # somebody reads; the line is measured meanwhile
        while not person.state["playing"]:
            for down in (True, False):
                page.evaluate(_HOLD, [START, down])
                page.wait_for_timeout(80)
        person.until("s.confirmed >= 1")
        page.wait_for_timeout(1500)  # 75 periods, in which the world makes 30 steps
        to_picture_ms = []
        while not person.state["finished"] and len(to_picture_ms) < 4:
            to_picture_ms.append(page.evaluate(_TO_PICTURE, [(SOUTH, EAST)[len(to_picture_ms) % 2], True]))
            page.wait_for_timeout(500)  # what is held for longer is a few steps late, too
        person.until("s.finished")
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    session = read_log(log)
    [episode] = session.episodes
    made = np.diff(episode.t_ns[1:]) / 1e6
    played_ns = episode.t_ns[1], episode.t_ns[-1]
    moved = [
        event
        for event in session.part_events
        if isinstance(event, AxisMoved) and played_ns[0] < event.t_ns < played_ns[1]
    ]
    quality = measure_recording_quality(session)
    print(f"steps {np.mean(made):.0f} ms apart, missed {quality.periods_missed} of {quality.periods} periods")
    print(f"hold {hold}, {rtt_ms:g} ms: key to picture {np.round(to_picture_ms)} ms")
    assert max(to_picture_ms) < rtt_ms + 20 * np.mean(made), to_picture_ms  # 280 steps late, when nothing bounded it
    assert list(find_log_differences(log, World)) == []
    assert len(episode.actions) == STEPS
    assert {1, 2} <= {*episode.actions}, "no press is lost"
    assert 10 < len(moved) < 1.2 * STEPS, "a stick is read about as often as the world steps"
    assert np.mean(made) > 1000 * STEP_S * 0.9, "a step each time that the world is ready for one"
    assert quality.periods == quality.periods_missed + STEPS - 1
    assert quality.periods_missed == pytest.approx(np.sum(made) / PERIOD_MS - STEPS, abs=3)
