"""The base of batches whose worlds' states are rows of a matrix that compiled code steps.

`RowVectorEnv` knows the spaces, the random stream of each world, and which worlds a reset begins anew; not what a row
holds, nor how a step changes it. `GridBatch` does not use it, because kernels are compiled from its module.
"""

from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.options import BatchSeeds, seeds_per_world
from minihuman.worlds.rng import RngState, read_rng_state, write_rng_state
from minihuman.worlds.vector_names import VectorNames

Observation = dict[str, Any]
SnapshotType = TypeVar("SnapshotType")


class RowVectorEnv(gymnasium.vector.VectorEnv[Observation, NDArray[np.int64], NDArray[Any]], VectorNames):
    """A batch of worlds that share their spaces, each with its own random stream.

    Args:
        world: a world with the batch's spaces, render mode and metadata.
        num_envs: the number of worlds.
        autoreset_mode: Gymnasium's name for the behaviour after an episode's end: "NextStep", "SameStep" or "Disabled".
    """

    _rows: NDArray[np.int32]  # int32[worlds, numbers]: the state of each world

    def __init__(self, world: Any, *, num_envs: int, autoreset_mode: AutoresetMode | str) -> None:
        self._world = world
        self._autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**world.metadata, "autoreset_mode": self._autoreset_mode}
        self.num_envs = num_envs
        self.render_mode = world.render_mode
        self.single_action_space = world.action_space
        self.single_observation_space = world.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._rng_states: RngState = np.zeros((num_envs, 6), np.uint64)
        self._seeds = [-1] * num_envs

    @property  # type: ignore[misc]  # Gymnasium's can be set
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Return a copy of each world's random generator. Drawing from it does not affect the world."""
        generators = tuple(np.random.default_rng(0) for _ in self._rng_states)
        for rng_state, generator in zip(self._rng_states, generators, strict=True):
            if rng_state.any():
                write_rng_state(rng_state, generator)
        return generators

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Return the seed that each world was last given or drew; -1 before its first reset."""
        return tuple(self._seeds)

    def _seed_worlds(self, seed: BatchSeeds, options: dict[str, Any] | None) -> NDArray[np.int64]:
        """Seed the random streams of the worlds that a reset begins anew, and return the numbers of these worlds.

        Raises:
            WorldError: if the reset mask is not one bool per world.
        """
        seeds = seeds_per_world(seed, self.num_envs)
        mask = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
                raise WorldError(
                    f"reset_mask has dtype {mask.dtype} and shape {mask.shape}; use bool and ({self.num_envs},)"
                )
        worlds = np.flatnonzero(mask)
        for i in worlds.tolist():
            if seeds[i] is not None or not self._rng_states[i].any():
                generator, self._seeds[i] = seeding.np_random(seeds[i])
                read_rng_state(generator, self._rng_states[i])
        return worlds

    def _check_actions(self, actions: ArrayLike) -> NDArray[np.int64]:
        """Return actions as an array of one whole number per world; whether the actions exist is not checked.

        Raises:
            WorldError: if they are not one whole number per world.
        """
        action_array = np.asarray(actions)
        if action_array.shape != (self.num_envs,) or action_array.dtype.kind not in "iu":
            raise WorldError(
                f"actions must be {self.num_envs} whole numbers, not {action_array.dtype}{action_array.shape}"
            )
        return np.ascontiguousarray(action_array, np.int64)

    def _build_refusal(self, world: int, action: int, *, is_new: bool, is_over: bool, last_action: int) -> WorldError:
        """Return the error for the action that the world with the number ``world`` cannot take.

        Args:
            world: the number of the world.
            action: the action.
            is_new: whether the world has not been reset yet.
            is_over: whether the world's episode has ended.
            last_action: the number of the last action that exists.
        """
        if is_new or (is_over and self._autoreset_mode is not AutoresetMode.NEXT_STEP):
            return WorldError(f"world {world} is not in an episode; call reset() before step()")
        return WorldError(f"action {action} does not exist in world {world}; actions are 0 to {last_action}")

    def _check_saved(self, saved: Any, kind: type[SnapshotType]) -> SnapshotType:
        """Return a saved state unchanged, after checking that a batch of this kind and size saved it.

        Raises:
            WorldError: if it did not.
        """
        if not isinstance(saved, kind) or saved.rows.shape != self._rows.shape:  # type: ignore[attr-defined]
            raise WorldError(f"this was not saved by a batch of {self.num_envs} such worlds; pass what save() returned")
        return saved

    def render(self) -> tuple[NDArray[np.uint8] | str | None, ...] | None:  # type: ignore[override]
        """Return the rendering of each world, a picture or a text, or None without a render mode."""
        if self.render_mode is None:
            return None
        return self.call("render")


def build_end_info(over: NDArray[np.bool_], observations: NDArray[Any]) -> dict[str, Any]:
    """Return the info with which Gymnasium's "SameStep" mode reports the last observations of ended episodes.

    ``over`` says which worlds' episodes ended, bool[n]; ``observations`` has their observations, and None elsewhere.
    """
    return {"final_obs": observations, "_final_obs": over, "final_info": {}, "_final_info": over.copy()}
