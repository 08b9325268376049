"""The end of a web session: the completion code and the address to return to, and the page's texts around a session.

A code is given only when the log is on the disk. The texts (waiting, refusals, the end) are in ``page_texts.toml``.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Literal
from urllib.parse import quote

from minihuman.experiment.machine.events import EndReason
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import WebSpec
from minihuman.experiment.words import ENGLISH

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
    """What the page says at last."""

    end: WebEnding
    code: str = ""
    url: str = ""  # where to go with it


def classify_ending(reason: EndReason, *, agreed: bool, part_kind: str = "") -> WebEnding:
    """What an end is to the participant.

    Args:
        reason: the session's.
        agreed: whether there was a consent, or none was asked for; an end before that is a refusal.
        part_kind: the kind of the part in which it ended.
    """
    if not agreed and reason in ("quit", "window_closed", "declined"):
        return "declined"
    if reason == "screened_out" and part_kind == "questions":
        return "failed_check"
    return _ENDS.get(reason, "broken")


def get_session_code(protocol: Protocol, session: int) -> str:
    """The completion code of a session's own; "" where it has none."""
    return protocol.sessions[session - 1].completion_code if session <= len(protocol.sessions) else ""


def build_completion(online: WebSpec, end: WebEnding, *, session_code: str = "", person: str = "") -> Completion:
    """The code and the address for an end.

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
    """By language, by key."""
    return tomllib.loads(files(__package__).joinpath("page_texts.toml").read_text(encoding="utf-8"))


def get_page_texts(language: str) -> dict[str, str]:
    """What the page says in a language; English where it is none of ours."""
    return load_page_texts().get(language, load_page_texts()[ENGLISH])
