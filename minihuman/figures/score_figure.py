"""The scorecard's figure: each player's success, human-normalised score and relative efficiency with their intervals,
and success over the episodes of a block.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from minihuman.figures.style import MUTED, PAGE_CM, SERIES, figure_style, new_figure
from minihuman.statistics.scores import Estimate


@dataclass(frozen=True, slots=True)
class ScoreBar:
    """One player's values."""

    player: str
    success: Estimate
    normalised: Estimate
    relative_efficiency: Estimate
    success_by_episode: tuple[float, ...]  # share of successes, by episode


def score_figure(bars: Sequence[ScoreBar], *, reference: str) -> Figure:
    """Draw the scores of some players; the reference scores 1."""
    learns = any(len(bar.success_by_episode) > 1 for bar in bars)
    with figure_style():
        figure = new_figure(width_cm=PAGE_CM, height_cm=max(5.0, 2.2 + 0.62 * len(bars)))
        figure.suptitle(f"reference: {reference}", fontsize=7.0, x=0.01, ha="left")
        axes = figure.subplots(1, 3 + learns, width_ratios=[1, 1, 1, 1.1][: 3 + learns])
        draw_scores(axes[0], bars, "success", label="success", limits=(0, 1))
        draw_scores(axes[1], bars, "normalised", label="normalised score", mark=1.0)
        draw_scores(axes[2], bars, "relative_efficiency", label="relative efficiency", mark=1.0)
        for axis in axes[1:3]:
            axis.set_yticklabels([])
        if learns:
            draw_curves(axes[3], bars)
    return figure


def draw_scores(
    ax: Axes,
    bars: Sequence[ScoreBar],
    name: str,
    *,
    label: str,
    mark: float | None = None,
    limits: tuple[float, float] | None = None,
) -> Axes:
    """Draw one score of each player, the first on top; ``mark`` is the reference's."""
    if mark is not None:
        ax.axvline(mark, color=MUTED, lw=0.8, ls="--")
    for place, bar in enumerate(bars):
        one: Estimate = getattr(bar, name)
        colour = SERIES[place % len(SERIES)]
        ax.plot([one.low, one.high], [place, place], color=colour, lw=1.6, solid_capstyle="butt")
        ax.plot([one.value], [place], "o", ms=4, color=colour)
    ax.set_yticks(range(len(bars)), [bar.player for bar in bars])
    ax.set_ylim(len(bars) - 0.5, -0.5)
    ax.set_xlabel(label)
    if limits is not None:
        ax.set_xlim(limits[0] - 0.03, limits[1] + 0.03)
    return ax


def draw_curves(ax: Axes, bars: Sequence[ScoreBar]) -> Axes:
    """Draw each player's share of successes over the episodes of a block."""
    for place, bar in enumerate(bars):
        size = 5.0 - 3.0 * place / max(1, len(bars))  # those behind another still show
        colour = SERIES[place % len(SERIES)]
        ax.plot(
            np.arange(1, len(bar.success_by_episode) + 1),
            bar.success_by_episode,
            marker="os^DvPX"[place % 7],
            ms=size,
            color=colour,
        )
    ax.set(xlabel="episode in the block", ylabel="success", ylim=(-0.03, 1.03))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    return ax
