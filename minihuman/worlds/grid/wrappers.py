"""Wrappers: other observations, noisy actions and exploration bonuses for grid worlds.

Where Gymnasium has a wrapper there is none here: the image alone is ``TransformObservation(env, itemgetter("image"),
env.observation_space["image"])``, repeated actions are ``StickyAction``. Each wrapper declares the space its
observations lie in. What they compute is what Minigrid's of the same purpose compute, drawings apart.
"""

import abc
import math
from collections import Counter
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import View
from minihuman.worlds.grid.art.palettes import GridPalette
from minihuman.worlds.grid.art.pictures import draw
from minihuman.worlds.grid.core.cells import AGENT, COLOURS, DOOR_STATES, EMPTY, GOAL, KINDS
from minihuman.worlds.grid.core.view import see_all, see_size
from minihuman.worlds.grid.engine import GridEngine

Observation = dict[str, Any]
Step = tuple[Any, float, bool, bool, dict[str, Any]]
Env = gymnasium.Env[Any, int]


def grid_of(env: Env) -> GridEngine:
    """The grid world inside an environment.

    Raises:
        WorldError: if there is none.
    """
    if not isinstance(env.unwrapped, GridEngine):
        raise WorldError(f"{env} is no grid world of ours; make one of minihuman/MiniGrid-...")
    return env.unwrapped


class NewImage(gymnasium.ObservationWrapper[Observation, int, Observation], abc.ABC):
    """Base of wrappers that put another image into the observation."""

    def __init__(self, env: Env, space: spaces.Box) -> None:
        super().__init__(env)
        self.grid = grid_of(env)
        self.observation_space = spaces.Dict({**_parts(env), "image": space})

    @abc.abstractmethod
    def image(self, observation: Observation) -> NDArray[Any]:
        """The other image."""

    def observation(self, observation: Observation) -> Observation:
        """The observation with the other image."""
        return {**observation, "image": self.image(observation)}


class Pictures(NewImage):
    """Pixels: the agent's view or the whole world, ``tile_px`` on a side of a cell, uint8[H, W, 3]."""

    def __init__(
        self, env: Env, *, view: View = "partial", tile_px: int = 8, palette: GridPalette = "classic", lit: bool = True
    ) -> None:
        grid = grid_of(env)
        self.view, self.tile_px, self.palette, self.lit = view, tile_px, palette, lit
        columns, rows = grid.image_shape[:2] if view == "partial" else (grid.state.width, grid.state.height)
        super().__init__(env, spaces.Box(0, 255, (rows * tile_px, columns * tile_px, 3), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """The picture."""
        return draw(
            self.grid.state.row,
            view=self.view,
            view_size=self.grid.image_shape[0],
            tile_px=self.tile_px,
            palette=self.palette,
            kinds=self.grid.kinds,
            lit=self.lit,
        )


class OneHot(NewImage):
    """The image's kinds, colours and states as zeros and ones, uint8[size, size, 11 + 6 + 3].

    A world with kinds of its own has so many more.
    """

    def __init__(self, env: Env) -> None:
        size = _parts(env)["image"].shape
        assert size is not None
        self.lengths = len(KINDS) + len(grid_of(env).kinds), len(COLOURS), len(DOOR_STATES)
        super().__init__(env, spaces.Box(0, 1, (*size[:2], sum(self.lengths)), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """The image in zeros and ones."""
        kinds, colours, states = np.moveaxis(observation["image"], -1, 0)
        hot = (np.eye(length, dtype=np.uint8) for length in self.lengths)
        return np.concatenate([eye[part] for eye, part in zip(hot, (kinds, colours, states), strict=True)], axis=-1)


class FullyObserved(NewImage):
    """The whole grid instead of the view, uint8[width, height, 3]: kind, colour, state (of the agent: direction)."""

    def __init__(self, env: Env) -> None:
        state = grid_of(env).state
        super().__init__(env, spaces.Box(0, 255, (state.width, state.height, 3), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """The whole grid."""
        state = self.grid.state
        image = np.empty((state.width, state.height, 3), np.uint8)
        see_all(state.row, image)
        return image


class Symbolic(NewImage):
    """The whole grid as symbols, int64[width, height, 3]: column, row, kind; -1 for an empty cell."""

    def __init__(self, env: Env) -> None:
        state = grid_of(env).state
        low = np.zeros((state.width, state.height, 3), np.int64)
        low[..., 2] = -1
        high = np.empty_like(low)
        high[...] = state.width - 1, state.height - 1, AGENT + len(grid_of(env).kinds)
        super().__init__(env, spaces.Box(low, high, dtype=np.int64))

    def image(self, observation: Observation) -> NDArray[np.int64]:
        """The symbols."""
        state = self.grid.state
        columns, rows = np.mgrid[: state.width, : state.height]
        kinds = state.kinds
        kinds[kinds == EMPTY] = -1
        kinds[state.position] = AGENT
        return np.stack([columns, rows, kinds], axis=-1)


class ViewSize(NewImage):
    """The agent's view with another number of cells on a side, odd, 3 to 61."""

    def __init__(self, env: Env, size: int = 7) -> None:
        self.size = size
        see_size(size)
        super().__init__(env, spaces.Box(0, 255, (size, size, 3), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """The larger or smaller view."""
        return self.grid.look(self.size)


class Flat(gymnasium.ObservationWrapper[NDArray[np.uint8], int, Observation]):
    """One array of zeros, ones and cell numbers: the image, then the mission letter by letter.

    Letters are a to z, space and comma, each 28 numbers of which one is 1, up to ``letters`` of them.
    """

    ALPHABET = "abcdefghijklmnopqrstuvwxyz ,"

    def __init__(self, env: Env, letters: int = 96) -> None:
        super().__init__(env)
        image = _parts(env)["image"]
        assert image.shape is not None
        self.letters = letters
        length = math.prod(image.shape) + len(self.ALPHABET) * letters
        self.observation_space = spaces.Box(0, 255, (length,), np.uint8)
        self._mission, self._spelt = "", np.zeros(len(self.ALPHABET) * letters, np.uint8)

    def observation(self, observation: Observation) -> NDArray[np.uint8]:
        """Image and mission in one array."""
        if observation["mission"] != self._mission:
            self._mission, self._spelt = observation["mission"], self._spell(observation["mission"])
        return np.concatenate([observation["image"].ravel(), self._spelt])

    def _spell(self, mission: str) -> NDArray[np.uint8]:
        if len(mission) > self.letters:
            raise WorldError(f"mission {mission!r} has {len(mission)} letters; make Flat(env, letters={len(mission)})")
        spelt = np.zeros((self.letters, len(self.ALPHABET)), np.uint8)
        for place, letter in enumerate(mission.lower()):
            if letter not in self.ALPHABET:
                raise WorldError(f"mission {mission!r} has the letter {letter!r}; Flat spells a to z, space and comma")
            spelt[place, self.ALPHABET.index(letter)] = 1
        return spelt.ravel()


class GoalDirection(gymnasium.ObservationWrapper[Observation, int, Observation]):
    """Adds ``goal_direction``: where the goal is from the agent, a float64 without dimensions.

    Args:
        env: A grid world with a goal.
        measure: "angle_atan2" is an angle in radians, -pi to pi, 0 to the right, growing downwards; "slope" is down
            over right, infinite straight up and down, and "angle" its arc tangent: both give opposite directions
            the same number.
    """

    def __init__(self, env: Env, measure: Literal["slope", "angle", "angle_atan2"] = "slope") -> None:
        super().__init__(env)
        bounds = {"slope": np.inf, "angle": np.pi / 2, "angle_atan2": np.pi}
        if measure not in bounds:
            raise WorldError(f"{measure!r} is no measure of direction; there are {', '.join(bounds)}")
        self.grid, self.measure = grid_of(env), measure
        space = spaces.Box(-bounds[measure], bounds[measure], (), np.float64)
        self.observation_space = spaces.Dict({**_parts(env), "goal_direction": space})

    def observation(self, observation: Observation) -> Observation:
        """The observation with the goal's direction."""
        state = self.grid.state
        goals = np.argwhere(state.kinds.T == GOAL)
        if len(goals) == 0:
            raise WorldError(f"{self.grid} has no goal to point to; GoalDirection is for worlds with one")
        right, down = goals[0, 1] - state.position[0], goals[0, 0] - state.position[1]
        if self.measure == "angle_atan2" or (right == 0 and down == 0):
            direction = math.atan2(down, right)
        else:
            direction = down / right if right != 0 else math.copysign(math.inf, down)
            direction = math.atan(direction) if self.measure == "angle" else direction
        return {**observation, "goal_direction": np.array(direction)}


class StochasticAction(gymnasium.ActionWrapper[Any, int, int]):
    """Does what it is told with probability ``prob``, otherwise ``random_action``; None draws an action."""

    def __init__(self, env: Env, prob: float = 0.9, random_action: int | None = None) -> None:
        super().__init__(env)
        if not 0 <= prob <= 1:
            raise WorldError(f"prob is {prob!r}; a probability is 0 to 1")
        self.prob, self.random_action = prob, random_action

    def action(self, action: int) -> int:
        """The action that is done."""
        if self.np_random.random() < self.prob:
            return action
        assert isinstance(self.action_space, spaces.Discrete)
        return int(self.np_random.integers(self.action_space.n)) if self.random_action is None else self.random_action


class Bonus(gymnasium.Wrapper[Any, int, Any, int], abc.ABC):
    """Base of wrappers that add ``scale / sqrt(n)`` to the reward the n-th time something happens, in any episode.

    A person's episodes each begin with counts of 0, as every episode of theirs can be played again by itself.
    """

    def __init__(self, env: Env, scale: float = 1.0) -> None:
        super().__init__(env)
        self.grid, self.scale = grid_of(env), scale
        self.counts: Counter[tuple[Any, ...]] = Counter()

    @abc.abstractmethod
    def happened(self, action: int) -> tuple[Any, ...]:
        """What is counted, after the step."""

    def step(self, action: int) -> Step:
        """Act, and add the bonus."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        happened = self.happened(action)
        self.counts[happened] += 1
        bonus = self.scale / math.sqrt(self.counts[happened])
        return observation, float(reward) + bonus, terminated, truncated, info


class PositionBonus(Bonus):
    """A bonus for cells seldom visited."""

    def happened(self, action: int) -> tuple[Any, ...]:
        """The cell the agent is in."""
        return self.grid.state.position


class ActionBonus(Bonus):
    """A bonus for what is seldom done: an action that ends in a cell and direction."""

    def happened(self, action: int) -> tuple[Any, ...]:
        """The agent's cell and direction, and the action."""
        return (*self.grid.state.position, self.grid.state.direction, int(action))


def _parts(env: Env) -> dict[str, spaces.Space[Any]]:
    space = env.observation_space
    if not isinstance(space, spaces.Dict):
        raise WorldError(f"{env} observes {space}; wrap it before its image, direction and mission are taken apart")
    return dict(space.spaces)
