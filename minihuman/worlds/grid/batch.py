"""GridBatch: many worlds of one kind in one call. Its states are a matrix, one row a world, stepped in one kernel.

Each world of a batch is the world it would be alone: same layouts, draws, observations, rewards and ends.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numba import njit
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.chance import Words, read_words
from minihuman.worlds.grid.env import GridEnv
from minihuman.worlds.grid.pictures import draw
from minihuman.worlds.grid.rules import TERMINATED, TRUNCATED, act
from minihuman.worlds.grid.state import (
    ACTIONS,
    DIRECTION,
    FAILED,
    MISSION,
    NEW,
    OVER,
    PHASE,
    PLAYING,
    Row,
    State,
    clear,
)
from minihuman.worlds.grid.view import see

Observation = dict[str, Any]  # image uint8[n, size, size, 3], direction int64[n], mission: n strings


class GridBatch(gymnasium.vector.VectorEnv[Observation, NDArray[np.int64], NDArray[Any]]):
    """A batch of ``num_envs`` worlds of a family, all alike but for their seeds.

    Args:
        family: One of ``families.FAMILIES``.
        num_envs: How many worlds.
        autoreset_mode: What happens after an episode's end, in Gymnasium's words: "NextStep", "SameStep" or "Disabled".
        options: What `GridEnv` takes.
    """

    def __init__(
        self,
        family: str,
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise WorldError(f"num_envs is {num_envs!r}; a batch has 1 world or more")
        self._world = GridEnv(family, **options)  # what all have in common: spaces, recipe, settings
        self._autoreset = AutoresetMode(autoreset_mode)
        self.metadata = {**self._world.metadata, "autoreset_mode": self._autoreset}
        self.num_envs = num_envs
        self.render_mode = self._world.render_mode
        self.single_action_space = self._world.action_space
        self.single_observation_space = self._world.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._rows = np.tile(self._world.state.row, (num_envs, 1))
        self._words: Words = np.zeros((num_envs, 6), np.uint64)
        self._seeded = False
        self._lenient = self._autoreset is AutoresetMode.NEXT_STEP  # a step may find worlds over, and resets them
        self._missions = [self._world.mission] * num_envs

    @property
    def states(self) -> list[State]:
        """The state of each world, readable by name."""
        return [State(row) for row in self._rows]

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Lay out new episodes, of all worlds or of those in ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i``, or ``seed[i]``; without one it goes on drawing.
        """
        seeds = (
            [None if seed is None else seed + i for i in range(self.num_envs)] if not isinstance(seed, list) else seed
        )
        if len(seeds) != self.num_envs:
            raise WorldError(f"{len(seeds)} seeds for {self.num_envs} worlds; give one for each, or a single number")
        mask = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
                raise WorldError(f"reset_mask is {mask.dtype}{mask.shape}; it is bool({self.num_envs},)")
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None or not self._seeded:
                read_words(seeding.np_random(seeds[i])[0], self._words[i])
            self._lay_out(i)
        self._seeded = True
        return self._observe(), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Act in every world.

        Raises:
            WorldError: if the actions are not one number a world in range, before `reset`, and, where autoreset is
                disabled, after an episode's end. No world has been changed then.
        """
        given = np.asarray(actions)
        if given.shape != (self.num_envs,) or given.dtype.kind not in "iu":
            raise WorldError(f"actions are {given.dtype}{given.shape}; they are {self.num_envs} whole numbers")
        n = self.num_envs
        images = np.empty((n, *self._world.image_shape), np.uint8)
        directions = np.empty(n, np.int64)
        rewards = np.empty(n)
        ends = np.empty((2, n), np.bool_)  # terminated, truncated
        over = np.empty(n, np.bool_)  # before this step
        refused = step_many(
            self._rows, given.astype(np.int64), self._words, self._lenient, images, directions, rewards, ends, over
        )
        if refused >= 0:
            raise self._refusal(refused, given)
        terminated, truncated = ends
        info: dict[str, Any] = {}
        if self._autoreset is AutoresetMode.SAME_STEP:
            over = terminated | truncated
            if over.any():
                info = self._final(np.flatnonzero(over), images, directions)
        if over.any():
            for i in np.flatnonzero(over).tolist():
                self._lay_out(i)
                see(self._rows[i], images[i])
                directions[i] = self._rows[i, DIRECTION]
        return (
            {"image": images, "direction": directions, "mission": tuple(self._missions)},
            rewards,
            terminated,
            truncated,
            info,
        )

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of each world from above; None without a render mode."""
        if self.render_mode is None:
            return None
        size = self._world.image_shape[0]
        world = self._world
        return tuple(
            draw(row, view="full", view_size=size, tile_px=world.tile_size, palette=world.palette) for row in self._rows
        )

    def _refusal(self, world: int, actions: NDArray[np.integer[Any]]) -> WorldError:
        phase, count = self._rows[world, PHASE], self._rows[world, ACTIONS]
        if phase == NEW or (phase == OVER and not self._lenient):
            return WorldError(f"world {world} is not in an episode; call reset() before step()")
        return WorldError(f"action {actions[world]!r} of world {world} is none of its; they are 0 to {count - 1}")

    def _lay_out(self, i: int) -> None:
        row = self._rows[i]
        clear(row)
        self._world.recipe.lay_out(row, self._words[i])
        if row[FAILED]:
            raise WorldError(f"world {i} of {self._world} found no free place for something it lays out")
        row[PHASE] = PLAYING
        if self._world.mission_space.choices:
            self._missions[i] = self._world.mission_space.sentence(row[MISSION:FAILED].tolist())

    def _observe(self) -> Observation:
        images = np.empty((self.num_envs, *self._world.image_shape), np.uint8)
        for row, image in zip(self._rows, images, strict=True):
            see(row, image)
        directions = self._rows[:, DIRECTION].astype(np.int64)
        return {"image": images, "direction": directions, "mission": tuple(self._missions)}

    def _final(
        self, over: NDArray[np.int64], images: NDArray[np.uint8], directions: NDArray[np.int64]
    ) -> dict[str, Any]:
        observations = np.full(self.num_envs, None, object)
        for i in over.tolist():
            observations[i] = {
                "image": images[i].copy(),
                "direction": int(directions[i]),
                "mission": self._missions[i],
            }
        mask = np.zeros(self.num_envs, np.bool_)
        mask[over] = True
        return {"final_obs": observations, "_final_obs": mask, "final_info": {}, "_final_info": mask.copy()}


@njit(cache=True)
def step_many(
    rows: Row,
    actions: NDArray[np.int64],
    words: Words,
    lenient: bool,
    images: NDArray[np.uint8],
    directions: NDArray[np.int64],
    rewards: NDArray[np.float64],
    ends: NDArray[np.bool_],
    over: NDArray[np.bool_],
) -> int:
    """Step every world that is in an episode; those that are over earn nothing and are left to be reset.

    Returns:
        -1, or the first world that refuses its action or, unless ``lenient``, is over; then none was stepped.
    """
    for i in range(len(rows)):
        phase = rows[i, PHASE]
        over[i] = phase == OVER
        ready = phase == PLAYING or (lenient and phase == OVER)
        if not ready or actions[i] < 0 or actions[i] >= rows[i, ACTIONS]:
            return i
    for i in range(len(rows)):
        rewards[i] = 0.0
        ends[0, i] = ends[1, i] = False
        if not over[i]:
            status, rewards[i] = act(rows[i], actions[i], words[i])
            ends[0, i] = status & TERMINATED != 0
            ends[1, i] = status & TRUNCATED != 0
            see(rows[i], images[i])
            directions[i] = rows[i, DIRECTION]
    return -1
