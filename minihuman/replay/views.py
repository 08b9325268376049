"""The participant's view: every picture of an episode, drawn again by its world and proved to be the one shown."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log.episode import Episode
from minihuman.worlds.adapt import World

SIZE_PX = (240, 180)


def redraw(episode: Episode, world: World, *, size_px: tuple[int, int] = SIZE_PX) -> Iterator[NDArray[np.uint8]]:
    """Yield the n + 1 pictures uint8[H, W, 3] of an episode, the reset's first.

    Each observation is compared with its hash in the log before its picture is yielded.

    Raises:
        LogError: at the first observation that differs from what the participant saw.
        WorldError: if the world cannot be run.
    """
    plan = episode.plan
    seen = world.reset(plan.seed).observation_hash
    for step in range(len(episode.actions) + 1):
        if step:
            seen = world.step(int(episode.actions[step - 1])).observation_hash
        if seen != int(episode.observation_hashes[step]):
            raise LogError(
                f"episode {plan.episode + 1}, step {step}: {plan.world} now shows something else than was seen; "
                "replay without the view, or with the version of the world in the session's facts"
            )
        yield world.frame(plan.view, size_px, plan.palette)
