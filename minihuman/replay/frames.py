"""The frames that the participant saw: redrawn by the episode's world and checked against the logged hashes.

Where the world is gone or now shows something else, the frames in the log are used, if it holds any. Kept apart
from `scene` because the Python interface uses it without loading rerun.
"""

from collections.abc import Iterator
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LogError, WorldError
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.observations import is_picture, verify_observations
from minihuman.worlds.adapters.world import World

SIZE_PX = (240, 180)


def render_frames(episode: EpisodeLog) -> list[NDArray[np.uint8]]:
    """The n + 1 pictures uint8[H, W, 3] of an episode, the reset's first: drawn again, else the stored observations.

    Each observation is compared with its hash in the log.

    Raises:
        LogError: at the first observation that differs from what the participant saw, if the log holds no pictures.
        WorldError: if the world cannot be run, and the log holds no pictures.
    """
    plan = episode.plan
    try:
        with closing(World(plan.world, plan.options)) as world:
            return list(_redrawn(episode, world))
    except (LogError, WorldError):
        stored = episode.observations
        if stored is None or not is_picture(stored[0]):
            raise
        return list(verify_observations(stored, episode.observation_hashes, plan.episode))


def _redrawn(episode: EpisodeLog, world: World) -> Iterator[NDArray[np.uint8]]:
    plan = episode.plan
    seen = world.reset(plan.seed).observation_hash
    for step in range(len(episode.actions) + 1):
        if step:
            seen = world.step(int(episode.actions[step - 1])).observation_hash
        if seen != int(episode.observation_hashes[step]):
            raise LogError(
                f"{episode.name} step {step}: {plan.world} no longer shows what the participant saw; "
                "replay without the view, or with the world's version of the session"
            )
        yield world.frame(plan.view, SIZE_PX, plan.palette)
