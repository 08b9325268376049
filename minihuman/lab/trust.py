"""Worlds that a log names are made by code; whose code that may be is not for the log to say."""

import sys
from collections.abc import Collection
from typing import Any

from minihuman.errors import WorldError
from minihuman.study.stage import MakeWorld
from minihuman.worlds.adapt.world import World

KNOWN = frozenset({"minihuman", "gymnasium", "minigrid", "miniworld", "ale_py"})


def trusting(modules: Collection[str] = ()) -> MakeWorld:
    """A maker of worlds that imports nothing but known modules, these, and those that are imported already."""

    def make(world_id: str, options: dict[str, Any]) -> World:
        module = world_id.partition(":")[0] if ":" in world_id else ""
        if module and module.partition(".")[0] not in KNOWN and module not in modules and module not in sys.modules:
            raise WorldError(
                f"{world_id}: the log names the module {module!r}, and nothing is imported on a log's word; "
                f"if you know it, add --trust {module}"
            )
        return World(world_id, options)

    return make
