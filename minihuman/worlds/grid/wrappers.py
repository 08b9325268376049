"""Wrappers for grid worlds: other observations, noisy actions, exploration bonuses, fixed layouts, no death, tokens.

There is no wrapper here if Gymnasium has one: the image alone is `TransformObservation(env, itemgetter("image"),
env.observation_space["image"])`, repeated actions are `StickyAction`. Each wrapper declares the space of its
observations. Apart from drawings, the wrappers compute what Minigrid's wrappers of the same purpose compute. `Tokens`
gives missions as numbers of words, for libraries that cannot handle text.
"""

import abc
import math
from collections import Counter
from collections.abc import Iterable
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.contract import View
from minihuman.worlds.grid.core.cells import AGENT, DOOR_STATES, EMPTY, GOAL, KINDS, kind_of
from minihuman.worlds.grid.core.rewards import FORWARD, cell_in_front
from minihuman.worlds.grid.core.state import OVER, PHASE, PLAYING, STEP, X, Y
from minihuman.worlds.grid.core.view import see_all, see_size
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.missions import Sentences, words_in
from minihuman.worlds.grid.pictures.drawing import draw_grid
from minihuman.worlds.grid.pictures.tiles import GridPalette

Observation = dict[str, Any]
Step = tuple[Any, float, bool, bool, dict[str, Any]]
Env = gymnasium.Env[Any, int]


def grid_of(env: Env) -> GridEngine:
    """Return the grid world inside an environment.

    Raises:
        WorldError: if the environment is not a grid world.
    """
    if not isinstance(env.unwrapped, GridEngine):
        raise WorldError(f"{env} is not a minihuman grid world; wrap one such as minihuman/MiniGrid-Empty-8x8-v0")
    return env.unwrapped


class ImageWrapper(gymnasium.ObservationWrapper[Observation, int, Observation], abc.ABC):
    """Base class of wrappers that replace the image in the observation."""

    def __init__(self, env: Env, space: spaces.Box) -> None:
        super().__init__(env)
        self.grid = grid_of(env)
        self.observation_space = spaces.Dict({**_list_subspaces(env), "image": space})

    @abc.abstractmethod
    def image(self, observation: Observation) -> NDArray[Any]:
        """Return the image that replaces the image of an observation."""

    def observation(self, observation: Observation) -> Observation:
        """Return the observation with its image replaced."""
        return {**observation, "image": self.image(observation)}


class PictureObservation(ImageWrapper):
    """A wrapper that replaces the image by a picture of the agent's view or of the whole world, uint8[H, W, 3].

    A cell is ``tile_px`` pixels wide and high.
    """

    def __init__(
        self, env: Env, *, view: View = "partial", tile_px: int = 8, palette: GridPalette = "classic", lit: bool = True
    ) -> None:
        grid = grid_of(env)
        self.view = view
        self.tile_px = tile_px
        self.palette = palette
        self.lit = lit
        columns, rows = grid.image_shape[:2] if view == "partial" else (grid.state.width, grid.state.height)
        super().__init__(env, spaces.Box(0, 255, (rows * tile_px, columns * tile_px, 3), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """Return the picture, uint8[H, W, 3]."""
        return draw_grid(
            self.grid.state.row,
            view=self.view,
            view_size=self.grid.image_shape[0],
            tile_px=self.tile_px,
            palette=self.palette,
            kinds=self.grid.kinds,
            lit=self.lit,
        )


class OneHot(ImageWrapper):
    """A wrapper that encodes the image's kinds, colours and states as one-hot vectors, uint8[size, size, 11 + 6 + 3].

    Each kind of the world's own adds one more number per cell.
    """

    def __init__(self, env: Env) -> None:
        size = _list_subspaces(env)["image"].shape
        assert size is not None
        self.lengths = len(KINDS) + len(grid_of(env).kinds), len(COLOURS), len(DOOR_STATES)
        super().__init__(env, spaces.Box(0, 1, (*size[:2], sum(self.lengths)), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """Return the one-hot encoding of the image."""
        kinds, colours, states = np.moveaxis(observation["image"], -1, 0)
        one_hot_tables = (np.eye(length, dtype=np.uint8) for length in self.lengths)
        numbers = (kinds, colours, states)
        return np.concatenate([table[part] for table, part in zip(one_hot_tables, numbers, strict=True)], axis=-1)


class FullyObserved(ImageWrapper):
    """A wrapper that replaces the image by the whole grid, uint8[width, height, 3]: kind, colour, state.

    The state of the agent is its direction.
    """

    def __init__(self, env: Env) -> None:
        state = grid_of(env).state
        super().__init__(env, spaces.Box(0, 255, (state.width, state.height, 3), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """Return the whole grid, uint8[width, height, 3]."""
        state = self.grid.state
        image = np.empty((state.width, state.height, 3), np.uint8)
        see_all(state.row, image)
        return image


class Symbolic(ImageWrapper):
    """A wrapper that replaces the image by the grid as symbols, int64[width, height, 3]: column, row, kind.

    The kind of an empty cell is -1.
    """

    def __init__(self, env: Env) -> None:
        state = grid_of(env).state
        low = np.zeros((state.width, state.height, 3), np.int64)
        low[..., 2] = -1
        high = np.empty_like(low)
        high[...] = state.width - 1, state.height - 1, AGENT + len(grid_of(env).kinds)
        super().__init__(env, spaces.Box(low, high, dtype=np.int64))

    def image(self, observation: Observation) -> NDArray[np.int64]:
        """Return the whole grid as symbols, int64[width, height, 3]."""
        state = self.grid.state
        columns, rows = np.mgrid[: state.width, : state.height]
        kinds = state.kinds
        kinds[kinds == EMPTY] = -1
        kinds[state.position] = AGENT
        return np.stack([columns, rows, kinds], axis=-1)


class ViewSize(ImageWrapper):
    """A wrapper that replaces the agent's view by one with another number of cells on a side, odd, 3 to 61."""

    def __init__(self, env: Env, size: int = 7) -> None:
        self.size = size
        see_size(size)
        super().__init__(env, spaces.Box(0, 255, (size, size, 3), np.uint8))

    def image(self, observation: Observation) -> NDArray[np.uint8]:
        """Return the agent's view in the chosen size."""
        return self.grid.look(self.size)


class Flat(gymnasium.ObservationWrapper[NDArray[np.uint8], int, Observation]):
    """A wrapper that turns an observation into one array: the image's numbers, then the mission letter by letter.

    Letters are a to z, space and comma; each of up to ``letters`` letters is encoded as 28 numbers, one of which is 1.
    """

    ALPHABET = "abcdefghijklmnopqrstuvwxyz ,"

    def __init__(self, env: Env, letters: int = 96) -> None:
        super().__init__(env)
        image = _list_subspaces(env)["image"]
        assert image.shape is not None
        self.letters = letters
        length = math.prod(image.shape) + len(self.ALPHABET) * letters
        self.observation_space = spaces.Box(0, 255, (length,), np.uint8)
        self._mission = ""
        self._spelt = np.zeros(len(self.ALPHABET) * letters, np.uint8)

    def observation(self, observation: Observation) -> NDArray[np.uint8]:
        """Return the image and the mission in one array."""
        if observation["mission"] != self._mission:
            self._spelt = self._encode_letters(observation["mission"])
            self._mission = observation["mission"]
        return np.concatenate([observation["image"].ravel(), self._spelt])

    def _encode_letters(self, mission: str) -> NDArray[np.uint8]:
        """Return a mission as one-hot vectors of its letters, in one row, padded with zeros.

        Raises:
            WorldError: if the mission is too long, or has a character that is not in the alphabet.
        """
        if len(mission) > self.letters:
            raise WorldError(
                f"mission {mission!r} has {len(mission)} characters; use Flat(env, letters={len(mission)})"
            )
        spelt = np.zeros((self.letters, len(self.ALPHABET)), np.uint8)
        for index, letter in enumerate(mission.lower()):
            if letter not in self.ALPHABET:
                raise WorldError(
                    f"mission {mission!r} has the character {letter!r}; Flat encodes only a to z, space and comma"
                )
            spelt[index, self.ALPHABET.index(letter)] = 1
        return spelt.ravel()


class GoalDirection(gymnasium.ObservationWrapper[Observation, int, Observation]):
    """Adds ``goal_direction`` to the observation: the direction from the agent to the goal, a zero-dimensional float64.

    Args:
        env: a grid world with a goal.
        measure: "angle_atan2" for an angle in radians, -pi to pi, 0 to the right, growing downwards; "slope" for the
            distance down divided by the distance right, infinite straight up and down; "angle" for the arc tangent of
            the slope. The last two give opposite directions the same number.
    """

    def __init__(self, env: Env, measure: Literal["slope", "angle", "angle_atan2"] = "slope") -> None:
        super().__init__(env)
        bounds = {"slope": np.inf, "angle": np.pi / 2, "angle_atan2": np.pi}
        if measure not in bounds:
            raise WorldError(f"unknown direction measure {measure!r}; use one of {', '.join(bounds)}")
        self.grid = grid_of(env)
        self.measure = measure
        space = spaces.Box(-bounds[measure], bounds[measure], (), np.float64)
        self.observation_space = spaces.Dict({**_list_subspaces(env), "goal_direction": space})

    def observation(self, observation: Observation) -> Observation:
        """Return the observation with the direction of the goal added.

        Raises:
            WorldError: if the world has no goal now.
        """
        state = self.grid.state
        goals = np.argwhere(state.kinds.T == GOAL)
        if len(goals) == 0:
            raise WorldError(f"{self.grid} has no goal to point to; GoalDirection needs a world with one")
        right = goals[0, 1] - state.position[0]
        down = goals[0, 0] - state.position[1]
        if self.measure == "angle_atan2" or (right == 0 and down == 0):
            direction = math.atan2(down, right)
        else:
            if right != 0:
                direction = down / right
            else:
                direction = math.copysign(math.inf, down)
            if self.measure == "angle":
                direction = math.atan(direction)
        return {**observation, "goal_direction": np.array(direction)}


class StochasticAction(gymnasium.ActionWrapper[Any, int, int]):
    """A wrapper that takes the given action with probability ``prob``, otherwise ``random_action``.

    If ``random_action`` is None, it takes a random action instead.
    """

    def __init__(self, env: Env, prob: float = 0.9, random_action: int | None = None) -> None:
        super().__init__(env)
        if not 0 <= prob <= 1:
            raise WorldError(f"prob is {prob!r}; use a probability from 0 to 1")
        self.prob = prob
        self.random_action = random_action

    def action(self, action: int) -> int:
        """Return the given action with probability ``prob``, or else ``random_action`` or a random one."""
        if self.np_random.random() < self.prob:
            return action
        assert isinstance(self.action_space, spaces.Discrete)
        if self.random_action is None:
            return int(self.np_random.integers(self.action_space.n))
        return self.random_action


class ExplorationBonus(gymnasium.Wrapper[Any, int, Any, int], abc.ABC):
    """Base class of wrappers that add ``scale / sqrt(n)`` to the reward when an event occurs for the n-th time.

    Events are counted over all episodes. In a session, however, each episode begins with counts of 0, so that it can be
    replayed by itself.
    """

    def __init__(self, env: Env, scale: float = 1.0) -> None:
        super().__init__(env)
        self.grid = grid_of(env)
        self.scale = scale
        self.counts: Counter[tuple[Any, ...]] = Counter()

    @abc.abstractmethod
    def happened(self, action: int) -> tuple[Any, ...]:
        """Return the event to count after a step with ``action``; equal events are counted together."""

    def step(self, action: int) -> Step:
        """Take an action, and return what the environment returns, with the bonus added to the reward."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        event = self.happened(action)
        self.counts[event] += 1
        bonus = self.scale / math.sqrt(self.counts[event])
        return observation, float(reward) + bonus, terminated, truncated, info


class PositionBonus(ExplorationBonus):
    """A wrapper that adds a bonus for cells that were visited rarely."""

    def happened(self, action: int) -> tuple[Any, ...]:
        """Return the agent's cell."""
        return self.grid.state.position


class ActionBonus(ExplorationBonus):
    """A wrapper that adds a bonus for rare combinations of an action with the cell and direction in which it ended."""

    def happened(self, action: int) -> tuple[Any, ...]:
        """Return the agent's cell and direction, and the action."""
        return (*self.grid.state.position, self.grid.state.direction, int(action))


def _list_subspaces(env: Env) -> dict[str, spaces.Space[Any]]:
    """Return the spaces of an observation's parts by name; raise WorldError if it is no dict."""
    space = env.observation_space
    if not isinstance(space, spaces.Dict):
        raise WorldError(
            f"{env} has the observations {space}; apply this wrapper before any that changes their structure"
        )
    return dict(space.spaces)


class FixedSeeds(gymnasium.Wrapper[Any, int, Any, int]):
    """A wrapper that resets an environment with the given seeds in turn, over and over, so that layouts are fixed.

    Args:
        env: any environment.
        seeds: one or more seeds.
        first: the index of the seed of the first reset.
    """

    def __init__(self, env: Env, seeds: Iterable[int] = (0,), *, first: int = 0) -> None:
        super().__init__(env)
        self.seeds = tuple(seeds)
        if not self.seeds or any(isinstance(seed, bool) or not isinstance(seed, int) for seed in self.seeds):
            raise WorldError(f"seeds must be one or more whole numbers, not {self.seeds!r}")
        self._next = first % len(self.seeds)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode with the next seed; return its first observation and info.

        Raises:
            WorldError: if another seed is given.
        """
        next_seed = self.seeds[self._next]
        if seed is not None and seed != next_seed:
            raise WorldError(
                f"reset() was called with seed {seed}, but FixedSeeds uses {next_seed} next; call reset() without a "
                "seed"
            )
        self._next = (self._next + 1) % len(self.seeds)
        return self.env.reset(seed=next_seed, options=options)


class NoDeath(gymnasium.Wrapper[Any, int, Any, int]):
    """A wrapper that lets an episode continue, at a cost, where it would end without success.

    The agent then stays where it was.

    Args:
        env: a grid world.
        types: the kinds of cells that no longer end the episode: "lava", or any other kind that ends it when the agent
            walks into it.
        cost: the number that is added to the reward each time, 0 or less.
    """

    def __init__(self, env: Env, types: Iterable[str] = ("lava",), cost: float = -1.0) -> None:
        super().__init__(env)
        self.grid = grid_of(env)
        self.types = tuple(types)
        self.cost = cost
        for name in self.types:
            if name not in KINDS:
                raise WorldError(f"unknown kind {name!r}; use one of {', '.join(KINDS)}")
        if cost > 0:
            raise WorldError(f"cost is {cost!r}; it must be 0 or less")

    def step(self, action: int) -> Step:
        """Take an action as Gymnasium defines it; a step into one of the given kinds is undone at a cost."""
        row = self.grid.state.row
        x, y = cell_in_front(row)
        is_inside = 0 <= x < self.grid.state.width and 0 <= y < self.grid.state.height
        is_deadly = is_inside and KINDS[kind_of(int(self.grid.state.cells[x, y]))] in self.types
        cell = int(row[X]), int(row[Y])
        observation, reward, terminated, truncated, info = self.env.step(action)
        if not (terminated and is_deadly and action == FORWARD and float(reward) <= 0):
            return observation, float(reward), terminated, truncated, info
        row[X], row[Y] = cell
        row[PHASE] = OVER if truncated else PLAYING
        assert row[STEP] > 0
        observation = _observed(self.env)
        return observation, float(reward) + self.cost, False, truncated, info


def _observed(env: Any) -> Any:
    """Return the current observation of an environment as its observation wrappers change it."""
    if isinstance(env, GridEngine):
        return env.observation()
    inner = _observed(env.env)
    if isinstance(env, gymnasium.ObservationWrapper):
        return env.observation(inner)
    return inner


MAX_TOKEN_KINDS = 16  # the number of kinds for which a cell's code has space
PADDING = 0  # the token after a mission's last word


class Tokens(gymnasium.ObservationWrapper[dict[str, Any], int, dict[str, Any]]):
    """Replaces the mission by one number per word, int64[length], padded with zeros; ``words[i]`` has number ``i + 1``.

    The cells in the observation's image are declared as numbers of kinds, colours and states, so that no library takes
    them for pixels. ``PPO("MultiInputPolicy", Tokens(env))`` of Stable-Baselines3 learns on it.

    Args:
        env: an environment whose observations have a ``mission``.
        words: the words that have numbers; None for those of the world's own missions. Give the same words to all
            worlds that one agent is to play.
        length: the number of words of the longest mission; None for the longest of the world's missions.
    """

    def __init__(
        self, env: gymnasium.Env[dict[str, Any], int], *, words: Iterable[str] | None = None, length: int | None = None
    ) -> None:
        super().__init__(env)
        inner_space = env.observation_space
        if isinstance(inner_space, spaces.Dict):
            mission = inner_space.get("mission")
        else:
            mission = None
        if not isinstance(inner_space, spaces.Dict) or not isinstance(mission, Sentences):
            raise WorldError(
                f"{env} has the observations {inner_space}; wrap a world whose observations have a mission"
            )
        if words is None:
            self.words = mission.words
        else:
            self.words = tuple(dict.fromkeys(words))
        self._number = {word: number for number, word in enumerate(self.words, 1)}
        self.length = max(1, mission.most_words if length is None else length)
        tokens = spaces.Box(PADDING, max(1, len(self.words)), (self.length,), np.int64)
        parts: dict[str, spaces.Space[Any]] = {**inner_space.spaces, "mission": tokens}
        world = env.unwrapped
        if isinstance(world, GridEngine) and inner_space["image"] is dict(world.observation_space)["image"]:  # type: ignore[call-overload]
            highest = np.empty(world.image_shape, np.uint8)
            highest[...] = MAX_TOKEN_KINDS - 1, len(COLOURS) - 1, max(len(DOOR_STATES), 4) - 1
            parts["image"] = spaces.Box(np.zeros_like(highest), highest, dtype=np.uint8)
        self.observation_space = spaces.Dict(parts)

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Return the observation with the mission as tokens."""
        return {**observation, "mission": self.tokens(observation["mission"])}

    def tokens(self, mission: str) -> NDArray[np.int64]:
        """Return a mission as tokens, int64[length], padded with zeros.

        Raises:
            WorldError: if the sentence has a word without a number, or too many words.
        """
        mission_words = words_in(mission)
        if len(mission_words) > self.length:
            raise WorldError(
                f"mission {mission!r} has {len(mission_words)} words; use Tokens(env, length={len(mission_words)})"
            )
        tokens = np.full(self.length, PADDING, np.int64)
        for index, word in enumerate(mission_words):
            if word not in self._number:
                raise WorldError(
                    f"mission {mission!r} contains {word!r}, which Tokens does not know; use only "
                    f"{', '.join(self.words)}"
                )
            tokens[index] = self._number[word]
        return tokens
