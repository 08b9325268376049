"""The data that figures are drawn from, and figures as files.

The data are a measure by group and episode, or a session's episodes by block. A file is drawn again only if its data
have changed: its metadata contains a digest of them. Importing this module loads neither Matplotlib nor pandas; they
are imported only when a figure is drawn, which takes half a second with the import.
"""

import importlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.dataset.caches import digest_sources
from minihuman.experiment.machine.events import FrameShown, KeyPressed
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.session_log import EpisodeLog, SessionLog

if TYPE_CHECKING:
    import pandas as pd

MOST_LINES = 12  # participants of the largest group; with more, thin lines of each would hide each other


_PANELS = 10  # episodes of one block in a session's figure


class Difference(NamedTuple):
    """The first group's mean minus the second's, with its 95 % interval, which is NaN if there is none."""

    first: str
    second: str
    estimate: float
    interval: tuple[float, float]


def name_measure(measure: str, block: str = "", *, width: int = 52) -> str:
    """Return a figure's title in lines of at most ``width`` characters: the measure, after the block if it is given."""
    title = measure[:1].upper() + measure[1:]
    if block:
        title = f"Block {block}: {measure}"
    return "\n".join(wrap(title, width))


def collect_learning_curves(
    episodes: "pd.DataFrame", measure: str = "reward", *, order: Sequence[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Return a measure per group as arrays (participants, episodes in the block); {} without episodes.

    A value is NaN if the episode is not included. For every group the first column is the first episode of the block.
    If an episode was attempted several times, the last attempt counts. A block of several sessions has a curve for each
    ("a, session 2").

    Args:
        episodes: the included rows of one block in the table "episodes".
        measure: the column of the measure.
        order: the order of the groups; by default, the alphabetical order.
    """
    if episodes.empty:
        return {}
    numbers = range(1, int(episodes["episode_in_block"].max()) + 1)
    last = episodes.drop_duplicates(["participant", "session", "episode_in_block"], keep="last")
    values = last.assign(value=last[measure].astype(float)).groupby(["group", "session"])
    has_several_sessions = episodes["session"].nunique() > 1
    tables = {
        (str(group), session): rows.pivot(index="participant", columns="episode_in_block", values="value")
        for (group, session), rows in values
    }
    curves = {}
    for group in order or sorted({group for group, _ in tables}):
        for (table_group, session), table in tables.items():
            if table_group == group:
                name = f"{group}, session {session}" if has_several_sessions else group
                curves[name] = table.reindex(columns=numbers).to_numpy(np.float64)
    return curves


def group_by_block(log: SessionLog) -> list[tuple[str, Sequence[EpisodeLog]]]:
    """Return the first ten episodes of each block of a session, by block in the order of play.

    They are the episodes of the session's figure of paths; their key presses and pictures are removed.
    """
    blocks: dict[str, list[EpisodeLog]] = defaultdict(list)
    for episode in log.episodes:
        blocks[episode.plan.block_name].append(episode)
    return [(name, [strip_events(episode) for episode in episodes[:_PANELS]]) for name, episodes in blocks.items()]


def strip_events(episode: EpisodeLog) -> EpisodeLog:
    """Return an episode without its key presses and pictures, so that a thousand sessions fit into memory."""
    keys = EventColumns.of(KeyPressed, ())
    frames = EventColumns.of(FrameShown, ())
    return replace(episode, keys=keys, frames=frames, observations=None)


def find_reward_limits(episodes: "pd.DataFrame") -> tuple[float, float] | None:
    """Return the limits of a block's rewards, (0, 1), to which a band is clipped; None if a reward exceeds them."""
    if episodes["reward"].dropna().between(0, 1).all():
        return (0.0, 1.0)
    return None


_LIBRARIES = ("matplotlib", "numpy", "scipy", "pillow", "fonttools")
_ENDS = {".png": b"IEND\xaeB`\x82", ".pdf": b"%%EOF\n"}  # a file that was cut off does not have it


def draw_figure_files(stem: Path, name: str, *values: object, **options: object) -> tuple[Path, Path]:
    """Write a figure as ``stem``.png and ``stem``.pdf, unless both files exist and show the same data.

    Args:
        stem: the path of the files without suffix; the folder is created if necessary.
        name: the module below ``minihuman.figures`` and the function that draws the figure, such as
            ``estimation.estimation_figure``.
        values: the positional arguments of the function: texts, numbers, arrays, dataclasses and collections of them.
        options: the keyword arguments of the function.

    Returns:
        The paths of the PNG and the PDF file.

    Raises:
        TypeError: if an argument cannot be encoded, so that no digest could distinguish it from others.
    """
    digest = digest_figure(name, values, options)
    png, pdf = (stem.with_name(f"{stem.name}{suffix}") for suffix in _ENDS)
    if not (_has_digest(png, digest) and _has_digest(pdf, digest)):
        from minihuman.figures.style import save_figure

        module, _, function = name.partition(".")
        draw = getattr(importlib.import_module(f"minihuman.figures.{module}"), function)
        save_figure(draw(*values, **options), stem, digest=digest)
    return png, pdf


def digest_figure(name: str, values: Sequence[object], options: dict[str, Any]) -> str:
    """Return a digest of everything that determines a figure: its data and options, minihuman's code, and libraries.

    Args:
        name: the module below ``minihuman.figures`` and the function that draws the figure.
        values: the positional arguments of the function.
        options: the keyword arguments of the function.

    Raises:
        TypeError: if an argument cannot be encoded.
    """
    encoded = msgspec.msgpack.encode((_describe_software(), name, values, options), enc_hook=_encode_for_digest)
    return blake2b(encoded, digest_size=16).hexdigest()


@cache
def _describe_software() -> tuple[str, ...]:
    return digest_sources(), *(version(library) for library in _LIBRARIES)


def _has_digest(path: Path, digest: str) -> bool:
    """Return whether a file is complete and has the given digest in its metadata."""
    if not path.is_file():
        return False
    content = path.read_bytes()
    return digest.encode() in content and content.endswith(_ENDS[path.suffix])


def _encode_for_digest(value: Any) -> object:
    """Return a part of a figure's data as plain values that can be encoded.

    Raises:
        TypeError: if the part is neither an array or number of NumPy nor a sequence.
    """
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Sequence):  # such as the columns of a log's events
        return list(value)
    raise TypeError(f"a figure's data contain a {type(value).__qualname__}, which has no digest; use plain values")


def _are_all_zero_or_one(curves: Mapping[str, NDArray[np.float64]]) -> bool:
    """Return whether every value of every group that is not missing is 0 or 1."""
    return all(np.isin(values[~np.isnan(values)], (0, 1)).all() for values in curves.values())


def are_shares(curves: Mapping[str, NDArray[np.float64]], limits: tuple[float, float] | None) -> bool:
    """Return whether means of curves are shares: all values are 0 or 1, and the measure has no other limits."""
    return limits in (None, (0, 1)) and _are_all_zero_or_one(curves)


def has_participant_lines(curves: Mapping[str, NDArray[np.float64]], limits: tuple[float, float] | None) -> bool:
    """Return whether learning curves show a thin line per participant: if these are few and the means are no shares."""
    return are_few(curves) and not are_shares(curves, limits)


def are_few(groups: Mapping[str, NDArray[np.float64]]) -> bool:
    """Return whether no group has more than ``MOST_LINES`` participants, so that each can have a thin line.

    The participants are the first axis of a group's array.
    """
    return max(map(len, groups.values())) <= MOST_LINES
