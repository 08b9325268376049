"""FirstPersonBatch: many first-person worlds of one kind in one call, their pictures drawn on all cores.

Each world of a batch is the world it would be alone.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.batch_seeds import Seeds, seeds_of
from minihuman.worlds.first_person.env import FirstPersonEnv

Stepped = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class FirstPersonBatch(gymnasium.vector.VectorEnv[Any, NDArray[np.int64], NDArray[Any]]):
    """A batch of ``num_envs`` worlds, all alike but for their seeds.

    Args:
        make: makes one of them.
        num_envs: how many.
        autoreset_mode: what happens after an episode's end, in Gymnasium's words: "NextStep", "SameStep", "Disabled".
        threads: how many pictures are drawn at once; None for one a core.
    """

    _pool: ThreadPoolExecutor | None = None  # made when something is to be drawn; closed even where __init__ raised

    def __init__(
        self,
        make: Callable[[], FirstPersonEnv],
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
    ) -> None:
        if num_envs < 1:
            raise WorldError(f"num_envs is {num_envs}; a batch has 1 world or more")
        self.worlds = [make() for _ in range(num_envs)]
        first = self.worlds[0]
        self._autoreset = AutoresetMode(autoreset_mode)
        self.metadata = {**first.metadata, "autoreset_mode": self._autoreset}
        self.num_envs = num_envs
        self.render_mode = first.render_mode
        self.single_action_space = first.action_space
        self.single_observation_space = first.observation_space
        self.action_space = batch_space(first.action_space, num_envs)
        self.observation_space = batch_space(first.observation_space, num_envs)
        self._over = np.zeros(num_envs, np.bool_)  # in the step before
        self._threads = threads or os.cpu_count() or 1

    @property  # type: ignore[misc]  # Gymnasium's can be set; Gymnasium's own vectors give one a world too
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Each world's random stream."""
        return tuple(world.np_random for world in self.worlds)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed each world was last given, or drew; -1 before its first reset."""
        return tuple(-1 if (seed := world._np_random_seed) is None else seed for world in self.worlds)

    def reset(self, *, seed: Seeds = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes, in all worlds or in those of ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i``, or ``seed[i]``; without one it goes on drawing.
        """
        seeds = seeds_of(seed, self.num_envs)
        chosen = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            chosen = np.asarray(options["reset_mask"])
            if chosen.shape != (self.num_envs,) or chosen.dtype != np.bool_:
                raise WorldError(f"reset_mask is {chosen.dtype}{chosen.shape}; it is bool({self.num_envs},)")
        for i in np.flatnonzero(chosen).tolist():
            self.worlds[i].begin(seed=seeds[i])
            self._over[i] = False
        return self._observe(), self._infos(np.ones(self.num_envs, np.bool_))

    def step(self, actions: ArrayLike) -> Stepped:
        """Act in every world.

        Raises:
            WorldError: if the actions are not one number a world in range, before ``reset``, and, where autoreset is
                disabled, after an episode's end. No world has been changed then.
        """
        given = np.asarray(actions)
        if given.shape != (self.num_envs,) or given.dtype.kind not in "iu":
            raise WorldError(f"actions are {given.dtype}{given.shape}; they are {self.num_envs} whole numbers")
        for world, action in zip(self.worlds, given.tolist(), strict=True):
            world.check(action)
        if self._autoreset is AutoresetMode.DISABLED and self._over.any():
            raise WorldError(f"world {int(np.argmax(self._over))} is over; reset it with options['reset_mask'] first")
        renewed = self._over.copy() if self._autoreset is AutoresetMode.NEXT_STEP else np.zeros_like(self._over)
        rewards = np.zeros(self.num_envs)
        ends = np.zeros((2, self.num_envs), np.bool_)  # terminated, truncated
        for i, (world, action) in enumerate(zip(self.worlds, given.tolist(), strict=True)):
            if renewed[i]:
                world.begin()
            else:
                rewards[i], ends[0, i], ends[1, i] = world.advance(action)
        self._over = ends[0] | ends[1]
        final: dict[str, Any] = {}
        if self._autoreset is AutoresetMode.SAME_STEP and self._over.any():
            final = self._final()
            for i in np.flatnonzero(self._over).tolist():
                self.worlds[i].begin()
            self._over = np.zeros_like(self._over)
        return self._observe(), rewards, ends[0], ends[1], self._infos(np.ones(self.num_envs, np.bool_)) | final

    def render(self) -> tuple[NDArray[np.uint8] | None, ...] | None:  # type: ignore[override]
        """What each world renders; None without a render mode."""
        return (
            None if self.render_mode is None else tuple(self._painters.map(lambda world: world.render(), self.worlds))
        )

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_pool": None}

    @property
    def _painters(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="painter")
        return self._pool

    def _observe(self) -> Any:
        space = self.single_observation_space
        batch: Any = create_empty_array(space, self.num_envs)
        alone = type(self.worlds[0]).observe is FirstPersonEnv.observe  # a picture and nothing else: drawn in its place
        draw = (lambda i: self.worlds[i].see(batch[i])) if alone else (lambda i: self.worlds[i].observe())
        # each thread draws neighbours, so that it is asked once and not for every world
        ends = [self.num_envs * nth // self._threads for nth in range(self._threads + 1)]
        shares = [range(first, last) for first, last in pairwise(ends) if first < last]
        others = [self._painters.submit(lambda share: list(map(draw, share)), share) for share in shares[1:]]
        seen = list(map(draw, shares[0]))
        for other in others:
            seen += other.result()
        return batch if alone else concatenate(space, seen, batch)

    def _infos(self, of: NDArray[np.bool_]) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for i in np.flatnonzero(of).tolist():
            infos = self._add_info(infos, self.worlds[i].info(), i)
        return infos

    def _final(self) -> dict[str, Any]:
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(self._over).tolist():
            observations[i] = self.worlds[i].observe()
        over = self._over.copy()
        return {"final_obs": observations, "_final_obs": over, "final_info": self._infos(over), "_final_info": over}
