"""Worlds that a log names are made by code; whose code that may be is not for the log to say."""

import os
import sys
from collections.abc import Callable, Collection
from typing import Any

from minihuman.errors import WorldError
from minihuman.worlds.adapt.world import World

KNOWN = frozenset({"minihuman", "gymnasium", "minigrid", "miniworld", "ale_py"})
VARIABLE = "MINIHUMAN_TRUST"  # modules that are trusted on this machine, with commas between


def trusting(modules: Collection[str] = ()) -> Callable[[str, dict[str, Any]], World]:
    """A maker of worlds that imports nothing but known modules, these, those in the environment's MINIHUMAN_TRUST.

    A module that is imported already may be used: its code has run.
    """
    trusted = {*modules, *filter(None, os.environ.get(VARIABLE, "").split(","))}

    def make(world_id: str, options: dict[str, Any]) -> World:
        module = world_id.partition(":")[0] if ":" in world_id else ""
        known = module.partition(".")[0] in KNOWN or module in trusted or module in sys.modules
        if module and not known:
            raise WorldError(
                f"{world_id}: the log names the module {module!r}, and nothing is imported on a log's word; "
                f"if you know it, say --trust {module} where a command has that, or set {VARIABLE}={module}"
            )
        return World(world_id, options)

    return make
