"""The screen of an episode under review as values for the page."""

from typing import Any

from minihuman.activities.correction.screens import FilmScreen
from minihuman.web.screen_values import NumberPicture, select_values


def build_page_values(screen: FilmScreen, number: NumberPicture) -> dict[str, Any]:
    """Return the texts and keys of a review's screen by name.

    ``number`` is not used, because the page draws the episode itself.
    """
    return select_values(screen, "prompt progress step back forward film")
