"""The figure of conditions: every participant's value in each, and the differences between conditions.

In a mixed design, the differences are those of groups in each contrast between conditions.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from minihuman.figures.estimation import draw_differences, spread_dots
from minihuman.figures.figure_data import Difference
from minihuman.figures.learning_curves import mean_and_band
from minihuman.figures.style import PAGE_CM, SERIES, figure_style, label_panel, new_figure

Values = NDArray[np.float64]
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_LINES = ("-", "--", ":", "-.")
_WIDTH = 0.8  # of a condition's place, shared by the groups


def draw_cells(
    ax: Axes,
    groups: Mapping[str, Values],
    conditions: Sequence[str],
    *,
    measure: str,
    limits: tuple[float, float] | None = None,
) -> Axes:
    """Draw a dot per participant and condition, a thin line through a participant's dots, and each cell's mean.

    Each mean has a 95 % interval (Student's t), clipped to ``limits``; a line joins a group's means. Return ``ax``.

    Args:
        ax: the axes to draw on.
        groups: per group, an array of shape (participants, conditions); NaN where a participant has no value.
        conditions: the names of the conditions.
        measure: the name of the measure.
        limits: the lowest and the highest possible value of the measure; None if it has no bounds.
    """
    width = _WIDTH / len(groups)
    size = _choose_dot_size(max(len(values) for values in groups.values()))
    for number, (group, values) in enumerate(groups.items()):
        colour = SERIES[number % len(SERIES)]
        centre = (number - (len(groups) - 1) / 2) * width
        group_x = np.arange(len(conditions), dtype=np.float64) + centre
        dots_x = _place_dots(values, group_x, width=width / 3)
        ax.plot(dots_x.T, values.T, color=colour, lw=0.35, alpha=0.3, zorder=1)
        ax.plot(
            dots_x.ravel(), values.ravel(), _MARKERS[number % len(_MARKERS)], ms=size, mfc=colour, mec="white", mew=0.3,
            alpha=0.75, zorder=2, gid=f"participants: {group}",
        )  # fmt: skip
        _draw_means(ax, group, values, group_x, number, limits)
    ax.set_xticks(range(len(conditions)), list(conditions))
    ax.set(xlim=(-0.6, len(conditions) - 0.4), ylabel=measure)
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2, ncols=min(3, len(groups)))
    return ax


def _choose_dot_size(n: int) -> float:
    """Return the size of the dots in points, which is smaller for more participants; ``n`` is their number."""
    if n <= 30:
        return 3.2
    if n <= 100:
        return 2.2
    return 1.4


def _place_dots(values: Values, group_x: Values, *, width: float) -> Values:
    """Return the x coordinate of each dot, (participants, conditions); dots of equal values lie side by side.

    Args:
        values: the participants' values, (participants, conditions).
        group_x: the x coordinate around which a group's dots lie in each condition, (conditions,).
        width: the largest distance of a dot from it.
    """
    dots_x = np.full(values.shape, np.nan)
    for column, x in enumerate(group_x):
        is_present = ~np.isnan(values[:, column])
        dots_x[is_present, column] = x + spread_dots(values[is_present, column], width=width)
    return dots_x


def _draw_means(
    ax: Axes, group: str, values: Values, group_x: Values, number: int, limits: tuple[float, float] | None
) -> None:
    """Draw a group's mean in each condition, joined by a line, with 95 % intervals clipped to ``limits``.

    ``group_x`` has the x coordinate of each mean; ``number`` selects the group's colour, marker and line.
    """
    mean, low, high = mean_and_band(values)
    if limits is not None:
        low = np.clip(low, *limits)
        high = np.clip(high, *limits)
    marker = _MARKERS[number % len(_MARKERS)]
    line = _LINES[number % len(_LINES)]
    colour = SERIES[number % len(SERIES)]
    n_participants = int((~np.isnan(values)).any(axis=1).sum())
    ax.plot(
        group_x, mean, marker + line, color="black", mfc=colour, mec="black", mew=0.9, ms=5.5, lw=1.1, zorder=4,
        gid=f"means: {group}", label=f"{group} (n = {n_participants})",
    )  # fmt: skip
    for x, bottom, top in zip(group_x, low, high, strict=True):
        if np.isfinite(bottom):
            ax.plot([x, x], [bottom, top], color="black", lw=1.1, zorder=3, gid=f"interval: {group}")


def _name_difference(difference: Difference) -> str:
    """Return the name of a difference, in two lines where groups are compared."""
    return "\n".join(filter(None, (difference.first, difference.second)))


def _label_differences(ax: Axes, differences: Sequence[Difference], title: str) -> None:
    """Write each difference's name at its position on the vertical axis, and the title above the axes."""
    ax.set_yticks(range(len(differences)), [*map(_name_difference, differences)])
    ax.set_title(title, loc="left")


def cells_figure(
    groups: Mapping[str, Values],
    conditions: Sequence[str],
    differences: Sequence[Difference],
    *,
    measure: str,
    title: str = "",
    condition: str = "",
    level: str = "difference of contrast scores",
    comparison: str = "interaction, 95 % interval",
    are_ratios: bool = False,
    limits: tuple[float, float] | None = None,
) -> Figure:
    """Return a figure, a page wide, of every participant's value in every condition, and beside them the differences.

    Args:
        groups: per group, an array of shape (participants, conditions); NaN where a participant has no value.
        conditions: the names of the conditions.
        differences: the differences to draw; ``first`` names the contrast, ``second`` the groups if they are compared.
        measure: the name of the measure.
        title: the title of the figure.
        condition: the label of the axis of conditions.
        level: the label of the axis of differences.
        comparison: the title above the differences.
        are_ratios: whether the differences are of logarithms; their axis then shows ratios.
        limits: the lowest and the highest possible value of the measure; None if it has no bounds.
    """
    with figure_style():
        figure = new_figure(width_cm=PAGE_CM, height_cm=max(7.4, 3.0 + 0.9 * len(differences)))
        figure.suptitle(title)
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        draw_cells(left, groups, conditions, measure=measure, limits=limits)
        left.set_xlabel(condition)
        draw_differences(right, differences, level=level, are_ratios=are_ratios)
        _label_differences(right, differences, comparison)
        for index, ax in enumerate((left, right)):
            label_panel(ax, index)
    return figure
