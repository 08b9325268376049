"""The participant's view: every picture of an episode, drawn again by its world and proved to be the one shown.

Where the world is gone or now shows something else, the pictures that the log holds stand in, if it holds any.
"""

from collections.abc import Iterator
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LogError, WorldError
from minihuman.log.observations import checked, is_picture
from minihuman.recorded.episode import Episode
from minihuman.worlds.adapt.world import World
from minihuman.worlds.trust import trusting

SIZE_PX = (240, 180)


def pictures(episode: Episode) -> list[NDArray[np.uint8]]:
    """The n + 1 pictures uint8[H, W, 3] of an episode, the reset's first: drawn again, else the stored observations.

    Each observation is compared with its hash in the log.

    Raises:
        LogError: at the first observation that differs from what the participant saw, if the log holds no pictures.
        WorldError: if the world cannot be run, and the log holds no pictures.
    """
    plan = episode.plan
    try:
        with closing(trusting()(plan.world, plan.options)) as world:
            return list(_redrawn(episode, world))
    except (LogError, WorldError):
        stored = episode.observations
        if stored is None or not is_picture(stored[0]):
            raise
        return list(checked(stored, episode.observation_hashes, plan.episode))


def _redrawn(episode: Episode, world: World) -> Iterator[NDArray[np.uint8]]:
    plan = episode.plan
    seen = world.reset(plan.seed).observation_hash
    for step in range(len(episode.actions) + 1):
        if step:
            seen = world.step(int(episode.actions[step - 1])).observation_hash
        if seen != int(episode.observation_hashes[step]):
            raise LogError(
                f"{episode.name} step {step}: {plan.world} now shows something else than was seen; "
                "replay without the view, or with the version of the world in the session's facts"
            )
        yield world.frame(plan.view, SIZE_PX, plan.palette)
