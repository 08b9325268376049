"""The port every player implements: it looks at the world and says which key it presses next, and how soon."""

import abc
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from minihuman.errors import PlayerError
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World


@dataclass(frozen=True, slots=True)
class Press:
    """A key, and how long after the picture came (or after the last key) it goes down."""

    key: str
    delay_ms: float


def way_of(world: World) -> list[str]:
    """Names of actions that lead to success from here; empty if there are none.

    Raises:
        PlayerError: if the world cannot tell.
    """
    way = world.way()
    if way is None:
        raise PlayerError(f"{world.id}: no planner knows its goal; let a 'random' player play it")
    return list(way)


class Player(abc.ABC):
    """Whoever presses the keys when no person does. It may look at the world but never steps it."""

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """An episode has started; ``pool`` is every key that may have an action."""

    @abc.abstractmethod
    def press(self, world: World) -> Press:
        """The next key, from the world as it is now."""


MakePlayer = Callable[[str, np.random.Generator], Player]  # from what follows the name's colon, and a stream of chance
