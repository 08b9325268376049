"""A player that knows its keys and takes the shortest way: the yardstick for everyone else."""

import numpy as np

from minihuman.errors import PlayerError
from minihuman.players.port import Player, Press, way_of
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World

DELAY_MS = 250.0


class OptimalPlayer(Player):
    """Follows one plan from reset to goal, and plans again where the world did not do as planned."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self._key_of: dict[str, str] = {}
        self._way: list[str] = []

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Forget the last way."""
        self._key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._way = []

    def press(self, world: World) -> Press:
        """The next key of the way.

        Raises:
            PlayerError: if there is no way, or it needs an action without a key.
        """
        if not self._way:
            self._way = way_of(world)
        if not self._way:
            raise PlayerError(f"{world.id}: there is no way to the goal from {world.pose()}")
        action = self._way.pop(0)
        if action not in self._key_of:
            raise PlayerError(
                f"{world.id}: the way needs {action!r}, which has no key; it has {', '.join(self._key_of)}"
            )
        return Press(self._key_of[action], DELAY_MS)
