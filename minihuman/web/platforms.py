"""Recruiting platforms: what their links carry, and who that says somebody is. No file, no network."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from minihuman.study.online import Platform

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_PARAMETERS: dict[Platform, str] = {"prolific": "PROLIFIC_PID", "sona": "survey_code", "mturk": "workerId"}
_PREVIEW = "ASSIGNMENT_ID_NOT_AVAILABLE"  # MTurk shows a task to people who have not taken it
PARAMETERS = frozenset(_PARAMETERS.values()) | {"assignmentId"}  # all that the page sends on


@dataclass(frozen=True, slots=True)
class Visitor:
    """Somebody a platform sent."""

    platform: Platform
    id: str
    preview: bool = False  # they look at the task and have not taken it

    def __repr__(self) -> str:
        """Without the id, which belongs in no log and no traceback."""
        return f"Visitor({self.platform})"


def visitor(parameters: Mapping[str, str], allowed: tuple[Platform, ...]) -> Visitor | None:
    """Who the parameters of a link say somebody is, of the platforms that the study takes people from.

    None where they say nobody, or what no platform writes.
    """
    for platform in allowed:
        who = parameters.get(_PARAMETERS[platform], "")
        if _ID.fullmatch(who):
            return Visitor(platform, who, preview=parameters.get("assignmentId") == _PREVIEW)
    return None


def link_for(platform: Platform, address: str) -> str:
    """The link to be given to a platform, which puts its ids in; behind the #, where no server writes it down."""
    match platform:
        case "prolific":
            return f"{address}#PROLIFIC_PID={{{{%PROLIFIC_PID%}}}}"
        case "sona":
            return f"{address}#survey_code=%SURVEY_CODE%"
        case "mturk":
            return address  # it adds ?workerId=... itself
