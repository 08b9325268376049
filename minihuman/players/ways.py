"""The shortest way to the goal, by each kind of world's own planner."""

from collections.abc import Sequence

from minihuman.errors import PlayerError
from minihuman.worlds.adapt.world import World
from minihuman.worlds.first_person.layouts.goal import GoalEnv
from minihuman.worlds.grid.engine import GridEngine


def shortest_way(world: World) -> tuple[str, ...]:
    """Action names that lead to the goal from here, turns counted; empty if the planner finds no way.

    Raises:
        PlayerError: if the world is of no kind that has a planner.
    """
    env = world.unwrapped
    actions: Sequence[int]
    if isinstance(env, GridEngine):
        from minihuman.worlds.grid.planner import plan as plan_in_grid  # compiled: only where it is used

        actions = plan_in_grid(env.state) or ()
    elif isinstance(env, GoalEnv):
        from minihuman.worlds.first_person.way.planner import plan as plan_in_rooms

        actions = plan_in_rooms(env, env.box) or ()
    else:
        raise PlayerError(f"{world.id}: no planner knows its goal; let a 'random' player play it")
    return tuple(world.action_names[action] for action in actions)
