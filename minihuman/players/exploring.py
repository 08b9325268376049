"""A player that knows its keys and the rules, and does what is said on what it has seen alone."""

import numpy as np

from minihuman.errors import PlayerError
from minihuman.players.port import Player, Press
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World
from minihuman.worlds.grid.engine import GridEngine

DELAY_MS = 250.0


class Searcher:
    """The exploring expert in one episode of a grid world, in action names."""

    def __init__(self, world: World) -> None:
        from minihuman.worlds.grid.instructions.explorer import Explorer  # compiled: only where it is used

        env = world.unwrapped
        if not isinstance(env, GridEngine):
            raise PlayerError(f"{world.id}: the exploring player knows grid worlds alone; let another player play it")
        self._env = env
        self._explorer = Explorer(env.state, env.image_shape[0])

    @property
    def seen_cells(self) -> int:
        """How many cells of the grid were in sight so far."""
        return int(self._explorer.memory.seen.sum())

    def way(self) -> list[str]:
        """What to do from here, as far as it is decided."""
        return [self._env.action_names[action] for action in self._explorer.way(self._env.state)]


class ExploringPlayer(Player):
    """Looks for what it has not seen yet, and does what is said once it knows how."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self._key_of: dict[str, str] = {}
        self._searcher: Searcher | None = None

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Look around for the first time."""
        self._key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._searcher = Searcher(world)

    def press(self, world: World) -> Press:
        """The next key.

        Raises:
            PlayerError: if nothing is left to try, or it needs an action without a key.
        """
        assert self._searcher is not None, "begin() comes first"
        way = self._searcher.way()
        if not way:
            raise PlayerError(f"{world.id}: all that can be seen has been seen, and there is no way to do what is said")
        if way[0] not in self._key_of:
            raise PlayerError(f"{world.id}: it needs {way[0]!r}, which has no key; it has {', '.join(self._key_of)}")
        return Press(self._key_of[way[0]], DELAY_MS)
