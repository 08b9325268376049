"""The interface that every native world offers on `env.unwrapped`, in addition to Gymnasium's API.

It covers the pose, the map, the picture, state hashes, the shortest path and bounds on its length, and save and
restore. The module also has a search for the first success in any such world, which leaves the world as it was.
"""

import abc
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.pose import Map, Pose

View = Literal["partial", "full"]
Palette = Literal["classic", "colour-safe"]


@dataclass(frozen=True, slots=True)
class PathLengthBounds:
    """Bounds on the number of steps to success from the current state; None where a bound is unknown.

    No path is shorter than ``at_least``, and a path of ``feasible`` steps is known. In the grid the two are equal.
    """

    at_least: int | None = None
    feasible: int | None = None


UNKNOWN_BOUNDS = PathLengthBounds()


PICTURES_VERSION = 2  # goes up when first-person worlds are drawn differently; a log names the version of its pictures
SHADOWS_VERSION = 2  # as PICTURES_VERSION, for worlds with contact shadows alone
CLAUSES_VERSION = 2  # goes up when more worlds report their subgoals; a log names the version that recorded it


OLD_NAMES = {
    "way": "shortest_path",
    "bounds": "path_length_bounds",
    "judge": "reward_and_done",
    "sought": "targets",
    "clauses": "subgoals",
}


def answer_to_old_names(cls: type) -> None:
    """Add old names from the last release to the methods that a class defines; calling them by these names warns."""
    for old, new in OLD_NAMES.items():
        if new in vars(cls) and old not in vars(cls):
            setattr(cls, old, _deprecated(old, new, vars(cls)[new]))


def _deprecated(old: str, new: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls a method and warns that its name has changed."""

    @wraps(method)
    def call(*args: Any, **kwargs: Any) -> Any:
        warnings.warn(f"{old}() is called {new}() now", DeprecationWarning, stacklevel=2)
        return method(*args, **kwargs)

    return call


class ReadOnlyName:
    """A read-only attribute that is computed on each access. A subclass or an instance may override it."""

    def __init__(self, read: Callable[[Any], Any]) -> None:
        self._read = read
        self.__doc__ = read.__doc__

    def __get__(self, world: Any, owner: Any = None) -> Any:
        if world is None:
            return self
        return self._read(world)


class NativeWorld(abc.ABC):
    """A world that knows its pose, its map and its exact state. It is mixed into a ``gymnasium.Env``."""

    drawn: ClassVar[bool] = False  # whether observations are pictures that a later version may draw otherwise

    action_names: tuple[str, ...]  # one per discrete action, snake case: "left", "move_forward"

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Withdraw the inherited shortest path from a class with its own rules, and accept methods' old names.

        A class that overrides `reward_and_done`, `step` or `advance` but not `shortest_path` or `path_length_bounds`
        has no planner, because the inherited one holds only for the parent's rules.
        """
        super().__init_subclass__(**kwargs)
        for old, new in OLD_NAMES.items():
            if old in vars(cls) and new not in vars(cls):
                warnings.warn(
                    f"{cls.__qualname__}.{old} is called {new} now; rename it, the next release ignores {old}",
                    DeprecationWarning,
                    stacklevel=2,
                )
                setattr(cls, new, vars(cls)[old])
        if {"reward_and_done", "step", "advance"} & vars(cls).keys():
            for name in {"shortest_path", "path_length_bounds"} - vars(cls).keys():
                setattr(cls, name, vars(NativeWorld)[name])
        answer_to_old_names(cls)

    @property
    def is_compiled(self) -> bool:
        """Return whether compiled kernels alone step and draw the world, on flat arrays."""
        return False

    @abc.abstractmethod
    def pose(self) -> Pose:
        """Return the agent's current pose."""

    @abc.abstractmethod
    def map(self) -> Map:
        """Return the floor plan with the objects at their current places."""

    @abc.abstractmethod
    def state_hash(self) -> int:
        """Hash everything that decides the future to a uint64. Equal states have equal hashes on every machine."""

    @abc.abstractmethod
    def scene_hash(self) -> int:
        """Hash the state without its number of steps to a uint64, so that paths to one scene have equal hashes."""

    @abc.abstractmethod
    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Make a step without computing the observation; return the reward, terminated and truncated.

        Raises:
            WorldError: in the cases in which ``step`` raises it.
        """

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """Return the subgoals of the episode's instruction, each with the step that completed it, or 0."""
        return ()

    def shortest_path(self) -> Sequence[int] | None:
        """Return the shortest list of actions that leads to success from the current state. Turns count as actions.

        The list is empty if there is no such path. None means that the world has no planner.

        Raises:
            WorldError: if planning would take too long.
        """
        return None

    def path_length_bounds(self) -> PathLengthBounds:
        """Return bounds on the number of steps to success from the current state."""
        return PathLengthBounds(feasible=len(self.shortest_path() or ()) or None)

    @abc.abstractmethod
    def save(self) -> Any:
        """Return an exact copy of the state in mid-episode, including the random streams. The copy can be pickled."""

    @abc.abstractmethod
    def restore(self, saved: Any) -> None:
        """Restore a saved state. The copy is not consumed and may be restored again."""

    @abc.abstractmethod
    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Draw the picture that a person sees, uint8[H, W, 3], at most ``size_px`` (width, height) large.

        The view ``partial`` shows what the agent sees, ``full`` the whole world from above. The grid uses the largest
        whole-numbered tile size that fits; first-person worlds fill the size. Drawing does not change the state.
        """


answer_to_old_names(NativeWorld)


def search_first_success(world: NativeWorld, actions: Sequence[int], *, most_scenes: int = 2_000) -> list[int] | None:
    """Return the shortest sequence of the given actions that earns a reward, or None if there is none.

    The search tries all actions in every scene, breadth first, and visits a scene that several paths reach only once.
    The world's step limit applies. The world is left as it was.

    Raises:
        WorldError: if there are more scenes than ``most_scenes``.
    """
    start = world.save()
    scenes = {world.scene_hash()}
    states = [start]
    parents = [(-1, -1)]  # the index of each state's predecessor, and the action that leads from there
    try:
        for at, saved in enumerate(states):  # the loop appends to this list
            for action in actions:
                world.restore(saved)
                reward, terminated, truncated = world.advance(action)
                if reward > 0:
                    return actions_from_start(parents, at, action)
                scene = world.scene_hash()
                if terminated or truncated or scene in scenes:
                    continue
                scenes.add(scene)
                if len(scenes) > most_scenes:
                    raise WorldError(
                        f"no path to success was found in the first {most_scenes} states searched; "
                        "there may still be one"
                    )
                parents.append((at, action))
                states.append(world.save())
        return None
    finally:
        world.restore(start)


def actions_from_start(parents: list[tuple[int, int]], at: int, last: int) -> list[int]:
    """Return the actions that lead from the start to a state, followed by one more action.

    Args:
        parents: per state, the index of its predecessor and the action that leads from there.
        at: the index of the state.
        last: the action to append.
    """
    actions = [last]
    while at > 0:
        at, action = parents[at]
        actions.append(action)
    return actions[::-1]
