"""Screening at the door: may this browser, window, line and keyboard take part. Facts in, a reason out."""

from typing import Literal

import msgspec

from minihuman.study.online import Online

Misfit = Literal["", "browser", "window", "line", "keyboard"]


class Door(msgspec.Struct, frozen=True):
    """What the page finds out before anything else; no more of it is kept than the log's facts say."""

    browser: str = "other"  # the family
    window_px: tuple[int, int] = (0, 0)
    rtt_ms: float | None = None  # the least of a few pings; None: not measured
    keyboard: bool = True  # not only a touch screen, as far as the browser can tell


def misfit(online: Online, door: Door) -> Misfit:
    """Why somebody cannot take part as they are; "" where they can."""
    if online.keyboard and not door.keyboard:
        return "keyboard"
    if online.browsers and door.browser not in online.browsers:
        return "browser"
    if any(has < least for has, least in zip(door.window_px, online.min_window_px, strict=True)):
        return "window"
    if online.max_rtt_ms and door.rtt_ms is not None and door.rtt_ms > online.max_rtt_ms:
        return "line"
    return ""
