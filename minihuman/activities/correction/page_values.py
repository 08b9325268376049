"""The screen of a reviewed episode as values for the page."""

from typing import Any

from minihuman.activities.correction.screens import FilmScreen
from minihuman.web.screen_values import NumberPicture, number_film, select_values


def build_page_values(screen: FilmScreen, number: NumberPicture) -> dict[str, Any]:
    """Give the episode, which the page goes through by itself; all but one of its pictures follow."""
    return {
        **select_values(screen, "prompt progress step back forward film"),
        "pictures": number_film(screen.pictures, screen.step, number),
    }
