"""Keys that are held in a browser far away: each step takes what the log says was down, and no tap is lost."""

import random
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.machine import needs
from tests.study.test_held_keys import KEYS, expected_actions, levers_plan
from tests.web.browser import browsing
from tests.web.serving import line, serving

pytestmark = [pytest.mark.program, needs("chromium")]
_CODES = dict(zip(KEYS, ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"), strict=True))
SECONDS = count(6, 60)


@pytest.mark.nightly
@pytest.mark.parametrize("period_ms", [1000 / 15, 1000 / 60])
def test_keys_held_over_300_ms_give_the_steps_that_the_log_says(period_ms: float, tmp_path: Path) -> None:
    path = tmp_path / "levers.toml"
    path.write_bytes(
        levers_plan("buttons", period_ms=period_ms, max_steps=round(SECONDS * 1000 / period_ms)).protocol_toml
    )
    draw, taps = random.Random(4), 0
    with (
        serving(path, tmp_path) as served,
        line(served.port, rtt_ms=300.0) as wire,
        browsing() as sit_down,
    ):
        person = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        page = person.page
        person.until("s.welcomed && s.kind === 'text'")
        while not person.state["playing"]:
            page.keyboard.press("Enter")
            page.wait_for_timeout(700)
        down: set[str] = set()
        while not person.state["finished"]:
            key = draw.choice(KEYS)
            (page.keyboard.up if key in down else page.keyboard.down)(_CODES[key])
            down ^= {key}
            taps += key in down
            page.wait_for_timeout(draw.choice((0, 5, 30, 90, 200)))
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    [episode] = read_log(log).episodes
    assert len(episode.actions) == round(SECONDS * 1000 / period_ms)
    assert episode.actions_taken == expected_actions(episode, "buttons")
    assert len({*episode.actions_taken}) > 2
    played = set(episode.plan.key_map.keys)
    pressed = [press.t_ns for press in episode.keys if press.down and press.key in played and press.verdict != "repeat"]
    assert 3 < len(pressed) <= taps
    stepped = [t_ns for t_ns, key in zip(episode.t_ns[1:], episode.step_keys, strict=True) if key]
    for t_ns in pressed:
        first = next((tick_ns for tick_ns in episode.t_ns[1:] if tick_ns > t_ns), None)
        assert first is None or first in stepped, "no tap is lost"
