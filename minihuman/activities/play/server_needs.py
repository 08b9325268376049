"""What in a block needs a server: a page that runs a session alone has neither its clock nor its secrets."""

from collections.abc import Iterator
from typing import Any

import msgspec

from minihuman.experiment.plan.session_plan import PlannedPart

_NEEDS = {
    "until": "goes on until a criterion is met",
    "points": "gives points",
    "show_points": "shows points",
    "max_s": "limits an episode's time",
    "block_max_s": "limits the block's time",
    "trial": "is a block of trials",
    "bindings": "is played by pointer or gamepad",
    "design": "has an adaptive design",
}


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield what in a block needs a server."""
    plan: Any = part.plan
    for name, clause in _NEEDS.items():
        setting = getattr(plan, name)
        if setting and setting is not msgspec.UNSET:
            yield clause
    if plan.computed != "page":
        yield "is computed by the server"
