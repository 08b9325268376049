"""The end of a session on the web: which code a participant takes back, and where to. Only once the log is on disk."""

from dataclasses import dataclass
from typing import Literal
from urllib.parse import quote

from minihuman.study.events import EndReason
from minihuman.study.online import Online

End = Literal["complete", "declined", "screened_out", "failed_check", "timed_out", "quit", "broken"]

_ENDS: dict[str, End] = {
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
class Ending:
    """What the page says at last."""

    end: End
    code: str = ""
    url: str = ""  # where to go with it


def end_of(reason: EndReason, *, agreed: bool, part_kind: str = "") -> End:
    """What an end is to the participant.

    Args:
        reason: the session's.
        agreed: whether there was a consent, or none was asked for; who ends it before that declines.
        part_kind: the kind of the part in which it ended.
    """
    if not agreed and reason in ("quit", "window_closed", "declined"):
        return "declined"
    if reason == "screened_out" and part_kind == "questions":
        return "failed_check"
    return _ENDS.get(reason, "broken")


def ending(online: Online, end: End, *, person: str = "") -> Ending:
    """The code and the address for an end; ``person`` is the platform's id of whoever took part."""
    code = getattr(online.codes, end, "")
    url = ""
    if online.redirect and (code or "{code}" not in online.redirect):
        url = online.redirect.replace("{code}", quote(code, safe="")).replace("{id}", quote(person, safe=""))
    return Ending(end, code, url)
