"""A comparison's screen as values for the page."""

from typing import Any

from minihuman.activities.preferences.screens import PairScreen
from minihuman.web.screen_values import NumberPicture, number_film, select_values


def build_page_values(screen: PairScreen, number: NumberPicture) -> dict[str, Any]:
    """Give both films, which the page plays by itself; all but one picture of each follow."""
    return {
        **select_values(screen, "title prompt progress step replay_key"),
        "lefts": number_film(screen.lefts, screen.step, number),
        "rights": number_film(screen.rights, screen.step, number),
        "period": screen.period_ns,
    }
