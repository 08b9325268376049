"""What in a block needs a server: a page that runs a session alone has neither its clock nor its secrets."""

from collections.abc import Iterator

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.plan.session_plan import PlannedPart

_NEEDS = {
    "until": "goes on until a criterion is met",
    "points": "gives points",
    "show_points": "shows points",
    "max_s": "limits an episode's time",
    "block_max_s": "limits the block's time",
    "bindings": "is played by pointer or gamepad",
    "design": "has an adaptive design",
}


def list_block_needs(plan: PlayPlan) -> Iterator[str]:
    """Yield a clause such as "gives points" for each setting of a block's plan that needs a server.

    These settings apply to blocks of trials and to other blocks alike.
    """
    for name, clause in _NEEDS.items():
        setting = getattr(plan, name)
        if setting and setting is not msgspec.UNSET:
            yield clause


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield a clause such as "gives points" for each property of a block that needs a server."""
    yield from list_block_needs(part.plan)
    if part.plan.trial:
        yield "is a block of trials"
    if part.plan.computed != "page":
        yield "is computed by the server"
