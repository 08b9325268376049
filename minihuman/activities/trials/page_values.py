"""The screen of a trial as values for the page, which shows its pictures by itself."""

from typing import Any

from minihuman.activities.trials.screens import TrialScreen
from minihuman.web.screen_values import NumberPicture


def build_page_values(screen: TrialScreen, number: NumberPicture) -> dict[str, Any]:
    """Return a trial's pictures, all of which are sent before its first one is shown, and their times."""
    return {
        "prompt": screen.legend,
        "pictures": [number(picture) for picture in screen.film],
        "step": screen.step,
        "dues": screen.dues_ns,
        "start": screen.start_ns,
        "first": screen.first_flip_ns,
        "keys": screen.response_keys,
        "target": screen.target_step,
        "foresees": screen.foresees_responses,
    }
