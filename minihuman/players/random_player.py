"""A player that knows nothing and learns nothing: any key of the pool, at any time."""

import numpy as np

from minihuman.players.port import Player, Press
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World


class RandomPlayer(Player):
    """Presses the keys that have an action, each as often as the others."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self._rng = rng
        self._keys: list[str] = []

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Find out which keys do something."""
        self._keys = sorted(plan.key_map.keys)

    def press(self, world: World) -> Press:
        """Any of them, 100 to 500 ms after the picture."""
        return Press(self._keys[self._rng.integers(len(self._keys))], self._rng.uniform(100.0, 500.0))
