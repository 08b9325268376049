"""The screen of a comparison as values for the page."""

from typing import Any

from minihuman.activities.preferences.screens import PairScreen
from minihuman.web.screen_values import NumberPicture, select_values


def build_page_values(screen: PairScreen, number: NumberPicture) -> dict[str, Any]:
    """Return the texts and times of a comparison's screen by name; "period" is in nanoseconds.

    ``number`` is not used, because the page draws both films itself.
    """
    return {**select_values(screen, "title prompt progress step replay_key"), "period": screen.period_ns}
