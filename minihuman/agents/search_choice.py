"""The choice of a goal search that suits a world."""

import numpy as np

from minihuman.agents.goal_search import FullViewSearch, GoalSearch, GridSearch, JudgementNoise, RoomSearch
from minihuman.worlds.adapters.seat import SeatEnv
from minihuman.worlds.adapters.world import World
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.heights.env import BuildingEnv
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.inside.env import GridFromInside


def build_search(world: World, view: str, noise: JudgementNoise, rng: np.random.Generator) -> GoalSearch:
    """Build the goal search that suits a world; with a full view, it searches for nothing and follows the path.

    In a building, it follows the path too, since what is seen is remembered for one floor alone.

    Raises:
        SimulationError: if no planner knows the world's goal.
    """
    env = world.unwrapped
    if (kitchen := build_kitchen_search(world)) is not None:
        return kitchen
    if view == "full" and not world.subgoals():
        return FullViewSearch(world)
    if isinstance(env, GridEngine | GridFromInside):
        return GridSearch(world, noise, rng)
    if isinstance(env, FirstPersonEnv) and not isinstance(env, BuildingEnv) and env.targets():
        return RoomSearch(world, noise, rng)
    return FullViewSearch(world)


def build_kitchen_search(world: World) -> GoalSearch | None:
    """Build the search for a cook's seat in a kitchen; return None for any other world."""
    if not isinstance(world.unwrapped, SeatEnv):
        return None
    from minihuman.agents.team_agents import KitchenSearch  # compiled: only where they are used
    from minihuman.worlds.grid.kitchen import Kitchen

    if isinstance(world.unwrapped.team, Kitchen):
        return KitchenSearch(world)
    return None
