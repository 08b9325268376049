"""A simulated supervisor: watches an agent play, takes over when it wastes time, hands back when it is on its way.

What it knows is what an exploring expert knows: what was seen so far. With ``knows_all`` it is the planner's way.
"""

from dataclasses import dataclass

import numpy as np

from minihuman.players.exploring import Searcher
from minihuman.players.port import way_of
from minihuman.worlds.adapt.world import World


@dataclass(frozen=True, slots=True)
class Supervising:
    """What sets one supervisor apart. Delays are ex-Gaussian, as people's reaction times are."""

    patience_steps: int = 4  # takes over when the agent is so many steps worse than it would have been itself
    least_steps: int = 4  # that it steers before it hands back
    mu_ms: float = 400.0  # from noticing to the key: the normal part's mean
    sigma_ms: float = 60.0  # its standard deviation
    tau_ms: float = 180.0  # the exponential part's mean
    knows_all: bool = False  # the whole world, not only what was seen


class Supervisor:
    """Watches one episode after the other. Ask ``way`` once after the reset and once after every step, whoever made it.

    The agent is so many steps worse as its steps and the way that is left now exceed the way that was left when
    something new came into sight last, or the supervisor handed back. So looking round a new corner costs nothing,
    going to and fro costs a step each.
    """

    def __init__(self, supervising: Supervising, rng: np.random.Generator) -> None:
        self._is = supervising
        self._rng = rng
        self._searcher: Searcher | None = None
        self._way: list[str] = []
        self._left = 0  # steps of the way when counting began
        self._made = 0  # steps made since
        self._begun = False  # whether counting has begun in this episode
        self._due_ms: float | None = None  # when the key will go down
        self._steered = 0

    def begin(self, world: World) -> None:
        """An episode has started: the agent steers."""
        self._searcher = None if self._is.knows_all else Searcher(world)
        self._way, self._begun, self._due_ms, self._steered = [], False, None, 0

    def way(self, world: World) -> list[str]:
        """Look at the world, and say what it would do from here as far as it knows; empty where it knows nothing."""
        more = False
        if self._searcher is None:
            self._way = way_of(world)
        else:
            seen = self._searcher.seen_cells
            self._way = list(self._searcher.way())
            more = self._searcher.seen_cells > seen
        self._made += 1
        if more or not self._begun:
            self._count_anew()
        return self._way

    @property
    def patience_steps(self) -> int:
        """How many steps worse the agent may be."""
        return self._is.patience_steps

    @property
    def worse_steps(self) -> int:
        """How many steps the agent is worse than the supervisor would have been."""
        return self._made + len(self._way) - self._left

    @property
    def has_seen_enough(self) -> bool:
        """Whether the agent is so much worse that it would do something about it, and knows what."""
        return bool(self._way) and self.worse_steps >= self._is.patience_steps

    def takes_over(self, t_ms: float) -> bool:
        """Whether its key is down by this time, the agent steering."""
        if self._due_ms is None and self.has_seen_enough:
            normal = self._rng.normal(self._is.mu_ms, self._is.sigma_ms)
            self._due_ms = t_ms + max(0.0, float(normal + self._rng.exponential(self._is.tau_ms)))
        if self._due_ms is None or t_ms < self._due_ms:
            return False
        self._due_ms, self._steered = None, 0
        return bool(self._way)

    def hands_back(self) -> bool:
        """Whether it has steered enough; asked after each of its own steps, once it has looked at what came of it."""
        self._steered += 1
        if self._steered < self._is.least_steps:
            return False
        self._count_anew()
        return True

    def _count_anew(self) -> None:
        self._left, self._made, self._begun = len(self._way), 0, True
