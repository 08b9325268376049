"""What has a direction stands where it points, in every language and window; only text is mirrored."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from minihuman.display.drawing.screen import compose_screen
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.experiment.words import InterfaceWords
from tests.counts import count
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

LANGUAGES = ("en", "ar", "de", "es", "fr", "he", "ja", "zh")
SOME = LANGUAGES[: count(2, len(LANGUAGES))]
PHONE_PX = (390, 844)
_PLACES = """(selector) => Object.fromEntries([...document.querySelectorAll(selector)].map((one, number) => {
  const { x, y, width, height } = one.getBoundingClientRect();
  return [one.dataset.key ?? number, [x, y, width, height].map(Math.round)];
}))"""
_TOML = """
[study]
name = "turned"
version = "1"
seed = 4
language = "{language}"
[keys]
pool = ["left", "right", "up"]
keyboard_check = false
[web]
require_keyboard = false
[[groups]]
name = "all"
blocks = ["play"]
[[blocks]]
name = "play"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 20
key_map = "shown"
show_keys = true
"""


def play_in(sit_down: Any, language: str, folder: Path, *, phone: bool) -> Any:
    """A person who plays a study in a language."""
    folder.mkdir()
    path = folder / "turned.toml"
    path.write_text(_TOML.format(language=language))
    with serving(path, folder) as served:
        options: dict[str, Any] = {"has_touch": True, "is_mobile": True} if phone else {}
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}", **options)
        person.to_play()
        selector = "#touch [data-key]" if phone else ".legend .cap"
        return person.page.evaluate(_PLACES, selector), person.page.screenshot()


@pytest.mark.nightly
@pytest.mark.program
@needs("chromium")
def test_on_a_phone_the_arrows_make_a_pad_at_the_same_places_in_every_language(tmp_path: Path) -> None:
    places = {}
    with browsing(size=PHONE_PX) as sit_down:
        for language in SOME:
            places[language], _ = play_in(sit_down, language, tmp_path / language, phone=True)
    arrows = {language: {key: found[key] for key in ("left", "up", "right")} for language, found in places.items()}
    left, up, right = (arrows["en"][key] for key in ("left", "up", "right"))
    assert left[0] < up[0] < right[0]
    assert up[1] < left[1] == right[1]
    assert all(found == arrows["en"] for found in arrows.values()), arrows


@pytest.mark.program
@needs("chromium")
def test_the_legend_of_a_browser_has_its_keys_in_the_same_order_in_every_language(tmp_path: Path) -> None:
    orders = {}
    with browsing() as sit_down:
        for language in SOME:
            places, _ = play_in(sit_down, language, tmp_path / language, phone=False)
            orders[language] = sorted(places, key=lambda number: places[number][0])
    assert all(order == orders["en"] == ["0", "1", "2"] for order in orders.values()), orders


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_legend_of_a_window_has_the_same_places_in_every_language(language: str) -> None:
    legend = (("1", "left"), ("2", "right"), ("3", "forward"))
    drawn = [
        compose_screen(
            PlayScreen(np.full((56, 56, 3), 200, np.uint8), "", "", legend, locale=InterfaceWords(locale).locale),
            (640, 360),
        )
        for locale in ("en", language)
    ]
    assert np.array_equal(*drawn)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_key_for_the_left_of_two_films_is_named_left_of_the_other_in_every_language(language: str) -> None:
    words = InterfaceWords(language)
    prompt = words["pair.prompt"]
    is_left_first = prompt.index("{left}") < prompt.index("{right}")
    assert is_left_first == (not words.rtl)
