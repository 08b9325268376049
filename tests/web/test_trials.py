"""Trials with a time course in a real browser: the page shows them by its clock, and the log is proven."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from minihuman.activities.trials.events import ResponseTaken, SoundPlayed, StimuliShown
from minihuman.admin.verify.log import find_log_differences
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

pytestmark = [pytest.mark.program, needs("chromium")]
_TASKS = [("priming", "left"), ("stop-signal", "left"), ("n-back", "space"), ("auditory-oddball", "space")]
_SHIPPED = Path(__file__).parents[2] / "protocols" / "trials"


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "key"), _TASKS)
def test_twenty_trials_in_the_browser_are_a_log_that_verifies(tmp_path: Path, name: str, key: str) -> None:
    lines = (_SHIPPED / f"{name}.toml").read_text().splitlines()
    toml = ["episodes = 20" if line.startswith("episodes") else line for line in lines]
    (tmp_path / f"{name}.toml").write_text("\n".join(toml))
    for table in _SHIPPED.glob(f"{name}.csv"):
        (tmp_path / table.name).write_bytes(table.read_bytes())
    with serving(tmp_path / f"{name}.toml", tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        picture = b""
        while not somebody.page.evaluate("minihuman.state.finished"):
            if somebody.page.evaluate("minihuman.state.kind") == "trial":
                picture = picture or somebody.page.screenshot()
                somebody.press(key)
                somebody.page.wait_for_timeout(150)
            else:
                somebody.press("enter")
                somebody.page.wait_for_timeout(50)
        assert somebody.errors == []
    brightness = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).max(axis=-1)
    assert brightness.min() > 0, "a black frame around the pictures would come and go with each trial"
    [path] = tmp_path.rglob("*.mcap")
    log = read_log(path)
    assert len(log.episodes) == 20
    events = [event for segment in log.segments for event in segment.part_events]
    shown = [event for event in events if isinstance(event, StimuliShown)]
    assert any(isinstance(event, ResponseTaken) for event in events)
    assert sum(isinstance(event, SoundPlayed) for event in events) == (20 if name == "auditory-oddball" else 0)
    assert all(event.flip_ns >= event.due_ns - 20_000_000 for event in shown), "no picture comes before its time"
    assert {event.frame for event in shown if event.episode == 0} == set(
        range(1 + max(event.frame for event in shown if event.episode == 0))
    )
    assert list(find_log_differences(log.path, World)) == []
