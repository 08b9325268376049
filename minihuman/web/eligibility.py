"""Eligibility and completion: may this browser, window, connection and keyboard take part, a browser's facts for the
log, and what a participant gets at the end: the completion code, the address to return to, and the page's texts.

Facts in, a reason out. The facts are family and version, display and clocks, never a user agent. A code is given only
when the log is on the disk. The texts (waiting, refusals, the end) are in ``page_texts.toml``. No I/O.
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
_TRUTHS = ("isolated", "touch", "mouse")


def collect_browser_facts(facts_given: Mapping[str, bool | float | str]) -> dict[str, str]:
    """Collect the facts among what a page says; what has not a fact's form is left out."""
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
    """Find how many minutes a browser's local time is ahead of UTC; None where it does not say so."""
    offset_min = facts_given.get("utc_offset_min")  # a whole number, which arrives as a float
    if (
        not isinstance(offset_min, int | float)
        or isinstance(offset_min, bool)
        or not abs(offset_min) <= _MAX_UTC_OFFSET_MIN
    ):
        return None
    if offset_min != int(offset_min):
        return None
    return int(offset_min)


Ineligibility = Literal["", "browser", "window", "latency", "keyboard", "gamepad"]


class BrowserProperties(msgspec.Struct, frozen=True):
    """The properties of a browser that eligibility depends on; only the log's facts are kept."""

    browser: str = "other"  # the family
    window_px: tuple[int, int] = (0, 0)
    rtt_ms: float | None = None  # the least of a few pings; None: not measured
    keyboard: bool = True  # not only a touch screen, as far as the browser can tell
    gamepad: bool = False  # one whose button was pressed: before, a browser shows none


def read_browser_properties(facts: Mapping[str, bool | float | str]) -> BrowserProperties:
    """Read what eligibility depends on from a page's facts."""
    family = str(facts.get("browser", "other")).lower()
    window_px = (0, 0)
    if size := _WINDOW_SIZE.fullmatch(str(facts.get("window_px", ""))):
        window_px = (int(size[1]), int(size[2]))
    known = next((name for name in ("chrome", "edge", "firefox", "safari") if name in family), "other")
    if "chromium" in family:
        known = "chrome"
    rtt = facts.get("rtt_ms")
    rtt_ms = None
    if isinstance(rtt, int | float):
        rtt_ms = float(rtt)
    return BrowserProperties(
        browser=known,
        window_px=window_px,
        rtt_ms=rtt_ms,
        keyboard=facts.get("mouse") is not False or facts.get("touch") is not True,
        gamepad=facts.get("gamepad") is True,
    )


def check_eligibility(
    online: WebSpec, browser: BrowserProperties, *, needs_keyboard: bool = False, needs_gamepad: bool = False
) -> Ineligibility:
    """Check a browser; return why it is not eligible, "" if it is.

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
    if needs_gamepad and not browser.gamepad:
        return "gamepad"
    return ""


MAX_TOUCH_KEYS = 12  # buttons of 48 px that leave half of a phone's screen to the world


def needs_keyboard(protocol: Protocol) -> bool:
    """Whether a study cannot be done with buttons on a touch screen that stand for the keys of its pool."""
    # agents and partners need keys beside those of the pool
    has_other_keys = any(not find_kind(block.kind).is_played_alone for block in protocol.blocks)
    has_many_keys = bool(protocol.blocks) and len(protocol.keys.pool) > MAX_TOUCH_KEYS
    return has_other_keys or has_many_keys or bool(protocol.activities)


def requires_gamepad(protocol: Protocol) -> bool:
    """Whether a study's keys are drawn over a gamepad's buttons, or its axes move anything."""
    axes = [name for block in protocol.blocks for name in block.axes]
    return bool(list_pad_inputs([*protocol.keys.pool, *axes]))


def list_touch_keys(plan: SessionPlan) -> dict[str, str]:
    """List the keys that have buttons on a touch screen, each with its words; none where there are too many."""
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
    """The page's last message: how the session ended, and the code."""

    end: WebEnding
    code: str = ""
    url: str = ""  # where to go with it


def classify_ending(reason: EndReason, *, agreed: bool, part_kind: str = "") -> WebEnding:
    """Classify a session's end for its participant.

    Args:
        reason: the session's.
        agreed: whether there was a consent, or none was asked for; an end before that is a refusal.
        part_kind: the kind of the part in which it ended.
    """
    if not agreed and reason in ("quit", "window_closed", "declined"):
        return "declined"
    if reason == "screened_out" and part_kind and find_kind(part_kind).is_check:
        return "failed_check"
    return _ENDS.get(reason, "broken")


def get_session_code(protocol: Protocol, session: int) -> str:
    """Return a session's own completion code; "" where it has none."""
    if session <= len(protocol.sessions):
        return protocol.sessions[session - 1].completion_code
    return ""


def build_completion(online: WebSpec, end: WebEnding, *, session_code: str = "", person: str = "") -> Completion:
    """Build the code and the address for an end.

    Args:
        online: the study's codes, and where the page leads.
        end: of the session.
        session_code: of this session if it is complete; "": the study's.
        person: the participant's id on the platform.
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
    """Load the page's texts, by language and key."""
    return tomllib.loads(files(__package__).joinpath("page_texts.toml").read_text(encoding="utf-8"))


def get_page_texts(language: str) -> dict[str, str]:
    """Return what the page says in a language; English where we have no translation."""
    return load_page_texts().get(language, load_page_texts()[ENGLISH])
