"""The data that figures are drawn from: a measure by group and episode, a session's episodes by block. Draws nothing
and loads neither Matplotlib nor pandas.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import FrameShown, KeyPressed
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.session_log import EpisodeLog, SessionLog

if TYPE_CHECKING:
    import pandas as pd

_PANELS = 10  # episodes of one block in a session's figure


class Difference(NamedTuple):
    """The mean of the first group minus that of the second, with its 95 % interval; NaN where there is none."""

    first: str
    second: str
    estimate: float
    interval: tuple[float, float]


def name_measure(measure: str, block: str = "", *, width: int = 52) -> str:
    """A figure's title: the block and the measure, in lines that fit a column."""
    return "\n".join(wrap(f"Block {block}: {measure}" if block else measure[:1].upper() + measure[1:], width))


def collect_learning_curves(
    episodes: "pd.DataFrame", measure: str = "reward", *, order: Sequence[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """A measure by group, (participants, episodes in the block); NaN where no episode is included.

    ``episodes`` are one block's rows of the table "episodes" that are included. The first column is the block's first
    episode for every group; of several attempts at one the last is taken. A block of several sessions has a curve for
    each ("a, session 2"). Groups come in ``order``, or in that of the alphabet.
    """
    if episodes.empty:
        return {}
    numbers = range(1, int(episodes["episode_in_block"].max()) + 1)
    last = episodes.drop_duplicates(["participant", "session", "episode_in_block"], keep="last")
    values = last.assign(value=last[measure].astype(float)).groupby(["group", "session"])
    several = episodes["session"].nunique() > 1
    curves = {
        (str(group), session): part.pivot(index="participant", columns="episode_in_block", values="value")
        for (group, session), part in values
    }
    return {
        f"{group}, session {session}" if several else group: table.reindex(columns=numbers).to_numpy(np.float64)
        for group in order or sorted({group for group, _ in curves})
        for (its, session), table in curves.items()
        if its == group
    }


def group_by_block(log: SessionLog) -> list[tuple[str, Sequence[EpisodeLog]]]:
    """A session's blocks by name, in order of play, each with its first ten episodes: what its path figure shows."""
    blocks: dict[str, list[EpisodeLog]] = defaultdict(list)
    for episode in log.episodes:
        blocks[episode.plan.block_name].append(episode)
    return [(name, [strip_events(episode) for episode in theirs[:_PANELS]]) for name, theirs in blocks.items()]


def strip_events(episode: EpisodeLog) -> EpisodeLog:
    """The episode without its key presses and pictures, so that those of a thousand sessions can be held at once."""
    keys, frames = EventColumns.of(KeyPressed, ()), EventColumns.of(FrameShown, ())
    return replace(episode, keys=keys, frames=frames, observations=None)


def find_reward_limits(episodes: "pd.DataFrame") -> tuple[float, float] | None:
    """The bounds of a block's rewards, 0 and 1, which a band must not leave; None where a reward lies outside them."""
    return (0.0, 1.0) if episodes["reward"].dropna().between(0, 1).all() else None
