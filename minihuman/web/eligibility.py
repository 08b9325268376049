"""The eligibility check: may this browser, window, connection and keyboard take part; and a browser's facts for the
log.

Facts in, a reason out. The facts are family and version, display and clocks, never a user agent. No I/O.
"""

import math
import re
from collections.abc import Mapping
from typing import Literal

import msgspec

from minihuman.errors import escape_control_characters
from minihuman.experiment.keys import list_pad_inputs
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import WebSpec
from minihuman.experiment.words import InterfaceWords

_TEXTS = {
    "browser": re.compile(r"[A-Za-z ]{1,24}"),
    "browser_version": re.compile(r"\d{1,5}"),
    "platform": re.compile(r"[A-Za-z ]{1,24}"),
    "window_px": re.compile(r"\d{1,5} x \d{1,5}"),
    "display_px": re.compile(r"\d{1,5} x \d{1,5}"),
    "language": re.compile(r"[A-Za-z-]{2,12}"),
}
_NUMBERS = ("timer_step_ms", "refresh_hz", "pixel_ratio")
_MAX_UTC_OFFSET_MIN = 18 * 60
_TRUTHS = ("isolated", "touch", "mouse")


def collect_browser_facts(facts_given: Mapping[str, bool | float | str]) -> dict[str, str]:
    """The facts among what a page says; whatever does not look like one is left out."""
    facts = {"window": "web", "key_times": "the browser's (event.timeStamp)", "key_identity": "position (event.code)"}
    for name, shape in _TEXTS.items():
        value = facts_given.get(name)
        if isinstance(value, str) and shape.fullmatch(value):
            facts[name] = escape_control_characters(value)
    for name in _NUMBERS:
        value = facts_given.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            facts[name] = f"{value:.6g}"
    offset_min = facts_given.get("utc_offset_min")
    if isinstance(offset_min, int) and not isinstance(offset_min, bool) and abs(offset_min) <= _MAX_UTC_OFFSET_MIN:
        facts["utc_offset_min"] = str(offset_min)
    for name in _TRUTHS:
        value = facts_given.get(name)
        if isinstance(value, bool):
            facts[name] = "yes" if value else "no"
    return facts


Ineligibility = Literal["", "browser", "window", "latency", "keyboard", "gamepad"]


class BrowserProperties(msgspec.Struct, frozen=True):
    """What the page finds out before anything else; no more of it is kept than the log's facts say."""

    browser: str = "other"  # the family
    window_px: tuple[int, int] = (0, 0)
    rtt_ms: float | None = None  # the least of a few pings; None: not measured
    keyboard: bool = True  # not only a touch screen, as far as the browser can tell
    gamepad: bool = False  # one whose button was pressed: before, a browser shows none


def check_eligibility(
    online: WebSpec, browser: BrowserProperties, *, needs_keyboard: bool = False, needs_gamepad: bool = False
) -> Ineligibility:
    """Why a browser is not eligible; "" if it is.

    Args:
        online: what the study requires.
        browser: what it is.
        needs_keyboard: whether the study cannot be done without one, whatever it requires.
        needs_gamepad: likewise.
    """
    if (online.require_keyboard or needs_keyboard) and not browser.keyboard:
        return "keyboard"
    if online.allowed_browsers and browser.browser not in online.allowed_browsers:
        return "browser"
    if any(has < least for has, least in zip(browser.window_px, online.min_window_size_px, strict=True)):
        return "window"
    if online.max_rtt_ms and browser.rtt_ms is not None and browser.rtt_ms > online.max_rtt_ms:
        return "latency"
    return "gamepad" if needs_gamepad and not browser.gamepad else ""


MAX_TOUCH_KEYS = 12  # buttons of 48 px that leave half of a phone's screen to the world
_TOUCHED_KINDS = ("play", "trials")  # of blocks; agents need keys beside those of the pool


def needs_keyboard(protocol: Protocol) -> bool:
    """Whether a study cannot be done with buttons on a touch screen that stand for the keys of its pool."""
    kinds_need = any(block.kind not in _TOUCHED_KINDS for block in protocol.blocks) or bool(protocol.activities)
    return kinds_need or (bool(protocol.blocks) and len(protocol.keys.pool) > MAX_TOUCH_KEYS)


def requires_gamepad(protocol: Protocol) -> bool:
    """Whether a study's keys are drawn over a gamepad's buttons, or its axes move anything."""
    axes = [name for block in protocol.blocks for name in block.axes]
    return bool(list_pad_inputs([*protocol.keys.pool, *axes]))


def list_touch_keys(plan: SessionPlan) -> dict[str, str]:
    """The keys that buttons stand for on a touch screen, each with its words; none where there are too many."""
    if len(plan.key_pool) > MAX_TOUCH_KEYS:
        return {}
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    labels = {key: cap for key, cap, _ in words.labels((*plan.key_pool, "escape"))}
    return {**labels, "enter": words["button.go_on"]}
