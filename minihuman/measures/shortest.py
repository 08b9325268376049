"""How few steps an episode could have taken, from its plan alone."""

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from minihuman.study.plan import EpisodePlan

if TYPE_CHECKING:
    from minihuman.worlds.adapt.world import World


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


@lru_cache(maxsize=100_000)
def _of_layout(world_id: str, options: str, seed: int) -> Shortest:
    # here, as the worlds' kernels take a second to load and most tables are made without them
    from minihuman.worlds.first_person.layouts.goal import GoalEnv
    from minihuman.worlds.first_person.way import planner as first_person_planner
    from minihuman.worlds.grid import planner as grid_planner
    from minihuman.worlds.grid.engine import GridEngine

    world = _world(world_id, options)
    env = world.unwrapped
    if isinstance(env, GridEngine):
        world.reset(seed)
        actions = grid_planner.plan(env.state)
        return UNKNOWN if actions is None else Shortest(len(actions), len(actions))
    if isinstance(env, GoalEnv):
        world.reset(seed)
        way = first_person_planner.plan(env, env.box)
        return Shortest(first_person_planner.least_steps(env, env.box), None if way is None else len(way))
    return UNKNOWN


@lru_cache(maxsize=16)
def _world(world_id: str, options: str) -> "World":
    from minihuman.worlds.adapt.world import World

    return World(world_id, json.loads(options))
