"""The screen of a trial as values for the page, which shows its pictures by itself."""

from typing import Any

from minihuman.activities.trials.screens import TrialScreen
from minihuman.web.screen_values import NumberPicture


def build_page_values(screen: TrialScreen, number: NumberPicture) -> dict[str, Any]:
    """Return the times of a trial's pictures; the pictures come as a film."""
    return {
        "title": "",
        "prompt": screen.legend,
        "step": screen.step,
        "dues": screen.dues_ns,
        "start": screen.start_ns,
        "keys": screen.response_keys,
    }
