"""Registry of activity kinds: the entry-point group `minihuman.activities`, which names the built-in ones too."""

from functools import cache

from minihuman.errors import ProtocolError
from minihuman.experiment.activities.activity import Activity, ActivityKind, SessionContext
from minihuman.experiment.plan.session_plan import PlannedPart
from minihuman.plugins import list_plugin_names, load_plugin

GROUP = "minihuman.activities"


def list_built_in_kinds() -> tuple[str, ...]:
    """The names of this package's kinds."""
    return list_plugin_names(GROUP, built_in=True)


@cache
def find_kind(name: str) -> ActivityKind:
    """The kind of that name.

    Raises:
        ProtocolError: if none is installed.
    """
    kind = load_plugin(GROUP, name, ProtocolError, what="activity")
    if not isinstance(kind, ActivityKind):
        raise ProtocolError(
            f"activity {name!r} is of type {type(kind).__name__}; register an instance of minihuman.ext.ActivityKind"
        )
    return kind


def build_activity(number: int, part: PlannedPart, context: SessionContext) -> Activity:
    """An activity for a part of a plan."""
    return find_kind(part.kind).activity(number, part, context)
