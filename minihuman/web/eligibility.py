"""Eligibility and completion: whether a browser may take part, and what its participant gets at the end.

Eligibility depends on the browser, its window, its connection and its keyboard. The facts kept in the log are the
browser's family and version, its display and its clocks, never the user agent. At the end a participant gets the
completion code and the address to return to; a code is given only when the log is on the disk. The page's texts (for
waiting, refusals and the end) are in ``page_texts.toml``. No I/O.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Literal
from urllib.parse import quote

import msgspec

from minihuman.errors import escape_control_characters
from minihuman.experiment.keys import list_pad_inputs
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.events import EndReason
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import WebSpec
from minihuman.experiment.words import ENGLISH, InterfaceWords

_TEXTS = {
    "browser": re.compile(r"[A-Za-z ]{1,24}"),
    "browser_version": re.compile(r"\d{1,5}"),
    "platform": re.compile(r"[A-Za-z ]{1,24}"),
    "window_px": re.compile(r"\d{1,5} x \d{1,5}"),
    "display_px": re.compile(r"\d{1,5} x \d{1,5}"),
    "language": re.compile(r"[A-Za-z-]{2,12}"),
}
_NUMBERS = ("timer_step_ms", "refresh_hz", "pixel_ratio")
_WINDOW_SIZE = re.compile(r"(\d{1,5}) x (\d{1,5})")
_MAX_UTC_OFFSET_MIN = 18 * 60
_YES_OR_NO = {True: "yes", False: "no"}
_TRUTHS = ("isolated", "framed", "touch", "mouse")


def collect_browser_facts(facts_given: Mapping[str, bool | float | str]) -> dict[str, str]:
    """Collect the facts for the log from a page's report; malformed and unknown values are dropped."""
    facts = {"window": "web", "key_times": "the browser's (event.timeStamp)", "key_identity": "position (event.code)"}
    for name, shape in _TEXTS.items():
        value = facts_given.get(name)
        if isinstance(value, str) and shape.fullmatch(value):
            facts[name] = escape_control_characters(value)
    for name in _NUMBERS:
        value = facts_given.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            facts[name] = f"{value:.6g}"
    if (offset_min := find_utc_offset_min(facts_given)) is not None:
        facts["utc_offset_min"] = str(offset_min)
    for name in _TRUTHS:
        value = facts_given.get(name)
        if isinstance(value, bool):
            facts[name] = _YES_OR_NO[value]
    return facts


def find_utc_offset_min(facts_given: Mapping[str, bool | float | str]) -> int | None:
    """Return how many minutes a browser's local time is ahead of UTC; None if its page reports no valid offset."""
    offset_min = facts_given.get("utc_offset_min")  # a whole number, which arrives as a float
    if isinstance(offset_min, bool) or not isinstance(offset_min, int | float):
        return None
    is_in_range = abs(offset_min) <= _MAX_UTC_OFFSET_MIN  # false of NaN
    if not is_in_range or offset_min != int(offset_min):
        return None
    return int(offset_min)


Ineligibility = Literal["", "browser", "window", "latency", "keyboard", "gamepad"]


class BrowserProperties(msgspec.Struct, frozen=True):
    """The properties of a browser on which eligibility depends. They are not logged; only the browser facts are."""

    browser: str = "other"  # the family
    window_px: tuple[int, int] = (0, 0)
    rtt_ms: float | None = None  # the shortest round trip of a few pings; None if it was not measured
    keyboard: bool = True  # False if the browser reports a touch screen and no mouse
    gamepad: bool = False  # browsers report a gamepad only once one of its buttons was pressed


def read_browser_properties(facts: Mapping[str, bool | float | str]) -> BrowserProperties:
    """Read the properties on which eligibility depends from a page's facts; those not reported get their defaults."""
    window_px = (0, 0)
    size_match = _WINDOW_SIZE.fullmatch(str(facts.get("window_px", "")))
    if size_match:
        window_px = (int(size_match.group(1)), int(size_match.group(2)))
    rtt = facts.get("rtt_ms")
    rtt_ms = None
    if isinstance(rtt, int | float):
        rtt_ms = float(rtt)
    has_only_touch = facts.get("mouse") is False and facts.get("touch") is True
    return BrowserProperties(
        browser=_classify_browser(str(facts.get("browser", "other")).lower()),
        window_px=window_px,
        rtt_ms=rtt_ms,
        keyboard=not has_only_touch,
        gamepad=facts.get("gamepad") is True,
    )


def _classify_browser(family: str) -> str:
    """Return the name that protocols use for a browser, given its family in lower case; "other" if they have none."""
    if "chromium" in family:
        return "chrome"
    return next((name for name in ("chrome", "edge", "firefox", "safari") if name in family), "other")


def check_eligibility(
    online: WebSpec, browser: BrowserProperties, *, needs_keyboard: bool = False, needs_gamepad: bool = False
) -> Ineligibility:
    """Return why a browser is not eligible; "" if it is.

    Args:
        online: the study's requirements.
        browser: the browser's properties.
        needs_keyboard: whether the study cannot be done without a keyboard, even if its settings require none.
        needs_gamepad: whether the study cannot be done without a gamepad.
    """
    if (online.require_keyboard or needs_keyboard) and not browser.keyboard:
        return "keyboard"
    if online.allowed_browsers and browser.browser not in online.allowed_browsers:
        return "browser"
    width_px, height_px = browser.window_px
    min_width_px, min_height_px = online.min_window_size_px
    if width_px < min_width_px or height_px < min_height_px:
        return "window"
    if online.max_rtt_ms and browser.rtt_ms is not None and browser.rtt_ms > online.max_rtt_ms:
        return "latency"
    if needs_gamepad and not browser.gamepad:
        return "gamepad"
    return ""


MAX_TOUCH_KEYS = 12  # buttons of 48 px that leave half of a phone's screen to the world


def needs_keyboard(protocol: Protocol) -> bool:
    """Return whether a study needs keys that buttons on a touch screen cannot provide."""
    # agents and partners need keys beside those of the pool
    has_other_keys = any(not find_kind(block.kind).is_played_alone for block in protocol.blocks)
    has_many_keys = bool(protocol.blocks) and len(protocol.keys.pool) > MAX_TOUCH_KEYS
    return has_other_keys or has_many_keys or bool(protocol.activities)


def requires_gamepad(protocol: Protocol) -> bool:
    """Return whether a study uses a gamepad's buttons as keys or its axes as actions."""
    axes = [name for block in protocol.blocks for name in block.axes]
    return bool(list_pad_inputs([*protocol.keys.pool, *axes]))


def list_touch_keys(plan: SessionPlan) -> dict[str, str]:
    """Return the labels of the buttons on a touch screen by the keys that they press; empty if there are too many."""
    if len(plan.key_pool) > MAX_TOUCH_KEYS:
        return {}
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    labels = {key: cap for key, cap, _ in words.labels((*plan.key_pool, "escape"))}
    return {**labels, "enter": words["button.go_on"]}


WebEnding = Literal["complete", "declined", "screened_out", "failed_check", "timed_out", "quit", "broken"]

_ENDS: dict[str, WebEnding] = {
    "complete": "complete",
    "declined": "declined",
    "screened_out": "screened_out",
    "timed_out": "timed_out",
    "connection_lost": "timed_out",
    "quit": "quit",
    "window_closed": "quit",
    "aborted": "quit",
}


@dataclass(frozen=True, slots=True)
class Completion:
    """How a session ended, with the completion code and address that the page's last message gives."""

    end: WebEnding
    code: str = ""
    url: str = ""  # the address to which the participant returns


def classify_ending(reason: EndReason, *, agreed: bool, part_kind: str = "") -> WebEnding:
    """Return the kind of ending to show on the participant's last page.

    Args:
        reason: the reason for which the session ended.
        agreed: whether the participant consented or the study asks for no consent; otherwise, leaving is declining.
        part_kind: the kind of the part in which the session ended; "" if it is not known.
    """
    if not agreed and reason in ("quit", "window_closed", "declined"):
        return "declined"
    if reason == "screened_out" and part_kind and find_kind(part_kind).is_check:
        return "failed_check"
    return _ENDS.get(reason, "broken")


def get_session_code(protocol: Protocol, session: int) -> str:
    """Return the completion code of the session with a number, from 1; "" if it has no code of its own."""
    if session <= len(protocol.sessions):
        return protocol.sessions[session - 1].completion_code
    return ""


def build_completion(online: WebSpec, end: WebEnding, *, session_code: str = "", person: str = "") -> Completion:
    """Return the completion code and the return address for an ending; each is "" if the study has none for it.

    Args:
        online: the study's codes and return address.
        end: the kind of ending.
        session_code: the session's own code for a complete session; "" to use the study's code.
        person: the participant's id on the recruiting platform; "" if no platform sent them.
    """
    code: str = getattr(online.completion_codes, end, "")
    if end == "complete" and session_code:
        code = session_code
    url = ""
    if online.redirect and (code or "{code}" not in online.redirect):
        url = online.redirect.replace("{code}", quote(code, safe="")).replace("{id}", quote(person, safe=""))
    return Completion(end, code, url)


@cache
def load_page_texts() -> dict[str, dict[str, str]]:
    """Return the page's texts from their file, by language and then by key."""
    return tomllib.loads(files(__package__).joinpath("page_texts.toml").read_text(encoding="utf-8"))


def get_page_texts(language: str) -> dict[str, str]:
    """Return the page's texts in a language; English if there is no translation."""
    return load_page_texts().get(language, load_page_texts()[ENGLISH])
