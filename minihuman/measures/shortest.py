"""How few steps an episode could have taken, from its plan alone."""

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt import World
from minihuman.worlds.grid import planner as grid_planner
from minihuman.worlds.grid.world import GridWorld


@dataclass(frozen=True, slots=True)
class Shortest:
    """Bounds on the steps to the goal; None where nobody can tell.

    No way is shorter than ``at_least``; a way of ``feasible`` steps is known. In the grid they are equal.
    """

    at_least: int | None = None
    feasible: int | None = None


UNKNOWN = Shortest()


def shortest(plan: EpisodePlan) -> Shortest:
    """The fewest steps of an episode's world from its seed, turns counted.

    Raises:
        WorldError: if the world cannot be made here.
    """
    return _of_layout(plan.world, json.dumps(plan.options, sort_keys=True, default=str), plan.seed)
