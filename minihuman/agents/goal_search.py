"""Search for a goal from what has been seen and is still remembered.

There are searches for grids, for first-person rooms, and for worlds in full view.
"""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import SimulationError
from minihuman.moved import forward_names
from minihuman.worlds.adapters.world import World
from minihuman.worlds.first_person.layouts.one_room import GoalEnv
from minihuman.worlds.inside.env import GridFromInside

JudgementNoise = Callable[[int], NDArray[np.float64]]  # draws the errors of so many judgements, in actions


def find_shortest_path(world: World) -> list[str]:
    """Return the names of the actions on the shortest path to success from the present state; empty if there is none.

    Raises:
        SimulationError: if the world has no planner.
    """
    path = world.shortest_path()
    if path is None:
        raise SimulationError(
            f"{world.id} has no planner to find a path; use the random agent or the random participant"
        )
    return list(path)


_INVERSE_ACTIONS = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}


class GoalSearch(abc.ABC):
    """A search for the goal of one episode, in terms of action names."""

    @abc.abstractmethod
    def plan(self) -> list[str]:
        """Return the names of the actions that are decided, the next one first; empty if there is nothing else to try.

        Raises:
            WorldError: if planning would take too long.
        """

    @abc.abstractmethod
    def forget(self, chance: float) -> None:
        """Forget each place that is out of sight with a given probability."""

    @abc.abstractmethod
    def observe_action(self, action: str, *, no_effect: bool) -> None:
        """Record an action that was done; ``no_effect`` says that it changed nothing."""


class FullViewSearch(GoalSearch):
    """A search that follows the shortest path, for worlds that are fully visible or name no targets."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._path: list[str] = []

    def plan(self) -> list[str]:
        """Return the remaining actions of the current path, or a new shortest path if there are none."""
        if not self._path:
            self._path = find_shortest_path(self._world)
        return self._path

    def forget(self, chance: float) -> None:
        """Do nothing, because everything is in sight."""

    def observe_action(self, action: str, *, no_effect: bool) -> None:
        """Update the path: remove an action that it began with, or prepend the inverse of a turn off the path.

        After any other action that had an effect, discard the path.
        """
        if no_effect:
            return
        if self._path[:1] == [action]:
            self._path.pop(0)
        elif self._path and action in _INVERSE_ACTIONS:
            self._path.insert(0, _INVERSE_ACTIONS[action])
        else:
            self._path = []


class GridSearch(GoalSearch):
    """A search in a grid that is seen from above or from inside.

    Args:
        world: the grid world.
        noise: draws the errors of judgements, in actions.
        rng: draws what is forgotten.
    """

    def __init__(self, world: World, noise: JudgementNoise, rng: np.random.Generator) -> None:
        from minihuman.worlds.grid.babyai.exploring_expert import Explorer  # compiled: only where it is used
        from minihuman.worlds.grid.belief_state import PEOPLE_WEIGHTS

        env = world.unwrapped
        grid = env.grid if isinstance(env, GridFromInside) else env
        self._env = grid
        self._rng = rng
        is_inside = grid is not env
        self._explorer = Explorer(
            grid.state, grid.image_shape[0], judgement=PEOPLE_WEIGHTS, noise=noise, inside=is_inside
        )

    def plan(self) -> list[str]:
        """Return the plan of the exploring expert; if nothing is left to try, forget everything and explore again."""
        if not self._explorer.way(self._env.state):
            self.forget(1.0)
        return [self._env.action_names[action] for action in self._explorer.way(self._env.state)]

    def forget(self, chance: float) -> None:
        """Forget each cell that is out of sight with a given probability."""
        self._explorer.memory.forget(chance, self._rng)

    def observe_action(self, action: str, *, no_effect: bool) -> None:
        """Do nothing, because the explorer reads the state."""


class RoomSearch(GoalSearch):
    """A search in rooms in first person.

    Args:
        world: the first-person world.
        noise: draws the errors of judgements, in actions.
        rng: draws what is forgotten.
    """

    def __init__(self, world: World, noise: JudgementNoise, rng: np.random.Generator) -> None:
        from minihuman.worlds.first_person.pathfinding.belief_state import ExploredFloor

        self._world = world
        self._env = world.unwrapped
        self._noise = noise
        self._rng = rng
        self._memory = ExploredFloor(self._env)
        self._known_path = FullViewSearch(world)  # once all targets have been seen

    def plan(self) -> list[str]:
        """Return actions towards the targets once all have been seen, and before that to where more can be seen.

        If nothing more can be seen, forget the floor and explore it again.
        """
        memory = self._memory
        memory.look()
        targets = self._env.targets()
        if all(any(target is thing for thing in memory.things) for target in targets):
            needs_whole_path = type(self._env).shortest_path is not GoalEnv.shortest_path  # not one target to reach
            if needs_whole_path:
                return self._known_path.plan()
            move = memory.step_to(targets[0])
            if move is not None:
                return [move]
        move = memory.step_to_see_more(self._noise)
        if move is None:
            memory.start_over()
            move = memory.step_to_see_more(self._noise)
        if move is None:
            return []
        return [move]

    def forget(self, chance: float) -> None:
        """Forget each patch of floor that is out of sight with a given probability."""
        self._memory.forget(chance, self._rng)

    def observe_action(self, action: str, *, no_effect: bool) -> None:
        """Record an action; a step forward without effect marks an obstacle."""
        self._known_path.observe_action(action, no_effect=no_effect)
        if action == "move_forward":
            if no_effect:
                self._memory.bumped()
            else:
                self._memory.moved()


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
