"""A comparison's screen as values for the page."""

from typing import Any

from minihuman.activities.preferences.screens import PairScreen
from minihuman.web.screen_values import NumberPicture, select_values


def build_page_values(screen: PairScreen, number: NumberPicture) -> dict[str, Any]:
    """Give the words and the times; the page plays both films by itself."""
    return {**select_values(screen, "title prompt progress step replay_key"), "period": screen.period_ns}
