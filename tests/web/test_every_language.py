"""Every kind of screen in eight languages, in a browser and on a phone: what has a direction stands at the same places.

MINIHUMAN_TEST_PICTURES=FOLDER keeps a sheet of each front: a row per kind of screen, a column per language.
"""

import io
import os
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from minihuman.experiment.words import InterfaceWords
from tests.counts import count
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.every_screen import every_screen, go_through
from tests.web.serving import serving
from tests.web.test_directions import LANGUAGES, PHONE_PX

pytestmark = [pytest.mark.program, needs("chromium"), pytest.mark.nightly]
SOME = count(("en", "he"), LANGUAGES)
FRONTS = {"browser": (1366, 768), "phone": PHONE_PX}
PICTURES = os.environ.get("MINIHUMAN_TEST_PICTURES", "")
DIRECTED = {"browser": {"films", "legend", "keyboard"}, "phone": {"arrows", "legend", "keyboard"}}
# What passes by itself, on a slow machine between two looks: a cross, and a text while something is made ready.
PASSING = {"text||", "text timed||", "blank timed|cross|"}
MIXED = {"text||", "blank timed|cross|"}  # of several screens, of which the first look may be at another
THUMBNAIL_PX = {"browser": (342, 192), "phone": (195, 422)}
_PLACES = """() => {
  const lefts = (selector) => [...document.querySelectorAll(selector)].map((part) => part.getBoundingClientRect().x);
  const ranks = (selector) => lefts(selector).map((x, _, all) => all.filter((other) => other < x).length);
  return {
    arrows: lefts('#touch .arrows [data-key]').map(Math.round),
    films: lefts('.films canvas, .films img').map(Math.round),
    legend: ranks('.legend .cap'),
    keyboard: ranks('.keyboard .cap'),
  };
}"""


def name_kind(looks: str) -> str:
    """Return what is the same in every language of how a screen looks."""
    kind, form, steers, *_ = looks.split("|")
    hand = " ".join(steers.split()[:2]) if steers.startswith("steers") else ""
    return "|".join((kind, form, hand))


def look_at_all(language: str, front: str, folder: Path) -> dict[str, tuple[dict[str, Any], bytes]]:
    """Go through the study; return the places and the picture of each kind of screen."""
    folder.mkdir()
    seen: dict[str, tuple[dict[str, Any], bytes]] = {}

    def look(page: Any, looks: str) -> None:
        if name_kind(looks) not in seen:
            seen[name_kind(looks)] = page.evaluate(_PLACES), page.screenshot()

    options = {"has_touch": True, "is_mobile": True} if front == "phone" else {}
    path = every_screen(folder, language, needs_keyboard=front != "phone")
    correcting = InterfaceWords(language)["correction.show"].partition("{")[0].strip()
    with serving(path, folder) as served, browsing(size=FRONTS[front]) as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}", **options)
        go_through(person, look, correcting=correcting)
        assert person.errors == []
    return seen


def write_sheet(pictures: dict[str, dict[str, bytes]], front: str, path: Path) -> None:
    """Write the screens side by side: ``pictures`` by language and kind."""
    width, height = THUMBNAIL_PX[front]
    kinds = list(pictures["en"])
    sheet = Image.new("RGB", (len(pictures) * (width + 6), len(kinds) * (height + 6)), "white")
    for column, of_language in enumerate(pictures.values()):
        for row, kind in enumerate(kinds):
            if kind in of_language:
                picture = Image.open(io.BytesIO(of_language[kind])).convert("RGB").resize((width, height))
                sheet.paste(picture, (column * (width + 6), row * (height + 6)))
    sheet.save(path)


@pytest.mark.parametrize("front", FRONTS)
def test_what_has_a_direction_stands_at_the_same_places_in_every_language(front: str, tmp_path: Path) -> None:
    seen = {language: look_at_all(language, front, tmp_path / language) for language in SOME}
    if PICTURES:
        pictures = {
            language: {kind: picture for kind, (_, picture) in screens.items()} for language, screens in seen.items()
        }
        write_sheet(pictures, front, Path(PICTURES) / f"every-screen-{front}.png")
    english = {kind: places for kind, (places, _) in seen["en"].items()}
    directed = {name for places in english.values() for name, of_part in places.items() if of_part}
    assert directed == DIRECTED[front]
    for language, screens in seen.items():
        in_both = (screens.keys() & english.keys()) - MIXED
        assert screens.keys() ^ english.keys() <= PASSING, language
        assert {kind: screens[kind][0] for kind in in_both} == {kind: english[kind] for kind in in_both}, language
    print(f"{front}: {len(english)} kinds of screens in {len(seen)} languages, the same places")
