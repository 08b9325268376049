"""Team worlds, in which several bodies act: the interface that each offers, and how to make one from its id.

All bodies act at once: a joint action has one action per body. A team world is not a Gymnasium environment;
`worlds.adapters.pettingzoo` adapts it to PettingZoo's parallel API. This module knows no seats, people or time.
"""

import abc
import copy
import importlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.options import check_whole
from minihuman.worlds.pose import Map, Pose

NO_INFO: Mapping[str, Any] = MappingProxyType({})


class TeamStep(NamedTuple):  # three times as quick to make as a frozen dataclass
    """The values that a joint step returned."""

    rewards: tuple[float, ...]  # by body; all equal if the world shares its reward
    terminated: bool  # the task is over, for all bodies at once
    truncated: bool  # the step limit is reached
    info: Mapping[str, Any] = NO_INFO  # the same for all bodies
    infos: tuple[Mapping[str, Any], ...] = ()  # by body, in addition to ``info``; empty if no body has its own


class PictureTiles(NamedTuple):
    """A picture made of square tiles, most of which occur in other pictures as well."""

    keys: Sequence[tuple[Hashable, ...]]  # one per tile, row by row; equal keys look the same
    columns: int
    tile_px: int
    draw: Callable[..., NDArray[np.uint8]]  # draws a tile, uint8[tile_px, tile_px, 3], from the parts of its key

    def join(self) -> NDArray[np.uint8]:
        """Return the whole picture, uint8[H, W, 3]."""
        shape = len(self.keys) // self.columns, self.tile_px, self.columns, self.tile_px, 3
        out = np.empty(shape, np.uint8)  # a tenth of the time of np.stack and its copy
        for index, key in enumerate(self.keys):
            out[index // self.columns, :, index % self.columns] = self.draw(*key)
        return out.reshape(-1, self.columns * self.tile_px, 3)


class TeamWorld(abc.ABC):
    """A world in which 1 to 8 bodies act at once. ``reset`` must be called before any other method."""

    bodies: int
    action_names: tuple[str, ...]  # the same for each body, snake case
    idle_action: int  # what a body without an input does
    mission: str  # what the team is to do, in words
    max_steps: int
    observation_space: spaces.Box  # of one body
    _last_seed: int | None = None

    @abc.abstractmethod
    def reset(self, seed: int | None = None) -> None:
        """Begin a new episode. Equal seeds begin equal episodes; without a seed, one is derived from the last seed."""

    def choose_seed(self, seed: int | None) -> int:
        """Return the seed of a new episode: the given one, or one derived from the last, which is random at first."""
        if seed is None:
            chosen = int(np.random.default_rng(self._last_seed).integers(2**63))
        else:
            chosen = seed
        self._last_seed = chosen
        return chosen

    @abc.abstractmethod
    def step(self, actions: Sequence[int]) -> TeamStep:
        """Make one joint step.

        Args:
            actions: one action per body, in the order of the bodies.

        Raises:
            WorldError: before `reset`, after an episode's end, for a wrong number of actions, and for an action that
                does not exist. The state is then unchanged.
        """

    @abc.abstractmethod
    def observation(self, body: int) -> NDArray[Any]:
        """Return a body's current observation, a new array that belongs to `observation_space`."""

    @abc.abstractmethod
    def frame(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> NDArray[np.uint8]:
        """Draw the picture that a body's player sees, uint8[H, W, 3], at most ``width`` by ``height`` pixels."""

    def picture_tiles(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> PictureTiles | None:
        """Return the picture of `frame` as tiles, each sent to a page only once; None if it has no tiles."""
        return None

    @abc.abstractmethod
    def pose(self, body: int) -> Pose:
        """Return a body's current pose. All fields are NaN if it is unknown; `map` is then not used."""

    @abc.abstractmethod
    def map(self) -> Map:
        """Return the floor plan with the objects at their current places, without the bodies."""

    @abc.abstractmethod
    def state_hash(self) -> int:
        """Hash everything that decides the future to a uint64. Equal states have equal hashes on every machine."""

    def scene_hash(self) -> int:
        """Return the state's hash, without the number of steps taken if no rule depends on it."""
        return self.state_hash()

    @abc.abstractmethod
    def save(self) -> Any:
        """Return an exact copy of the state in mid-episode. The copy can be pickled."""

    @abc.abstractmethod
    def restore(self, saved: Any) -> None:
        """Restore a saved state. The copy is not consumed and may be restored again."""

    def check_actions(self, actions: Sequence[int]) -> None:
        """Check a joint action.

        Raises:
            WorldError: if there is not one action per body, or an action does not exist.
        """
        if len(actions) != self.bodies:
            raise WorldError(
                f"{len(actions)} actions were given, but the world has {self.bodies} bodies; give one per body"
            )
        for body, action in enumerate(actions):
            if not 0 <= action < len(self.action_names):
                raise WorldError(
                    f"action {action!r} of body {body} does not exist; actions are 0 to {len(self.action_names) - 1}"
                )

    def batch(self, num_worlds: int) -> "TeamBatch":
        """Return a batch of ``num_worlds`` worlds like this one, for training."""
        return TeamBatch(self, num_worlds)


class TeamBatch:
    """A batch of team worlds that are alike but for their seeds, stepped together.

    When an episode ends, the next one begins in the same step, and `observations` show its beginning.

    Args:
        world: the world that is copied; it is not used itself.
        num_worlds: the number of worlds in the batch.

    Attributes:
        observations: the observations of every body in every world, an array of shape (worlds, bodies, ...) that each
            step overwrites.
        ends: per world, whether the last step ended an episode, bool[worlds].
    """

    def __init__(self, world: TeamWorld, num_worlds: int) -> None:
        self.world = world
        self.num_worlds = check_whole("num_worlds", num_worlds, 1, 1_000_000)
        space = world.observation_space
        self.observations: NDArray[Any] = np.zeros((num_worlds, world.bodies, *space.shape), space.dtype)
        self.ends = np.zeros(num_worlds, np.bool_)
        self._worlds: list[TeamWorld] = []
        self._seeds = np.random.default_rng(0)

    def reset(self, seed: int) -> NDArray[Any]:
        """Begin an episode in every world, with seeds drawn from ``seed``; return the observations."""
        self._worlds = self._worlds or [copy.deepcopy(self.world) for _ in range(self.num_worlds)]
        self._seeds = np.random.default_rng(seed)
        for number, world in enumerate(self._worlds):
            world.reset(int(self._seeds.integers(2**63)))
            self._look(number)
        return self.observations

    def step(self, actions: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.bool_]]:
        """Make one joint step in each world.

        Args:
            actions: one action per world and body, int64[worlds, bodies].

        Returns:
            The observations, the rewards as float64[worlds, bodies], and per world whether its episode ended.
        """
        self.check_actions(actions)
        rewards = np.zeros(actions.shape)
        for number, (world, joint) in enumerate(zip(self._worlds, actions.tolist(), strict=True)):
            joint_step = world.step(joint)
            rewards[number] = joint_step.rewards
            self.ends[number] = joint_step.terminated or joint_step.truncated
            if self.ends[number]:
                world.reset(int(self._seeds.integers(2**63)))
            self._look(number)
        return self.observations, rewards, self.ends

    def check_actions(self, actions: NDArray[np.int64]) -> None:
        """Check the shape and type of the actions.

        Raises:
            WorldError: if the actions are not int64[worlds, bodies].
        """
        if actions.shape != (self.num_worlds, self.world.bodies) or actions.dtype != np.int64:
            raise WorldError(
                f"actions must be int64[{self.num_worlds}, {self.world.bodies}], not "
                f"{actions.dtype}{list(actions.shape)}"
            )

    def _look(self, number: int) -> None:
        """Update the observations of all bodies in one world."""
        for body in range(self.world.bodies):
            self.observations[number, body] = self._worlds[number].observation(body)


def find_team(world_id: str) -> Callable[..., TeamWorld] | None:
    """Return the function that makes a team world from its options; None if the id names no team world.

    The module in the id and that of the world are imported.
    """
    module, _, name = world_id.rpartition(":")
    if module:
        importlib.import_module(module)
    spec = gymnasium.registry.get(name)
    factory = None if spec is None else spec.entry_point
    if isinstance(factory, str):
        module_name, _, attribute = factory.partition(":")
        factory = getattr(importlib.import_module(module_name), attribute, None)
    if spec and isinstance(factory, type) and issubclass(factory, TeamWorld):
        return partial(factory, **spec.kwargs)
    return None


def make_team(world_id: str, **options: Any) -> TeamWorld:
    """Make a team world from its id: ``make_team("minihuman/Team-FourRooms-v0")``.

    A user's own team world is registered with Gymnasium like any other world. Its id has the module that registers it
    before a colon.

    Raises:
        WorldError: if there is no such world, it is not a team world, or it does not take an option.
    """
    try:
        make = find_team(world_id)
        if make is None:
            gymnasium.spec(world_id.rpartition(":")[2])  # raises Gymnasium's own error for an unknown id
            raise WorldError(f"{world_id} is not a team world; make it with gymnasium.make, or name a team world")
        return make(**options)
    except (ModuleNotFoundError, gymnasium.error.Error) as error:
        raise WorldError(f"{world_id}: {error}") from error
    except TypeError as error:
        raise WorldError(f"{world_id}: the options {options!r} are invalid: {error}") from error
