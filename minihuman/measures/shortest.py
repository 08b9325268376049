"""How few steps an episode could have taken, from its plan alone."""

import json
from functools import lru_cache
from typing import TYPE_CHECKING

from minihuman.study.plan import EpisodePlan
from minihuman.worlds.contract import Bounds

if TYPE_CHECKING:
    from minihuman.worlds.adapt.world import World


def shortest(plan: EpisodePlan) -> Bounds:
    """The fewest steps of an episode's world from its seed, turns counted, as far as the world can tell.

    Raises:
        WorldError: if the world cannot be made here.
    """
    return _of_layout(plan.world, json.dumps(plan.options, sort_keys=True, default=str), plan.seed)


@lru_cache(maxsize=100_000)
def _of_layout(world_id: str, options: str, seed: int) -> Bounds:
    world = _world(world_id, options)
    world.reset(seed)
    return world.bounds()


@lru_cache(maxsize=16)
def _world(world_id: str, options: str) -> "World":
    from minihuman.worlds.trust import trusting  # it brings Gymnasium: only needed where a world is asked

    return trusting()(world_id, json.loads(options))
