"""The data that figures are drawn from (a measure by group and episode, a session's episodes by block), and figures as
files, drawn again only where these data have changed: each file's own metadata holds a digest of them.

Loads neither Matplotlib nor pandas unless a figure is drawn: drawing one takes half a second, of which its import is a
part.
"""

import importlib
from collections import defaultdict
from collections.abc import Sequence
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


_PANELS = 10  # episodes of one block in a session's figure


class Difference(NamedTuple):
    """The mean of the first group minus that of the second, with its 95 % interval; NaN where there is none."""

    first: str
    second: str
    estimate: float
    interval: tuple[float, float]


def name_measure(measure: str, block: str = "", *, width: int = 52) -> str:
    """Write a figure's title: the block and the measure, in lines that fit a column."""
    title = measure[:1].upper() + measure[1:]
    if block:
        title = f"Block {block}: {measure}"
    return "\n".join(wrap(title, width))


def collect_learning_curves(
    episodes: "pd.DataFrame", measure: str = "reward", *, order: Sequence[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Collect a measure by group, (participants, episodes in the block); NaN where no episode is included.

    ``episodes`` are one block's rows of the table "episodes" that are included. The first column is the block's first
    episode for every group; of several attempts at one the last is taken. A block of several sessions has a curve for
    each ("a, session 2"). Groups come in ``order``, or in that of the alphabet.
    """
    if episodes.empty:
        return {}
    numbers = range(1, int(episodes["episode_in_block"].max()) + 1)
    last = episodes.drop_duplicates(["participant", "session", "episode_in_block"], keep="last")
    values = last.assign(value=last[measure].astype(float)).groupby(["group", "session"])
    has_several_sessions = episodes["session"].nunique() > 1
    curves = {
        (str(group), session): part.pivot(index="participant", columns="episode_in_block", values="value")
        for (group, session), part in values
    }
    named = {}
    for group in order or sorted({group for group, _ in curves}):
        for (curve_group, session), table in curves.items():
            if curve_group == group:
                name = f"{group}, session {session}" if has_several_sessions else group
                named[name] = table.reindex(columns=numbers).to_numpy(np.float64)
    return named


def group_by_block(log: SessionLog) -> list[tuple[str, Sequence[EpisodeLog]]]:
    """Group a session's episodes by block, in order of play: the first ten of each, as its path figure shows them."""
    blocks: dict[str, list[EpisodeLog]] = defaultdict(list)
    for episode in log.episodes:
        blocks[episode.plan.block_name].append(episode)
    return [(name, [strip_events(episode) for episode in episodes[:_PANELS]]) for name, episodes in blocks.items()]


def strip_events(episode: EpisodeLog) -> EpisodeLog:
    """Remove an episode's key presses and pictures, so that those of a thousand sessions fit into memory."""
    keys = EventColumns.of(KeyPressed, ())
    frames = EventColumns.of(FrameShown, ())
    return replace(episode, keys=keys, frames=frames, observations=None)


def find_reward_limits(episodes: "pd.DataFrame") -> tuple[float, float] | None:
    """Return the bounds of a block's rewards, 0 and 1, that a band must not leave; None where a reward leaves them."""
    if episodes["reward"].dropna().between(0, 1).all():
        return (0.0, 1.0)
    return None


_LIBRARIES = ("matplotlib", "numpy", "scipy", "pillow", "fonttools")
_ENDS = {".png": b"IEND\xaeB`\x82", ".pdf": b"%%EOF\n"}  # a file that was cut off does not have it


def draw_figure_files(stem: Path, name: str, *values: object, **options: object) -> tuple[Path, Path]:
    """Write a figure as ``stem``.png and ``stem``.pdf unless both are there and show the same; the PNG comes first.

    Args:
        stem: the files' path without a suffix; the folder is made.
        name: the module below ``minihuman.figures`` and the function that draws, as ``estimation.estimation_figure``.
        values: the function's arguments: texts, numbers, arrays, dataclasses and collections of them.
        options: its keyword arguments.

    Raises:
        TypeError: if a value cannot be encoded, as no digest could tell it from others.
    """
    digest = digest_figure(name, values, options)
    png, pdf = (stem.with_name(f"{stem.name}{suffix}") for suffix in _ENDS)
    if not (_holds(png, digest) and _holds(pdf, digest)):
        from minihuman.figures.style import save_figure

        module, _, function = name.partition(".")
        draw = getattr(importlib.import_module(f"minihuman.figures.{module}"), function)
        save_figure(draw(*values, **options), stem, digest=digest)
    return png, pdf


def digest_figure(name: str, values: Sequence[object], options: dict[str, Any]) -> str:
    """Digest all that a figure follows from: its data and options, our code, and the libraries that draw it."""
    encoded = msgspec.msgpack.encode((_describe_software(), name, values, options), enc_hook=_encode)
    return blake2b(encoded, digest_size=16).hexdigest()


@cache
def _describe_software() -> tuple[str, ...]:
    return digest_sources(), *(version(library) for library in _LIBRARIES)


def _holds(path: Path, digest: str) -> bool:
    """Say whether a file is whole and has that digest in its metadata."""
    if not path.is_file():
        return False
    content = path.read_bytes()
    return digest.encode() in content and content.endswith(_ENDS[path.suffix])


def _encode(value: Any) -> object:
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Sequence):  # of our own: columns of a log
        return list(value)
    raise TypeError(f"a figure's data contain a {type(value).__qualname__}, which has no digest; use plain values")
