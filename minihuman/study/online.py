"""The study on the web: what its protocol says of browsers, pictures, waiting, who may take part, and codes."""

import re
from typing import Literal

import msgspec

Browser = Literal["chrome", "edge", "firefox", "safari"]
Platform = Literal["prolific", "sona", "mturk"]
Encoding = Literal["auto", "lossless", "jpeg"]
_CODE = re.compile(r"[A-Za-z0-9_-]{0,64}")


class Codes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a participant takes back to where they were recruited, by how their session ended; "" shows no code."""

    complete: str = ""
    declined: str = ""  # did not agree
    screened_out: str = ""  # browser, window, line or keyboard, or a criterion not reached
    failed_check: str = ""  # wrong answers, where the questions say failed = "end"
    timed_out: str = ""  # nobody was there for as long as the study waits
    quit: str = ""  # ended it themselves


class Online(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the study runs in a browser; without this table it runs there all the same."""

    picture_px: tuple[int, int] = (
        640,
        480,
    )  # of the world's picture, width and height; shown enlarged, never stretched
    encoding: Encoding = "auto"  # auto: grid worlds lossless, first-person ones as JPEG
    grace_s: float = 600.0  # so long a lost line may take to come back before the session ends
    idle_s: float = 1800.0  # so long nothing may be pressed; 0: for ever
    browsers: tuple[Browser, ...] = ()  # that may take part; (): any
    max_rtt_ms: float = 0.0  # the slowest line that may, there and back; 0: any
    min_window_px: tuple[int, int] = (0, 0)  # the smallest window that may, width and height
    keyboard: bool = True  # whoever has only a touch screen may not
    anyone: bool = False  # who comes without a link and from no platform gets a slot, too
    platforms: tuple[Platform, ...] = ()  # that people may come from; () asks for links
    most_at_once: int = 200  # seats
    codes: Codes = Codes()
    redirect: str = ""  # where the page leads at the end; {code} and {id}, the platform's id, are filled in


def complaints(online: Online) -> list[tuple[str, str]]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    found = []
    for field, least, most in (("picture_px", 16, 4096), ("min_window_px", 0, 8192)):
        if not all(least <= side <= most for side in getattr(online, field)):
            found.append((f"$.web.{field}", f"is {list(getattr(online, field))}; use {least} to {most} px a side"))
    for field, least, most in (("grace_s", 0, 86_400), ("idle_s", 0, 86_400), ("max_rtt_ms", 0, 60_000)):
        if not least <= getattr(online, field) <= most:
            found.append((f"$.web.{field}", f"is {getattr(online, field):g}; use {least} to {most}"))
    if not 1 <= online.most_at_once <= 10_000:
        found.append(("$.web.most_at_once", f"is {online.most_at_once}; use 1 to 10000"))
    for name in online.codes.__struct_fields__:
        code = getattr(online.codes, name)
        if not _CODE.fullmatch(code):
            found.append((f"$.web.codes.{name}", f"is {code!r}; use letters, digits, '-' and '_', at most 64"))
    codes = [code for name in online.codes.__struct_fields__ if (code := getattr(online.codes, name))]
    if codes.count(online.codes.complete) > 1 and online.codes.complete:
        found.append(("$.web.codes.complete", "is another end's code, too; give completion one of its own"))
    if online.redirect and not online.redirect.startswith("https://"):
        found.append(("$.web.redirect", f"is {online.redirect!r}; it starts with https://"))
    if set(re.findall(r"\{([^}]*)\}", online.redirect)) - {"code", "id"}:
        found.append(("$.web.redirect", "has a bad placeholder; use {code} and {id}"))
    return found
