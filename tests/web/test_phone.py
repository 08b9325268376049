"""A phone held upright: buttons on the screen stand for keys, and no tap is missed or counted twice."""

import re
from pathlib import Path
from typing import Any

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Answered, KeyPressed
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.web.eligibility import needs_keyboard
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.web.test_accessible import serious

pytestmark = pytest.mark.program
PHONE_PX = (390, 844)
TAPS = count(20, 500)
_TOML = """
[study]
name = "phone"
version = "1"
seed = 4
consent = "You will play some rounds of a game on your phone. Taking part is voluntary."
[keys]
pool = ["1", "2", "3", "4", "5", "6"]
[[groups]]
name = "all"
parts = ["play", "rooms", "ask"]
[[blocks]]
name = "play"
world = "minihuman/MiniGrid-FourRooms-v0"
options = {{ max_steps = 5000 }}
episodes = 1
actions = ["left", "right", "forward"]
max_steps = {steps}
key_map = "shown"
instructions = "Find the goal."
feedback = "Well done."
[[blocks]]
name = "rooms"
world = "minihuman/MiniWorld-FourRooms-v0"
episodes = 1
actions = ["turn_left", "turn_right", "move_forward"]
max_steps = 3
key_map = "carry_over"
show_keys = true
[[questions]]
name = "ask"
items = [
  {{ name = "hard", kind = "likert", ask = "How hard was it?", points = 5 }},
  {{ name = "which", kind = "choice", ask = "Which hand did you use?", options = ["Left", "Right"] }},
]
[web]
require_keyboard = false
"""


def tap(page: Any, selector: str) -> None:
    box = page.locator(selector).evaluate("element => element.getBoundingClientRect().toJSON()")
    page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def test_a_phone_plays_a_grid_and_answers_questions_with_taps_alone(tmp_path: Path) -> None:
    path = tmp_path / "phone.toml"
    path.write_text(_TOML.format(steps=TAPS))
    found: dict[str, list[str]] = {}
    with serving(path, tmp_path) as served, browsing(size=PHONE_PX) as sit_down:
        phone = sit_down(
            f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}",
            has_touch=True,
            is_mobile=True,
            device_scale_factor=2,
        )
        page = phone.page

        def look(name: str) -> None:
            found[name] = serious(page)
            page.screenshot(path=str(tmp_path / f"{name}.png"))
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
            assert page.evaluate("document.documentElement.scrollHeight <= innerHeight + 1"), name
            for box in page.locator("button:visible, .option:visible").evaluate_all(
                "all => all.map((b) => b.getBoundingClientRect().toJSON())"
            ):
                assert min(box["width"], box["height"]) >= 48, (name, box)
            seen = page.inner_text("body")
            assert not re.search(r"\b(keys?|Enter|Escape|mouse)\b", seen, re.IGNORECASE), (name, seen)

        phone.until("s.welcomed && s.kind === 'page'")
        look("consent")
        tap(page, "[data-target=go_on]")
        phone.until("s.kind === 'text'")
        look("keyboard-check")
        for key in "123456":
            tap(page, f"#touch [data-key='{key}']")
        phone.until("s.kind === 'page'")
        tap(page, "[data-target=go_on]")
        page.locator("#touch [data-key=enter]").wait_for()
        look("ready")
        tap(page, "#touch [data-key=escape]")
        page.get_by_text("Hold for 2 seconds: end the session").wait_for()
        look("quit")
        tap(page, "#touch [data-key=enter]")
        page.get_by_text("Ready?").wait_for()
        tap(page, "#touch [data-key=enter]")
        phone.until("s.known && s.step === 0")
        look("play")
        canvas = page.locator("canvas").bounding_box()
        assert canvas["x"] >= 0
        assert canvas["x"] + canvas["width"] <= PHONE_PX[0]
        names = page.locator("#touch button").all_inner_texts()
        assert {"Left", "Right", "Forward"} <= {name.strip().capitalize() for name in names}
        turning = page.locator("#touch button", has_text="left").first.get_attribute("data-key")
        for number in range(TAPS):
            tap(page, f"#touch [data-key='{turning}']")
            if number < TAPS - 1:
                phone.until(f"s.step === {number + 1}")
        page.locator("#touch [data-key=enter]").wait_for()
        look("feedback")
        tap(page, "#touch [data-key=enter]")
        page.get_by_text("Ready?").wait_for()
        while not phone.state["playing"]:
            tap(page, "#touch [data-key=enter]")
            page.wait_for_timeout(100)
        for number in range(3):
            phone.until(f"s.known && s.step === {number}")
            if not number:
                look("rooms")
            tap(page, f"#touch [data-key='{turning}']")
        page.get_by_text("How hard was it?").wait_for()
        look("likert")
        tap(page, "[data-target='option:2']")
        tap(page, "[data-target=go_on]")
        page.get_by_text("Which hand did you use?").wait_for()
        look("choice")
        tap(page, "[data-target='option:1']")
        tap(page, "[data-target=go_on]")
        phone.until("s.kind === 'page'")
        tap(page, "[data-target=go_on]")
        phone.until("s.finished")
        assert phone.errors == []
    assert {name: each for name, each in found.items() if each} == {}
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    session = read_log(log)
    episode, rooms = session.episodes
    assert list(rooms.step_keys) == [turning] * 3
    assert list(episode.step_keys) == [turning] * TAPS, "none missed, none doubled"
    taps = [press for press in session.keys if isinstance(press, KeyPressed) and press.down]
    assert {press.symbol for press in taps} == {"touch"}
    assert [event.value for event in session.part_events if isinstance(event, Answered)] == ["3", "2"]


def test_what_buttons_cannot_do_needs_a_keyboard():
    text = _TOML.format(steps=5)
    assert not needs_keyboard(decode_protocol(text.encode()))
    with_agent = text.replace('name = "play"\nworld', 'name = "play"\nkind = "takeover"\nworld')
    assert needs_keyboard(decode_protocol(with_agent.encode()))
    many = text.replace('"1", "2"', ", ".join(f'"{key}"' for key in "qwertyuiop12"))
    assert needs_keyboard(decode_protocol(many.encode()))
