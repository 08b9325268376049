"""What a browser does to the page is known afterwards: a translated consent text, zoom, a second pointing device."""

from pathlib import Path

import pytest

from minihuman.dataset.selection import list_page_alterations
from minihuman.log.read.session_reader import read_log
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.protocols import study
from tests.web.serving import serving

pytestmark = [needs("chromium"), pytest.mark.program]
_CONSENT = "You take part of your own free will."


def study_with_consent(folder: Path) -> Path:
    path = study(folder, episodes=1, max_steps=6)
    path.write_text(path.read_text().replace('version = "1.0"', f'version = "1.0"\nconsent = "{_CONSENT}"'))
    return path


def play_to_end(somebody: Somebody) -> None:
    somebody.to_play()
    for key in "121212":
        somebody.press(key)
        somebody.page.wait_for_timeout(50)
    somebody.to_end()


_TRANSLATE = """() => {  // as Chrome does
  document.documentElement.classList.add("translated-ltr");
  document.documentElement.lang = "de";
  const text = document.querySelector("p.body").firstChild;
  const font = document.createElement("font");
  font.textContent = "Sie nehmen freiwillig teil.";
  text.replaceWith(font);
}"""
_FINGER = "() => document.body.dispatchEvent(new PointerEvent('pointerdown', { pointerType: 'touch', bubbles: true }))"


def test_a_translated_consent_text_zoom_and_a_second_device_are_in_the_log_and_in_the_tables(tmp_path: Path) -> None:
    with serving(study_with_consent(tmp_path), tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        page = somebody.page
        page.wait_for_selector("[data-target=go_on]")
        page.evaluate(_TRANSLATE)
        page.evaluate(_FINGER)  # of a script, so no device
        line = page.context.new_cdp_session(page)
        page.click("[data-target=go_on]")
        line.send(
            "Emulation.setDeviceMetricsOverride",
            {"width": 911, "height": 512, "deviceScaleFactor": 1.5, "mobile": False},
        )
        page.mouse.click(5, 5)
        line.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": 5, "y": 5}]})
        line.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        play_to_end(somebody)
    [log] = tmp_path.rglob("*.mcap")
    alterations = list_page_alterations(read_log(log).notes)
    assert alterations == [
        "consent text",
        "pointer touch beside mouse",
        "text",
        "translation de",
        "zoom pixel ratio 1.00 to 1.50",
    ]


def test_a_page_that_nothing_changes_says_nothing(tmp_path: Path) -> None:
    with serving(study_with_consent(tmp_path), tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.page.click("[data-target=go_on]")
        somebody.to_play()
        caps = somebody.page.locator(".legend .cap")
        assert caps.count() == caps.and_(somebody.page.locator("[translate=no]")).count()
        play_to_end(somebody)
    [log] = tmp_path.rglob("*.mcap")
    assert list_page_alterations(read_log(log).notes) == []
