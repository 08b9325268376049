"""The screen of a reviewed episode as values for the page."""

from typing import Any

from minihuman.activities.correction.screens import FilmScreen
from minihuman.web.screen_values import NumberPicture, select_values


def build_page_values(screen: FilmScreen, number: NumberPicture) -> dict[str, Any]:
    """Give the words and the keys; the page goes through the episode by itself."""
    return select_values(screen, "prompt progress step back forward film")
