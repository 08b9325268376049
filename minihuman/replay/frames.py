"""The frames that the participant saw, redrawn by the episode's world and checked against the logged hashes.

If the world is no longer available or shows something else, the frames stored in the log are used, if there are any.
The module is separate from `rerun_scene` because the Python interface uses it without loading rerun.
"""

from collections.abc import Iterator
from contextlib import closing

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.errors import LogError, WorldError
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.observations import is_picture, verify_observations
from minihuman.worlds.adapters.world import World

SIZE_PX = (240, 180)
BACKGROUND = "#24272c"


def render_partner_frames(episode: EpisodeLog, seat: int) -> list[NDArray[np.uint8]]:
    """Return the pictures of an episode, uint8[H, W, 3], redrawn as the participant in ``seat`` of the team saw them.

    The first is that of the reset, followed by one for each of the team's steps; only the reset's if the episode has
    no team. They are not checked.

    Raises:
        WorldError: if the world cannot be run.
    """
    plan = episode.plan
    with closing(World(plan.world, {**episode.world_options, "seat": seat})) as world:
        world.reset(plan.seed)
        pictures = [world.frame(plan.view, SIZE_PX, plan.palette)]
        if episode.team is None:
            return pictures
        for actions in episode.team.actions:
            world.step(int(actions[seat]))
            pictures.append(world.frame(plan.view, SIZE_PX, plan.palette))
        return pictures


def render_frames(episode: EpisodeLog, size_px: tuple[int, int] = SIZE_PX) -> list[NDArray[np.uint8]]:
    """Return an episode's pictures, uint8[H, W, 3], redrawn if possible and otherwise as stored in the log.

    The first is the reset's, followed by one for each step. Redrawn pictures fit within ``size_px``, width and height.
    Each observation is compared with its hash in the log.

    Raises:
        LogError: at the first observation that differs from what the participant saw, if the log has no pictures, or
            at the first picture in the log that differs from its hash.
        WorldError: if the world cannot be run, and the log has no pictures.
    """
    plan = episode.plan
    try:
        with closing(World(plan.world, episode.world_options)) as world:
            return list(_redraw_pictures(episode, world, size_px))
    except (LogError, WorldError):
        stored = episode.observations
        if stored is None or not is_picture(stored[0]):
            raise
        return list(verify_observations(stored, episode.observation_hashes, plan.episode))


def _redraw_pictures(episode: EpisodeLog, world: World, size_px: tuple[int, int]) -> Iterator[NDArray[np.uint8]]:
    """Play an episode again in its world, and yield the picture of each state, the reset's first.

    Raises:
        LogError: if an observation of the world differs from the logged one.
        WorldError: if the world cannot be run.
    """
    plan = episode.plan
    observation_hash = world.reset(plan.seed).observation_hash
    for step, logged_hash in enumerate(episode.observation_hashes.tolist()):
        if step > 0:
            observation_hash = world.step(episode.actions_taken[step - 1]).observation_hash
        if observation_hash != logged_hash:
            raise LogError(
                f"{episode.name} step {step}: {plan.world} no longer shows what the participant saw; "
                "replay without --view, or install the version of the world that the session used"
            )
        yield world.frame(plan.view, size_px, plan.palette)


def fit_picture(picture: NDArray[np.uint8], size_px: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a picture centred on a dark background of ``size_px``, width and height, scaled down if it is larger."""
    width, height = size_px
    image = Image.fromarray(picture)
    image.thumbnail(size_px)
    canvas = Image.new("RGB", size_px, BACKGROUND)
    canvas.paste(image, ((width - image.width) // 2, (height - image.height) // 2))
    return np.asarray(canvas)
