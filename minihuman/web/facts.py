"""What a page says of its browser, as facts for the log: family and version, display, clocks. Never a user agent."""

import math
import re
from collections.abc import Mapping

from minihuman.errors import printable

_TEXTS = {
    "browser": re.compile(r"[A-Za-z ]{1,24}"),
    "browser_version": re.compile(r"\d{1,5}"),
    "platform": re.compile(r"[A-Za-z ]{1,24}"),
    "window_px": re.compile(r"\d{1,5} x \d{1,5}"),
    "display_px": re.compile(r"\d{1,5} x \d{1,5}"),
    "language": re.compile(r"[A-Za-z-]{2,12}"),
}
_NUMBERS = ("timer_step_ms", "refresh_hz", "pixel_ratio")
_TRUTHS = ("isolated", "touch", "mouse")


def browser_facts(said: Mapping[str, bool | float | str]) -> dict[str, str]:
    """The facts among what a page says; whatever does not look like one is left out."""
    facts = {"window": "web", "key_times": "the browser's (event.timeStamp)", "key_identity": "position (event.code)"}
    for name, shape in _TEXTS.items():
        value = said.get(name)
        if isinstance(value, str) and shape.fullmatch(value):
            facts[name] = printable(value)
    for name in _NUMBERS:
        value = said.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            facts[name] = f"{value:.6g}"
    for name in _TRUTHS:
        value = said.get(name)
        if isinstance(value, bool):
            facts[name] = "yes" if value else "no"
    return facts
