"""The light theme: the same colours in a window and in a browser, readable, logged with the session."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.display.drawing import sheet
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.drawing.sheet import BACKGROUND, LIGHT, Colour
from minihuman.experiment.machine.screens import BlankScreen, TextLocale, TextScreen
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.web.test_accessible import AXE_RUN, axe_script, list_serious

CSS = (Path(sheet.__file__).parents[2] / "web/page/page.css").read_text()
_TOML = """
[study]
name = "light"
version = "1"
seed = 4
consent = "You will play one round of a game. Taking part is voluntary."
theme = "light"
[keys]
pool = ["1", "2", "3"]
[[groups]]
name = "all"
parts = ["play", "ask"]
[[blocks]]
name = "play"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 2
key_map = "shown"
show_outcome = true
instructions = "Find the goal."
[[questions]]
name = "ask"
items = [
  { name = "hard", kind = "likert", ask = "How hard was it?", points = 5 },
  { name = "which", kind = "choice", ask = "Which hand did you use?", options = ["Left", "Right"] },
]
"""


def _luminance(colour: Colour) -> float:
    linear = [
        share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in np.array(colour) / 255
    ]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def _contrast(one: Colour, other: Colour) -> float:
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_words_of_the_light_theme_are_readable_on_its_grounds_and_the_other_way_round():
    ground, surface = LIGHT[BACKGROUND], LIGHT[sheet.SURFACE]
    for name in ("INK", "MUTED_INK", "ACCENT", "HIGHLIGHT", "GOOD", "BAD"):
        assert min(_contrast(LIGHT[getattr(sheet, name)], under) for under in (ground, surface)) >= 4.5, name
    assert _contrast(LIGHT[sheet.EDGE], ground) >= 3


@pytest.mark.parametrize(("rule", "light"), [(r":root", False), (r":root\.light", True)])
def test_the_page_has_the_windows_colours(rule: str, light: bool):
    block = re.search(rf"^{rule} \{{(.*?)\}}", CSS, re.MULTILINE | re.DOTALL)
    assert block
    names = {"ground": "BACKGROUND", "surface": "SURFACE", "edge": "EDGE", "ink": "INK", "quiet": "MUTED_INK"}
    names |= {"lit": "HIGHLIGHT", "accent": "ACCENT", "good": "GOOD", "bad": "BAD"}
    for name, of_sheet in names.items():
        colour = getattr(sheet, of_sheet)
        wanted = LIGHT[colour] if light else colour
        assert f"--{name}: #{bytes(wanted).hex()}" in block[1], name


def test_a_light_screen_is_the_dark_one_in_other_colours():
    for screen in (BlankScreen(cross=True), TextScreen("Pause", "Take a break.", "Press Enter", keys=(("1", True),))):
        dark = compose_screen(screen, (640, 480))
        light = compose_screen(dataclasses.replace(screen, locale=TextLocale(theme="light")), (640, 480))
        is_ground = (dark == BACKGROUND).all(axis=2)
        assert is_ground.mean() > 0.5
        assert ((light == LIGHT[BACKGROUND]).all(axis=2) == is_ground).mean() > 0.999


@pytest.mark.nightly
@pytest.mark.program
@needs("chromium")
def test_a_light_study_is_light_in_the_browser_accessible_and_proven(tmp_path: Path):
    path = tmp_path / "light.toml"
    path.write_text(_TOML)
    ground = f"rgb({', '.join(map(str, LIGHT[BACKGROUND]))})"
    with serving(path, tmp_path) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        page = person.page
        person.until("s.kind !== ''")
        findings: dict[str, list[str]] = {}

        def look(name: str) -> None:
            assert page.evaluate("getComputedStyle(document.body).backgroundColor") == ground
            page.evaluate(axe_script())
            findings[name] = list_serious(page.evaluate(AXE_RUN))
            page.screenshot(path=str(tmp_path / f"{name}.png"))

        look("consent")
        person.press("enter")
        person.until("s.kind === 'text'")
        look("keys")
        person.to_play()
        look("play")
        person.press("1")
        person.until("s.step === 1")
        person.press("1")
        person.until("s.kind === 'question'")
        look("question")
        person.press("2", "enter")
        page.wait_for_timeout(400)
        look("choice")
        person.press("1", "enter")
        person.to_end()
        assert person.errors == []
    assert not any(findings.values()), findings
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []
    assert read_log(log).plan.words["theme"] == "light"


def test_a_theme_that_is_none_is_refused():
    with pytest.raises(Exception, match="theme is 'blue'; it is one of dark, light"):
        decode_protocol(_TOML.replace('"light"\n[keys]', '"blue"\n[keys]').encode())
