"""The kinds of activity that there are: ours, and those of the entry-point group ``minihuman.activities``."""

from functools import cache

from minihuman.errors import ProtocolError
from minihuman.plugins import load
from minihuman.study.activities.correction import CORRECTION
from minihuman.study.activities.keyboard import KEYBOARD_CHECK
from minihuman.study.activities.pages import PAGE
from minihuman.study.activities.play import PLAY
from minihuman.study.activities.port import Activity, Kind
from minihuman.study.activities.preferences import PREFERENCES
from minihuman.study.activities.questions import QUESTIONS
from minihuman.study.activities.rating import RATING
from minihuman.study.activities.takeover import TAKEOVER
from minihuman.study.plan import Part
from minihuman.study.stage import Stage

GROUP = "minihuman.activities"
OURS = {kind.name: kind for kind in (CORRECTION, KEYBOARD_CHECK, PAGE, PLAY, PREFERENCES, QUESTIONS, RATING, TAKEOVER)}


@cache
def kind_of(name: str) -> Kind:
    """The kind of that name.

    Raises:
        ProtocolError: if none is installed.
    """
    if name in OURS:
        return OURS[name]
    kind = load(GROUP, name, ProtocolError, what="activity")
    assert isinstance(kind, Kind), f"{kind!r} is no minihuman.study.activities.port.Kind"
    return kind


def activity_of(number: int, part: Part, stage: Stage) -> Activity:
    """An activity for a part of a plan."""
    return kind_of(part.kind).activity(number, part, stage)
