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
    """Build the goal search that suits a world and a view.

    With a full view of a world without subgoals, nothing has to be found, so the search follows the shortest path. It
    does so in a building, too, because the memory of seen places has only one floor.

    Args:
        world: the world.
        view: the part of the world that the participant sees, such as "full".
        noise: draws the errors of judgements.
        rng: the random numbers of what is forgotten.

    Raises:
        SimulationError: if no planner knows the world's goal.
    """
    env = world.unwrapped
    kitchen_search = build_kitchen_search(world)
    if kitchen_search is not None:
        return kitchen_search
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
    from minihuman.agents.team_agents import KitchenSearch  # compiled, so imported only for kitchens
    from minihuman.worlds.grid.kitchen import Kitchen

    if isinstance(world.unwrapped.team, Kitchen):
        return KitchenSearch(world)
    return None
