"""A phone held upright: buttons on the screen stand for keys, and no tap is missed or counted twice."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
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
from tests.web.firefox import firefox_at
from tests.web.serving import serving
from tests.web.test_accessible import AXE_RUN, axe_script, list_serious

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


class ChromiumPhone:
    """A page in Chromium's own emulation of a phone.

    Args:
        person: who holds it.
    """

    def __init__(self, person: Any) -> None:
        self.person, self._page = person, person.page
        self.until = person.until

    def tap(self, selector: str) -> None:
        box = self._page.locator(selector).first.evaluate("element => element.getBoundingClientRect().toJSON()")
        self._page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)

    def screenshot(self, path: Path) -> None:
        self._page.screenshot(path=str(path))

    def find(self, expression: str) -> Any:
        return self._page.evaluate(expression)

    def run(self, script: str) -> None:
        self._page.evaluate(script)


@contextmanager
def hold_phone(browser: str, url: str, folder: Path) -> Iterator[Any]:
    """A phone at a page, in Chromium or in Firefox: what both can do, and no error on the page at the end."""
    if browser == "firefox":
        with firefox_at(url, folder / "profile", phone_px=PHONE_PX) as page:
            page.until("s.welcomed && s.kind !== ''")
            page.press("enter")  # without a window, Firefox has no focus, which the session waits for, before a key
            yield page
        return
    with browsing(size=PHONE_PX) as sit_down:
        person = sit_down(url, has_touch=True, is_mobile=True, device_scale_factor=2)
        yield ChromiumPhone(person)
        assert person.errors == []


class Fingers:
    """Who taps through the study and looks at each screen.

    Args:
        phone: a page that can be tapped.
        pictures: where pictures of the screens go.
    """

    def __init__(self, phone: Any, pictures: Path) -> None:
        self.phone, self._pictures = phone, pictures
        self.findings: dict[str, list[str]] = {}
        self.tap = phone.tap

    def wait_for(self, selector: str) -> None:
        self.wait_until(f"document.querySelector({selector!r})?.getClientRects().length")

    def wait_for_text(self, text: str) -> None:
        self.wait_until(f"document.body.innerText.includes({text!r})")

    def wait_until(self, condition: str) -> None:
        """Until it holds and what stands in the page is on the display: a tap before that answers nothing, by rule."""
        self.phone.until(condition)
        self.phone.run(
            "window.wasSeen = false;"
            "requestAnimationFrame(() => requestAnimationFrame(() => { window.wasSeen = true; }));"
        )
        self.phone.until("window.wasSeen")

    def look(self, name: str) -> None:
        """Nothing serious by axe-core, nothing cut off or too small for a thumb, no word of keys."""
        self.phone.run(axe_script())
        self.findings[name] = list_serious(self.phone.find(AXE_RUN))
        self.phone.screenshot(self._pictures / f"{name}.png")
        assert self.phone.find("innerWidth") == PHONE_PX[0]
        assert self.phone.find("document.documentElement.scrollWidth <= innerWidth"), name
        assert self.phone.find("document.documentElement.scrollHeight <= innerHeight + 1"), name
        for box in self.phone.find(
            "[...document.querySelectorAll('button, .option')].map((one) => one.getBoundingClientRect().toJSON())"
            ".filter((box) => box.width)"
        ):
            assert min(box["width"], box["height"]) >= 48, (name, box)
        seen = self.phone.find("document.body.innerText")
        assert not re.search(r"\b(keys?|Enter|Escape|mouse)\b", seen, re.IGNORECASE), (name, seen)

    def play(self) -> str:
        """The whole study; the key that was tapped."""
        phone, tap = self.phone, self.tap
        self.wait_until("s.welcomed && s.kind === 'page'")
        self.look("consent")
        tap("[data-target=go_on]")
        self.wait_until("s.kind === 'text'")
        self.look("keyboard-check")
        for key in "123456":
            tap(f"#touch [data-key='{key}']")
        self.wait_until("s.kind === 'page'")
        tap("[data-target=go_on]")
        self.wait_for("#touch [data-key=enter]")
        self.look("ready")
        tap("#touch [data-key=escape]")
        self.wait_for_text("Hold for 2 seconds: end the session")
        self.look("quit")
        tap("#touch [data-key=enter]")
        self.wait_for_text("Ready?")
        tap("#touch [data-key=enter]")
        phone.until("s.known && s.step === 0")
        self.look("play")
        canvas = phone.find("document.querySelector('canvas').getBoundingClientRect().toJSON()")
        assert canvas["x"] >= 0
        assert canvas["x"] + canvas["width"] <= PHONE_PX[0]
        names = phone.find("[...document.querySelectorAll('#touch button')].map((one) => one.innerText)")
        assert {"Left", "Right", "Forward"} <= {name.strip().capitalize() for name in names}
        turning = phone.find(
            "[...document.querySelectorAll('#touch button')].find((one) => one.innerText.includes('left')).dataset.key"
        )
        for number in range(TAPS):
            tap(f"#touch [data-key='{turning}']")
            if number < TAPS - 1:
                phone.until(f"s.step === {number + 1}")
        self.wait_for("#touch [data-key=enter]")
        self.look("feedback")
        tap("#touch [data-key=enter]")
        self.wait_for_text("Ready?")
        tap("#touch [data-key=enter]")
        for number in range(3):
            phone.until(f"s.known && s.step === {number}")
            if not number:
                self.look("rooms")
            tap(f"#touch [data-key='{turning}']")
        self.wait_for_text("How hard was it?")
        self.look("likert")
        tap("[data-target='option:2']")
        tap("[data-target=go_on]")
        self.wait_for_text("Which hand did you use?")
        self.look("choice")
        tap("[data-target='option:1']")
        tap("[data-target=go_on]")
        self.wait_until("s.kind === 'page'")
        tap("[data-target=go_on]")
        phone.until("s.finished")
        return str(turning)


@pytest.mark.nightly(by_day=["chromium"])
@pytest.mark.parametrize("browser", ["chromium", "firefox"])
def test_a_phone_plays_a_grid_and_answers_questions_with_taps_alone(browser: str, tmp_path: Path) -> None:
    path = tmp_path / "phone.toml"
    path.write_text(_TOML.format(steps=TAPS))
    with serving(path, tmp_path) as served:
        url = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        with hold_phone(browser, url, tmp_path) as phone:
            fingers = Fingers(phone, tmp_path)
            turning = fingers.play()
            assert phone.find("document.querySelector('#touch').hidden"), "nothing is left to tap at the end"
    assert {name: each for name, each in fingers.findings.items() if each} == {}
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    session = read_log(log)
    episode, rooms = session.episodes
    assert list(rooms.step_keys) == [turning] * 3
    assert list(episode.step_keys) == [turning] * TAPS, "none missed, none doubled"
    taps = [press for press in session.keys if isinstance(press, KeyPressed) and press.down]
    assert {press.symbol for press in taps[browser == "firefox" :]} == {"touch"}
    assert session.facts["browser"].lower().startswith(browser[:4])
    assert [event.value for event in session.part_events if isinstance(event, Answered)] == ["3", "2"]


def test_what_buttons_cannot_do_needs_a_keyboard():
    text = _TOML.format(steps=5)
    assert not needs_keyboard(decode_protocol(text.encode()))
    with_agent = text.replace('name = "play"\nworld', 'name = "play"\nkind = "takeover"\nworld')
    assert needs_keyboard(decode_protocol(with_agent.encode()))
    many = text.replace('"1", "2"', ", ".join(f'"{key}"' for key in "qwertyuiop12"))
    assert needs_keyboard(decode_protocol(many.encode()))
