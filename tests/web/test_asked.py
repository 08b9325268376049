"""Questions in a real browser: what is dragged, composed and pasted there is the answer in the log."""

from pathlib import Path
from typing import Any

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Answered
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.protocols import asking
from tests.web.serving import line, serving

pytestmark = [pytest.mark.program, needs("chromium")]
RTT_MS = 60
SAID_MS = 4 * RTT_MS  # until an answer is there and back
HELD_MS = 900  # longer than until a held key repeats
BESIDE_ENTER = {"type": "rawKeyDown", "key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 229}


def test_what_is_dragged_composed_and_pasted_is_the_answer(tmp_path: Path) -> None:
    with (
        serving(asking(tmp_path, "slider", "text", "long_text"), tmp_path) as served,
        line(served.port, rtt_ms=RTT_MS) as wire,
        browsing() as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        asked(somebody, "slider?")
        drag(somebody)
        somebody.press("enter")
        asked(somebody, "text?")
        compose(somebody)
        hold_beside_command(somebody)
        somebody.press("enter")
        asked(somebody, "long_text?")
        somebody.page.context.new_cdp_session(somebody.page).send("Input.insertText", {"text": "line " * 500})
        somebody.press("tab")
        somebody.page.get_by_text("Please shorten your answer: at most 2000 characters").wait_for()
        somebody.page.fill("textarea", "line " * 400)
        somebody.press("tab")
        somebody.to_end()
        assert somebody.errors == []
    (path,) = tmp_path.rglob("*.mcap")
    (segment,) = read_log(path).segments
    given = [event.words for event in segment.part_events if isinstance(event, Answered)]
    assert given == ["60", "火山", "line " * 400]
    assert list(find_log_differences(path, World)) == []


def asked(somebody: Any, words: str) -> None:
    """Until this is asked."""
    somebody.until(f"document.querySelector('#ask')?.textContent === '{words}'")


def drag(somebody: Any) -> None:
    """Each place draws the screen anew, the slider too."""
    box, mouse = somebody.page.locator(".slider").bounding_box(), somebody.page.mouse
    for share in (0.2, 0.4, 0.6):
        mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        mouse.down()
        somebody.page.wait_for_timeout(SAID_MS)
    mouse.up()


def compose(somebody: Any) -> None:
    """A word of two letters with an input method: the answer's first is back while the second is in the making."""
    method = somebody.page.context.new_cdp_session(somebody.page)
    begun = {"selectionStart": 1, "selectionEnd": 1}
    method.send("Input.imeSetComposition", {"text": "か", **begun})
    method.send("Input.insertText", {"text": "火"})
    method.send("Input.imeSetComposition", {"text": "さ", **begun})
    somebody.page.wait_for_timeout(SAID_MS)
    assert somebody.page.input_value("[data-target=field]") == "火さ"
    method.send("Input.insertText", {"text": "山"})
    method.send("Input.dispatchKeyEvent", BESIDE_ENTER)  # Safari's, behind the end of it
    somebody.page.wait_for_timeout(SAID_MS)
    assert somebody.page.input_value("[data-target=field]") == "火山"


def hold_beside_command(somebody: Any) -> None:
    """A key beside Command is the system's, and a Mac says nothing of a key that comes up beside it."""
    keyboard = somebody.page.keyboard
    keyboard.type("ab")
    keyboard.down("Meta")
    keyboard.press("Backspace")
    keyboard.up("Meta")
    keyboard.down("Backspace")
    keyboard.down("Meta")
    keyboard.up("Meta")
    somebody.page.wait_for_timeout(HELD_MS)
    somebody.until("document.querySelector('[data-target=field]').value === '火山a'")
    keyboard.up("Backspace")
    keyboard.press("Backspace")
