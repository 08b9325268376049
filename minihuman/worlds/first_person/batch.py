"""FirstPersonBatch: many first-person worlds of one kind in one call, their pictures drawn on all cores.

Each world of a batch is the world it would be alone. Also how Gymnasium makes the worlds of the catalogue, one or many.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.render.drawing import RenderTarget
from minihuman.worlds.first_person.render.render_pool import RenderPool
from minihuman.worlds.options import BatchSeeds, seeds_per_world

Stepped = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class FirstPersonBatch(gymnasium.vector.VectorEnv[Any, NDArray[np.int64], NDArray[Any]]):
    """A batch of ``num_envs`` worlds, all alike but for their seeds.

    Args:
        make: makes one of them.
        num_envs: how many.
        autoreset_mode: what happens after an episode's end, in Gymnasium's words: "NextStep", "SameStep", "Disabled".
        threads: how many pictures are drawn at once; None for one per core.
    """

    _pool: ThreadPoolExecutor | None = None  # made when something is to be drawn; closed even where __init__ raised
    _render_pool: RenderPool | None = None  # the same

    def __init__(
        self,
        make: Callable[[], FirstPersonEnv],
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
    ) -> None:
        if num_envs < 1:
            raise WorldError(f"num_envs is {num_envs}; use 1 or more")
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

    @property  # type: ignore[misc]  # Gymnasium's can be set; Gymnasium's own vectors give one per world too
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Each world's random stream."""
        return tuple(world.np_random for world in self.worlds)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed each world was last given, or drew; -1 before its first reset."""
        return tuple(-1 if (seed := world._np_random_seed) is None else seed for world in self.worlds)

    def reset(self, *, seed: BatchSeeds = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes, in all worlds or in those of ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i``, or ``seed[i]``; without one it goes on drawing.
        """
        seeds = seeds_per_world(seed, self.num_envs)
        chosen = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            chosen = np.asarray(options["reset_mask"])
            if chosen.shape != (self.num_envs,) or chosen.dtype != np.bool_:
                raise WorldError(f"reset_mask is {chosen.dtype}{chosen.shape}; it must be bool({self.num_envs},)")

        def begin(i: int) -> None:
            if chosen[i]:
                self.worlds[i].begin(seed=seeds[i])
                self._over[i] = False

        return self._observed(begin)

    def step(self, actions: ArrayLike) -> Stepped:
        """Act in every world.

        Raises:
            WorldError: if the actions are not one number per world in range, before ``reset``, and, where autoreset is
                disabled, after an episode's end. No world has been changed then.
        """
        given = np.asarray(actions)
        if given.shape != (self.num_envs,) or given.dtype.kind not in "iu":
            raise WorldError(f"actions must be {self.num_envs} whole numbers, not {given.dtype}{given.shape}")
        for world, action in zip(self.worlds, given.tolist(), strict=True):
            world.check(action)
        if self._autoreset is AutoresetMode.DISABLED and self._over.any():
            raise WorldError(
                f"the episode of world {int(np.argmax(self._over))} is over; reset it with options['reset_mask'] first"
            )
        renewed = self._over.copy() if self._autoreset is AutoresetMode.NEXT_STEP else np.zeros_like(self._over)
        rewards = np.zeros(self.num_envs)
        ends = np.zeros((2, self.num_envs), np.bool_)  # terminated, truncated
        final: dict[int, tuple[Any, dict[str, Any]]] = {}  # of worlds that begin anew in this step

        action_of, again = given.tolist(), self._autoreset is AutoresetMode.SAME_STEP

        def act(i: int) -> None:
            world = self.worlds[i]
            if renewed[i]:
                world.begin()
                return
            rewards[i], ends[0, i], ends[1, i] = world.advance(action_of[i])
            if again and (ends[0, i] or ends[1, i]):
                final[i] = world.observe(), world.info()
                world.begin()

        observations, infos = self._observed(act)
        over = ends[0] | ends[1]
        self._over = np.zeros_like(over) if again else over
        return observations, rewards, ends[0], ends[1], infos | self._final(final)

    def render(self) -> tuple[NDArray[np.uint8] | None, ...] | None:  # type: ignore[override]
        """What each world renders; None without a render mode."""
        return (
            None if self.render_mode is None else tuple(self._painters.map(lambda world: world.render(), self.worlds))
        )

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads go."""
        for kept in (self._pool, self._render_pool):
            if kept is not None:
                kept.shutdown()
        self._pool = self._render_pool = None

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_pool": None, "_render_pool": None}

    @property
    def _painters(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="painter")
        return self._pool

    def _observed(self, act: Callable[[int], None]) -> tuple[Any, dict[str, Any]]:
        """Call ``act`` for each world's number; observations and infos afterwards."""
        kind = type(self.worlds[0])
        if kind.observe is not FirstPersonEnv.observe or kind.see is not FirstPersonEnv.see or self.num_envs == 1:
            for i in range(self.num_envs):
                act(i)
            return self._apart(), self._infos()
        infos: dict[str, Any] = {}

        def aim_target() -> Iterator[RenderTarget]:
            for i, world in enumerate(self.worlds):
                act(i)
                yield world.aim_target()
            infos.update(self._infos())

        if self._render_pool is None:
            self._render_pool = RenderPool(self.num_envs, self._threads)
        batch: Any = create_empty_array(self.single_observation_space, self.num_envs, np.empty)
        self._render_pool.paint(aim_target(), batch)
        return batch, infos

    def _apart(self) -> Any:
        """The observations of worlds that say themselves what they are: more than a picture, or another."""
        space = self.single_observation_space
        # each thread takes neighbours, so that it is asked once and not for every world
        ends = [self.num_envs * nth // self._threads for nth in range(self._threads + 1)]
        shares = [self.worlds[first:last] for first, last in pairwise(ends) if first < last]
        others = [self._painters.submit(_observe, share) for share in shares[1:]]
        seen = _observe(shares[0])
        for other in others:
            seen += other.result()
        batch: Any = create_empty_array(space, self.num_envs)
        return concatenate(space, seen, batch)

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for i, world in enumerate(self.worlds):
            infos = self._add_info(infos, world.info(), i)
        return infos

    def _final(self, of: dict[int, tuple[Any, dict[str, Any]]]) -> dict[str, Any]:
        if not of:
            return {}
        observations, over = np.full(self.num_envs, None, object), np.zeros(self.num_envs, np.bool_)
        infos: dict[str, Any] = {}
        for i, (observation, info) in of.items():
            observations[i], over[i] = observation, True
            infos = self._add_info(infos, info, i)
        return {"final_obs": observations, "_final_obs": over, "final_info": infos, "_final_info": over}


def _observe(worlds: list[FirstPersonEnv]) -> list[Any]:
    return [world.observe() for world in worlds]


_BATCH_SETTINGS = frozenset({"num_envs", "autoreset_mode", "threads"})


_MOVED_LAYOUTS = {  # as data sets that were exported earlier name them
    "transfer:GoToObj": "layouts.go_to_obj:GoToObj",
    "layouts.sidewalk:Sidewalk": "layouts.connected_rooms:Sidewalk",
}


def make_world(layout: str, **options: Any) -> FirstPersonEnv:
    """The world that a module of this package describes: ``make_world("layouts.mazes:Maze", num_rows=3)``."""
    module, _, name = _MOVED_LAYOUTS.get(layout, layout).partition(":")
    world: FirstPersonEnv = getattr(import_module(f"minihuman.worlds.first_person.{module}"), name)(**options)
    return world


def make_batch(layout: str, **options: Any) -> FirstPersonBatch:
    """A batch of such worlds, for ``gymnasium.make_vec``."""
    settings = {name: options.pop(name) for name in _BATCH_SETTINGS & options.keys()}
    return FirstPersonBatch(lambda: make_world(layout, **options), **settings)


vars(make_world)["metadata"] = FirstPersonEnv.metadata  # where Gymnasium looks which render modes it has to add
