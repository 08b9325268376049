"""Wrappers for fixed layouts and for learning without dying: `Seeds` and `NoDeath`."""

from collections.abc import Iterable
from typing import Any

import gymnasium

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import KINDS, kind_of
from minihuman.worlds.grid.core.state import OVER, PHASE, PLAYING, STEP, X, Y
from minihuman.worlds.grid.core.tasks import FORWARD, front
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.wrappers import Env, Step, grid_of


class Seeds(gymnasium.Wrapper[Any, int, Any, int]):
    """Resets with the given seeds, one after the other, over and over: layouts that are fixed.

    Args:
        env: Any environment.
        seeds: One or more.
        first: The place of the first reset's seed among them.
    """

    def __init__(self, env: Env, seeds: Iterable[int] = (0,), *, first: int = 0) -> None:
        super().__init__(env)
        self.seeds = tuple(seeds)
        if not self.seeds or any(isinstance(seed, bool) or not isinstance(seed, int) for seed in self.seeds):
            raise WorldError(f"seeds are {self.seeds!r}; give one whole number or more")
        self._next = first % len(self.seeds)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode with the next seed.

        Raises:
            WorldError: if another seed is given.
        """
        mine = self.seeds[self._next]
        if seed is not None and seed != mine:
            raise WorldError(f"seed {seed} is given, and Seeds resets with {mine} next; give none")
        self._next = (self._next + 1) % len(self.seeds)
        return self.env.reset(seed=mine, options=options)


class NoDeath(gymnasium.Wrapper[Any, int, Any, int]):
    """What would end the episode without success does not: it costs something and the agent stays where it was.

    Args:
        env: A grid world.
        types: What does not kill: "lava", and whatever else ends an episode when the agent walks into it.
        cost: Added to the reward each time; 0 or less.
    """

    def __init__(self, env: Env, types: Iterable[str] = ("lava",), cost: float = -1.0) -> None:
        super().__init__(env)
        self.grid, self.types, self.cost = grid_of(env), tuple(types), cost
        for name in self.types:
            if name not in KINDS:
                raise WorldError(f"{name!r} is no kind of thing; there are {', '.join(KINDS)}")
        if cost > 0:
            raise WorldError(f"cost is {cost!r}; it is 0 or less")

    def step(self, action: int) -> Step:
        """Act; walking into what is named costs, and is undone."""
        row = self.grid.state.row
        x, y = front(row)
        inside = 0 <= x < self.grid.state.width and 0 <= y < self.grid.state.height
        deadly = inside and KINDS[kind_of(int(self.grid.state.cells[x, y]))] in self.types
        place = int(row[X]), int(row[Y])
        observation, reward, terminated, truncated, info = self.env.step(action)
        if not (terminated and deadly and action == FORWARD and float(reward) <= 0):
            return observation, float(reward), terminated, truncated, info
        row[X], row[Y] = place
        row[PHASE] = OVER if truncated else PLAYING
        assert row[STEP] > 0
        observation = _observed(self.env)
        return observation, float(reward) + self.cost, False, truncated, info


def _observed(env: Any) -> Any:
    """What an environment with its wrappers would observe now."""
    if isinstance(env, GridEngine):
        return env.observation()
    inner = _observed(env.env)
    return env.observation(inner) if isinstance(env, gymnasium.ObservationWrapper) else inner
