"""Over a long line: no key is lost, and pictures are there before the server can have heard of the key."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import FrameShown, KeyPressed, Linked, Noted, Stepped
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.protocols import FIRST_PERSON, GRID, study
from tests.web.serving import line, serving

pytestmark = needs("chromium")

RTT_MS = 1_200.0  # far longer than a picture takes, on a busy machine too


@pytest.mark.nightly
@pytest.mark.program
@pytest.mark.parametrize(("world", "keys_hz"), [(GRID, 6.0), (FIRST_PERSON, 4.0)], ids=["grid", "first-person"])
def test_over_a_long_line_no_key_is_lost_and_pictures_do_not_wait_for_it(tmp_path: Path, world, keys_hz) -> None:
    keys = 12
    with (
        serving(study(tmp_path, world, episodes=2, max_steps=keys), tmp_path) as served,
        line(served.port, rtt_ms=RTT_MS) as wire,
        browsing() as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        for _ in range(2):
            somebody.to_play()
            for number in range(keys):
                somebody.press("123"[number % 3])
                somebody.page.wait_for_timeout(1000 / keys_hz)
            somebody.until("!s.playing")
        somebody.to_end()
    [log] = tmp_path.rglob("*.mcap")
    events = list(read_events(log))
    pressed = [event for event in events if isinstance(event, KeyPressed) and event.down and event.verdict != "repeat"]
    assert sum(event.key in "123" for event in pressed) == 2 * keys
    steps = [event for event in events if isinstance(event, Stepped)]
    assert len(steps) == 2 * keys
    flips = {(e.episode, e.step): e.flip_ns for e in reversed(events) if isinstance(e, FrameShown)}
    shown = Counter((event.episode, event.step) for event in events if isinstance(event, FrameShown))
    assert {at: times for at, times in shown.items() if times > 1} == {}, "the server's word of a step is no picture"
    waited_ms = [(flips[s.episode, s.step] - s.key_t_ns) / 1e6 for s in steps if (s.episode, s.step) in flips]
    assert np.median(waited_ms) < RTT_MS, "as long as the line takes: nothing was there before the key"
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == "page"] == []
    linked = [event for event in events if isinstance(event, Linked)]
    assert linked
    assert all(event.least_rtt_ns >= RTT_MS * 1e6 for event in linked), "the line is shorter than it is"
    assert list(find_log_differences(log, World)) == []
