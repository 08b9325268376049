"""Figures of trials: every participant's value in every condition, joined by lines, with each condition's mean."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from minihuman.figures.style import MUTED, PAGE_CM, SERIES, figure_style, label_panel, new_figure

Values = NDArray[np.float64]
_GROUP_OFFSET = 0.16  # between the means of two groups in one condition, of the distance between conditions
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def draw_conditions(
    ax: Axes,
    groups: Sequence[tuple[str, Values]],
    conditions: Sequence[str],
    *,
    measure: str,
    limits: tuple[float, float] | None = None,
) -> Axes:
    """Draw every participant's line over the conditions, and each group's means with 95 % intervals; return ``ax``.

    Args:
        ax: the axes to draw on.
        groups: the name and the values of each group, (participants, conditions); NaN where there is no value.
        conditions: the names of the conditions.
        measure: the name of the measure.
        limits: the lowest and the highest possible value of the measure; None if it has no bounds.
    """
    from minihuman.figures.learning_curves import mean_and_band

    centres = np.arange(len(conditions))
    for number, (name, values) in enumerate(groups):
        colour = SERIES[number % len(SERIES)]
        shift = (number - (len(groups) - 1) / 2) * _GROUP_OFFSET
        ax.plot(centres + shift, values.T, color=colour, lw=0.5, alpha=0.35, marker=".", ms=2.5, gid=f"people: {name}")
        means, lows, highs = mean_and_band(values)
        if limits:
            lows = np.clip(lows, *limits)
            highs = np.clip(highs, *limits)
        errors = np.nan_to_num(np.stack([means - lows, highs - means]))
        marker = _MARKERS[number % len(_MARKERS)]
        ax.errorbar(
            centres + shift, means, errors, color="black", mfc=colour, mec="black", marker=marker, ms=5,
            lw=1.2, capsize=2, zorder=3, label=f"{name} (n = {len(values)})",
        )  # fmt: skip
    ax.set_xticks(centres, [str(condition) for condition in conditions])
    ax.set(xlim=(-0.5, len(conditions) - 0.5), ylabel=measure)
    if limits:
        ax.axhline(limits[1], color=MUTED, lw=0.4)
    return ax


def condition_figure(
    panels: Sequence[tuple[str, Sequence[tuple[str, Values]], tuple[float, float] | None]],
    conditions: Sequence[str],
    *,
    label: str,
    title: str,
) -> Figure:
    """Return a figure, a page wide, with one panel per measure.

    Args:
        panels: per measure, its name, the groups' values as in ``draw_conditions``, and its limits or None.
        conditions: the names of the conditions.
        label: the name of the label that distinguishes the conditions, for the horizontal axis.
        title: the title of the figure, which names the block and the label.
    """
    with figure_style():
        figure = new_figure(width_cm=PAGE_CM, height_cm=7.4)
        figure.suptitle(title)
        axes = np.atleast_1d(figure.subplots(1, len(panels)))
        for index, (ax, (measure, groups, limits)) in enumerate(zip(axes, panels, strict=True)):
            draw_conditions(ax, groups, conditions, measure=measure, limits=limits)
            ax.set_xlabel(label)
            label_panel(ax, index)
            if len(groups) > 1 and index == 0:
                ax.legend(loc="best")
    return figure
