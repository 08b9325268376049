"""The kinds of activity that there are: ours, and those of the entry-point group ``minihuman.activities``."""

from functools import cache
from importlib.metadata import entry_points

from minihuman.errors import ProtocolError
from minihuman.study.activities.keyboard import KEYBOARD_CHECK
from minihuman.study.activities.pages import PAGE
from minihuman.study.activities.play import PLAY
from minihuman.study.activities.port import Activity, Kind
from minihuman.study.activities.questions import QUESTIONS
from minihuman.study.plan import Part
from minihuman.study.stage import Stage

GROUP = "minihuman.activities"
_OURS = {kind.name: kind for kind in (KEYBOARD_CHECK, PAGE, PLAY, QUESTIONS)}


@cache
def kind_of(name: str) -> Kind:
    """The kind of that name.

    Raises:
        ProtocolError: if none is installed.
    """
    if name in _OURS:
        return _OURS[name]
    for entry in entry_points(group=GROUP, name=name):
        kind = entry.load()
        assert isinstance(kind, Kind), f"{entry.value} is no minihuman.study.activities.port.Kind"
        return kind
    raise ProtocolError(f"no activity {name!r} is installed; there are {', '.join(kind_names())}")


def kind_names() -> tuple[str, ...]:
    """Every kind installed."""
    return tuple(sorted({*_OURS, *(entry.name for entry in entry_points(group=GROUP))}))


def activity_of(number: int, part: Part, stage: Stage) -> Activity:
    """An activity for a part of a plan."""
    return kind_of(part.kind).activity(number, part, stage)
