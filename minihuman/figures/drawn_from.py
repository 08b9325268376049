"""What figures are drawn from: a measure by group and episode, a session's episodes by block. Nothing here draws."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.recorded.columns import EventColumns
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.study.events import FrameShown, KeyPressed

if TYPE_CHECKING:
    import pandas as pd

_PANELS = 10  # episodes of one block in a session's figure


def learning_curves(episodes: "pd.DataFrame", measure: str = "reward") -> dict[str, NDArray[np.float64]]:
    """A measure by group, (participants, episodes in the block); NaN where none counts.

    ``episodes`` are one block's rows of the table "episodes" that count. The first column is the block's first episode
    for every group; of several attempts at one the last is taken, of several sessions of a participant the mean.
    """
    if episodes.empty:
        return {}
    numbers = range(1, int(episodes["episode_in_block"].max()) + 1)
    curves = {}
    for group, part in episodes.groupby("group"):
        last = part.drop_duplicates(["participant", "session", "episode_in_block"], keep="last")
        table = (
            last.assign(value=last[measure].astype(float)).groupby(["participant", "episode_in_block"])["value"].mean()
        )
        curves[str(group)] = table.unstack().reindex(columns=numbers).to_numpy(np.float64)
    return curves


def session_blocks(log: SessionLog) -> list[tuple[str, Sequence[Episode]]]:
    """A session's blocks by name, in order of play, each with its first ten episodes: what its path figure shows."""
    blocks: dict[str, list[Episode]] = defaultdict(list)
    for episode in log.episodes:
        blocks[episode.plan.block_name].append(episode)
    return [(name, [light(episode) for episode in theirs[:_PANELS]]) for name, theirs in blocks.items()]


def light(episode: Episode) -> Episode:
    """The episode without its key presses and pictures, so that those of a thousand sessions can be held at once."""
    keys, frames = EventColumns.of(KeyPressed, ()), EventColumns.of(FrameShown, ())
    return replace(episode, keys=keys, frames=frames, observations=None)
