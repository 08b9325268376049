"""What every native world offers on `env.unwrapped`, beside Gymnasium's five-tuple API.

Pose, map, picture, state hashes, the shortest path and bounds on its length, save and restore. Also a search for the
first success in any such world by save and restore; the world is left as it was.
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
    """How many steps success takes from here; None where that is unknown.

    No path is shorter than ``at_least``; a path of ``feasible`` steps is known. In the grid they are equal.
    """

    at_least: int | None = None
    feasible: int | None = None


UNKNOWN_BOUNDS = PathLengthBounds()


PICTURES_VERSION = 2  # goes up when first-person worlds are drawn differently; a log names the version of its pictures
CLAUSES_VERSION = 2  # goes up when more worlds report their subgoals; a log names the version that recorded it


OLD_NAMES = {
    "way": "shortest_path",
    "bounds": "path_length_bounds",
    "judge": "reward_and_done",
    "sought": "targets",
    "clauses": "subgoals",
}


def answer_to_old_names(cls: type) -> None:
    """Give the methods that a class defines their names of the last release too, which warn."""
    for old, new in OLD_NAMES.items():
        if new in vars(cls) and old not in vars(cls):
            setattr(cls, old, _deprecated(old, new, vars(cls)[new]))


def _deprecated(old: str, new: str, method: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(method)
    def call(*args: Any, **kwargs: Any) -> Any:
        warnings.warn(f"{old}() is called {new}() now", DeprecationWarning, stacklevel=2)
        return method(*args, **kwargs)

    return call


class ReadOnlyName:
    """A name to read, computed each time; a subclass or an instance may define its own under the same name."""

    def __init__(self, read: Callable[[Any], Any]) -> None:
        self._read = read
        self.__doc__ = read.__doc__

    def __get__(self, world: Any, owner: Any = None) -> Any:
        if world is None:
            return self
        return self._read(world)


class NativeWorld(abc.ABC):
    """A world that knows its pose, its map and its exact state. Mixed into a ``gymnasium.Env``."""

    drawn: ClassVar[bool] = False  # whether observations are pictures that a later version may draw otherwise

    action_names: tuple[str, ...]  # one per discrete action, snake case: "left", "move_forward"

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Withdraw the inherited shortest path from a class with rules of its own, and accept methods' old names.

        A class that overrides `reward_and_done`, `step` or `advance` and not `shortest_path` or `path_length_bounds`
        has none: those of its parent hold for the parent's rules.
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
        """Return whether compiled kernels alone step and draw it, on flat arrays."""
        return False

    @abc.abstractmethod
    def pose(self) -> Pose:
        """Return the agent's pose now."""

    @abc.abstractmethod
    def map(self) -> Map:
        """Return the floor plan with the things where they stand now."""

    @abc.abstractmethod
    def state_hash(self) -> int:
        """Hash everything that decides the future to a uint64: equal states, equal hashes, on every machine."""

    @abc.abstractmethod
    def scene_hash(self) -> int:
        """Hash the same except the number of steps taken to a uint64: equal where two paths meet."""

    @abc.abstractmethod
    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Make a step without its observation: reward, terminated, truncated.

        Raises:
            WorldError: as ``step``.
        """

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """Return the clauses of the episode's instruction, each with the step that did it; 0 for none yet."""
        return ()

    def shortest_path(self) -> Sequence[int] | None:
        """Plan actions that lead to success from here, turns counted; empty if none, None without a planner.

        Raises:
            WorldError: if planning would take too long.
        """
        return None

    def path_length_bounds(self) -> PathLengthBounds:
        """Return bounds on the steps that success takes from here."""
        return PathLengthBounds(feasible=len(self.shortest_path() or ()) or None)

    @abc.abstractmethod
    def save(self) -> Any:
        """Copy the state exactly in mid-episode, random streams included; the copy can be pickled."""

    @abc.abstractmethod
    def restore(self, saved: Any) -> None:
        """Go back to a saved state; the copy is not consumed and may be restored again."""

    @abc.abstractmethod
    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Draw the picture a person sees, uint8[H, W, 3], natively at most ``size_px`` (width, height) large.

        ``partial`` is what the agent sees, ``full`` the whole world from above. The grid answers with the largest
        whole-numbered tile size that fits; 3D fills the size. Drawing changes no state.
        """


answer_to_old_names(NativeWorld)


def search_first_success(world: NativeWorld, actions: Sequence[int], *, most_scenes: int = 2_000) -> list[int] | None:
    """Find the shortest list of these actions that earns a reward, by trying them all; None if there is none.

    A scene that two paths lead to is tried once. The world is left as it was. Its step limit counts.

    Raises:
        WorldError: if there are more scenes than ``most_scenes``.
    """
    before = world.save()
    scenes = {world.scene_hash()}
    waiting = [before]
    parents = [(-1, -1)]
    try:
        for at, saved in enumerate(waiting):  # which grows meanwhile
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
                waiting.append(world.save())
        return None
    finally:
        world.restore(before)


def actions_from_start(parents: list[tuple[int, int]], at: int, last: int) -> list[int]:
    """Return the actions to a state, and one more; ``parents`` has each state's predecessor and the action between."""
    actions = [last]
    while at > 0:
        at, action = parents[at]
        actions.append(action)
    return actions[::-1]
