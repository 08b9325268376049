"""Is there room on the disk for another episode? Asked before each: a disk had better fill between episodes."""

import shutil
from pathlib import Path

from minihuman.errors import LogError
from minihuman.study.plan import EpisodePlan

STEP_BYTES = 2_048  # a step with its key events, frame and pose takes about 900 bytes live; twice that, to be safe
OBSERVATION_BYTES = 32_768  # a picture of 80 x 60 is in a live log twice, as PNG of up to 15,000 bytes
LONGEST_STEPS = 20_000  # nobody plays more in one episode, whatever limit the protocol sets
RESERVE_BYTES = 16 * 1024 * 1024  # for finishing the log, floor plans, and whatever else fills the disk meanwhile


def require_space(folder: Path, episode: EpisodePlan) -> None:
    """Make sure an episode of full length fits on a folder's disk.

    Raises:
        LogError: if it does not.
    """
    step_bytes = STEP_BYTES + episode.record_observations * OBSERVATION_BYTES
    needed = RESERVE_BYTES + min(episode.max_steps, LONGEST_STEPS) * step_bytes
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise LogError(
            f"{folder} has {free / 2**20:.1f} MiB free; episode {episode.episode + 1} needs {needed / 2**20:.1f} MiB: "
            "free some space, or choose another --data"
        )
