"""What somebody who looks for something does next: on what was seen alone, and on what is left of it in memory."""

import abc
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from minihuman.players.port import way_of
from minihuman.worlds.adapt.world import World
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.layouts.goal import GoalEnv
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.inside.grid_view import GridFromInside

Noise = Callable[[int], NDArray[np.float64]]  # how far off each of so many judgements is, in actions
_UNDO = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}


class Search(abc.ABC):
    """One episode's search, in action names."""

    @abc.abstractmethod
    def way(self) -> list[str]:
        """What to do from here, as far as it is decided; empty where nothing is left to try.

        Raises:
            WorldError: if it would take too long to tell.
        """

    @abc.abstractmethod
    def forget(self, chance: float) -> None:
        """Forget each place that is not in sight with this chance."""

    @abc.abstractmethod
    def did(self, action: str, *, in_vain: bool) -> None:
        """An action was done; nothing may have come of it."""


def search_of(world: World, view: str, noise: Noise, rng: np.random.Generator) -> Search:
    """How one looks for what is to be found in a world; who is shown all of it need not look.

    Raises:
        PlayerError: if the world cannot tell what leads to success.
    """
    env = world.unwrapped
    if view == "full" and not world.clauses():
        return Shown(world)
    if isinstance(env, GridEngine | GridFromInside):
        return GridSearch(world, noise, rng)
    if isinstance(env, FirstPersonEnv) and env.sought():
        return RoomSearch(world, noise, rng)
    return Shown(world)


class Shown(Search):
    """Everything is in sight, or the world does not say what is to be looked for: the way that the world knows."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._way: list[str] = []

    def way(self) -> list[str]:
        """The rest of the last way while it is kept to, a new one where it is not."""
        if not self._way:
            self._way = way_of(self._world)
        return self._way

    def forget(self, chance: float) -> None:
        """Nothing: all is in sight."""

    def did(self, action: str, *, in_vain: bool) -> None:
        """Is the way still the way?"""
        if in_vain:
            return
        if self._way[:1] == [action]:
            self._way.pop(0)
        elif self._way and action in _UNDO:
            self._way.insert(0, _UNDO[action])
        else:
            self._way = []


class GridSearch(Search):
    """In a grid, from above or from inside."""

    def __init__(self, world: World, noise: Noise, rng: np.random.Generator) -> None:
        from minihuman.worlds.grid.instructions.explorer import Explorer  # compiled: only where it is used
        from minihuman.worlds.grid.instructions.memory import PEOPLE

        env = world.unwrapped
        grid = env.grid if isinstance(env, GridFromInside) else env
        self._env, self._rng = grid, rng
        inside = grid is not env
        self._explorer = Explorer(grid.state, grid.image_shape[0], judgement=PEOPLE, noise=noise, inside=inside)

    def way(self) -> list[str]:
        """What the exploring expert would do; where nothing is left to try, all is looked at again."""
        if not self._explorer.way(self._env.state):
            self.forget(1.0)
        return [self._env.action_names[action] for action in self._explorer.way(self._env.state)]

    def forget(self, chance: float) -> None:
        """Cell by cell."""
        self._explorer.memory.forget(chance, self._rng)

    def did(self, action: str, *, in_vain: bool) -> None:
        """Nothing: the explorer sees for itself."""


class RoomSearch(Search):
    """In rooms in first person."""

    def __init__(self, world: World, noise: Noise, rng: np.random.Generator) -> None:
        from minihuman.worlds.first_person.way.memory import Memory

        self._world, self._env, self._noise, self._rng = world, world.unwrapped, noise, rng
        self._memory = Memory(self._env)
        self._shown = Shown(world)  # once all that is looked for has been seen

    def way(self) -> list[str]:
        """To what is looked for, once all of it has been seen; else to where more can be seen."""
        memory = self._memory
        memory.look()
        sought = self._env.sought()
        if all(any(thing is one for one in memory.things) for thing in sought):
            if type(self._env).way is not GoalEnv.way:
                return self._shown.way()
            move = memory.step_to(sought[0])
            if move is not None:
                return [move]
        move = memory.step_to_see_more(self._noise)
        if move is None:
            memory.start_over()
            move = memory.step_to_see_more(self._noise)
        return [] if move is None else [move]

    def forget(self, chance: float) -> None:
        """Patch by patch."""
        self._memory.forget(chance, self._rng)

    def did(self, action: str, *, in_vain: bool) -> None:
        """Where a step led nowhere, something is in the way."""
        self._shown.did(action, in_vain=in_vain)
        if action == "move_forward":
            self._memory.bumped() if in_vain else self._memory.moved()
