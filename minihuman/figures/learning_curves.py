"""Learning curves: a measure over the episodes, one line per group, with the confidence band of its mean.

The module imports SciPy only to compute a band, and never imports pandas, because the gallery imports this module.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from minihuman.figures.figure_data import are_shares, has_participant_lines
from minihuman.figures.style import SERIES, figure_style, new_figure
from minihuman.statistics.scores import wilson_interval

_DASHES = ("-", "--", ":", "-.")
_LONG_NAME = 14  # characters; with a longer group name, the legend has one column
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def mean_and_band(
    values: NDArray[np.float64], *, level: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean over participants, and the lower and upper limit of its t interval, each (episodes,).

    With fewer than two participants in an episode, its interval is NaN.

    Args:
        values: an array of shape (participants, episodes); NaN for a missing episode.
        level: the confidence level.
    """
    from scipy.special import stdtrit  # no figure of one session needs it

    counts = (~np.isnan(values)).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(values, axis=0) / counts
        spread = np.sqrt(np.nansum((values - mean) ** 2, axis=0) / (counts - 1)) / np.sqrt(counts)
        half = np.where(counts > 1, stdtrit(np.maximum(counts - 1, 1), 0.5 + level / 2) * spread, np.nan)
    return mean, mean - half, mean + half


def share_and_band(
    values: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the share of ones, and the lower and upper limit of its 95 % interval (Wilson), each (episodes,).

    All three are NaN in an episode without a value.

    Args:
        values: an array of 0, 1 and NaN, of shape (participants, episodes).
    """
    counts = (~np.isnan(values)).sum(axis=0)
    ones = np.nansum(values, axis=0)
    with np.errstate(invalid="ignore"):
        share = ones / counts
    low, high = np.array([wilson_interval(int(successes), int(n)) for successes, n in zip(ones, counts, strict=True)]).T
    is_empty = counts == 0
    return share, np.where(is_empty, np.nan, low), np.where(is_empty, np.nan, high)


def draw_learning(
    ax: Axes,
    curves: Mapping[str, NDArray[np.float64]],
    *,
    measure: str,
    level: float = 0.95,
    limits: tuple[float, float] | None = None,
    xlabel: str = "episode in the block",
    numbers: Sequence[int] | None = None,
) -> Axes:
    """Draw each group's mean over its participants against the episode in the block, or against ``numbers``.

    Means have bands at the confidence level ``level`` (Student's t), clipped to ``limits``. If all values are 0 or 1,
    and the measure has no other limits, means are shares with Wilson's 95 % intervals and no thin lines. Return ``ax``.

    Args:
        ax: the axes to draw on.
        curves: per group, an array of shape (participants, episodes); NaN for a missing episode.
        measure: the name of the measure.
        level: the confidence level of the bands.
        limits: the lowest and the highest possible value of the measure; None if it has no bounds.
        xlabel: the label of the horizontal axis.
        numbers: the positions of the episodes on the horizontal axis; by default 1, 2 and so on.
    """
    draws_shares = are_shares(curves, limits)
    has_lines = has_participant_lines(curves, limits)
    for index, (group, values) in enumerate(curves.items()):
        colour = SERIES[index % len(SERIES)]
        mean, low, high = share_and_band(values) if draws_shares else mean_and_band(values, level=level)
        low, high = _clip_band(low, high, limits)
        x = np.arange(1, values.shape[1] + 1) if numbers is None else np.asarray(numbers)
        if has_lines:
            ax.plot(x, values.T, color=colour, lw=0.4, alpha=0.35, gid=f"participant: {group}")
        line, marker = _DASHES[index % len(_DASHES)], _MARKERS[index % len(_MARKERS)]
        label = f"{group} (n = {len(values)})"
        ax.plot(x, mean, line, marker=marker, ms=3.2, color=colour, label=label)
        ax.fill_between(x, low, high, color=colour, alpha=0.18, lw=0, gid=f"band: {group}")
    ax.set(xlabel=xlabel, ylabel=measure)
    _set_limits(ax, limits)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2, ncols=_count_columns(curves))
    return ax


def _count_columns(groups: Collection[str]) -> int:
    """Return the number of columns of the legend: one if a group's name is long, else at most two."""
    if max(map(len, groups)) > _LONG_NAME:
        return 1
    return min(2, len(groups))


def _clip_band(
    low: NDArray[np.float64], high: NDArray[np.float64], limits: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and the upper edge of a band, clipped to the limits of the measure if it has any."""
    if limits is None:
        return low, high
    return np.clip(low, *limits), np.clip(high, *limits)


def _set_limits(ax: Axes, limits: tuple[float, float] | None) -> None:
    """Set the range of the vertical axis just beyond the limits of the measure, if it has finite limits."""
    if limits is not None and np.isfinite(limits).all():
        margin = 0.03 * (limits[1] - limits[0])
        ax.set_ylim(limits[0] - margin, limits[1] + margin)


def learning_figure(
    curves: Mapping[str, NDArray[np.float64]],
    *,
    measure: str,
    limits: tuple[float, float] | None = None,
    xlabel: str = "episode in the block",
    numbers: Sequence[int] | None = None,
    title: str = "",
) -> Figure:
    """Return a figure, one column wide, of one measure's learning curves; for the arguments, see ``draw_learning``."""
    with figure_style():
        figure = new_figure(height_cm=6.2 + 0.4 * len(title.splitlines()))
        figure.suptitle(title)
        draw_learning(figure.subplots(), curves, measure=measure, limits=limits, xlabel=xlabel, numbers=numbers)
    return figure
