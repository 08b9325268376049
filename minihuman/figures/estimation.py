"""Estimation plots, distributions of reaction times, and the figure of the scorecard.

An estimation plot shows every participant's value with each group's mean, and beside them the differences between
groups with their intervals. Reaction times have one line per participant. The scorecard's figure shows each player's
success, human-normalised score and relative efficiency with their intervals.

Sources: Gardner and Altman (1986), Confidence intervals rather than P values; Ho et al. (2019), Moving beyond P values.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from minihuman.figures.figure_data import Difference, are_few
from minihuman.figures.style import MUTED, PAGE_CM, SERIES, figure_style, label_panel, new_figure
from minihuman.statistics.comparison import compare_groups
from minihuman.statistics.scores import Estimate, PlayerScore

Values = NDArray[np.float64]
_TICKS_MS = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_LINE_STYLES = ("-", "--", ":", "-.")
_LARGEST_STEP = 0.09  # between dots side by side, of the distance between two groups


def compare_every_pair(groups: Mapping[str, Values]) -> list[Difference]:
    """Return the difference of each pair of groups that have values, with the interval that the report uses."""
    rows = pd.concat([pd.DataFrame({"group": name, "value": values}) for name, values in groups.items()])
    compared = compare_groups(rows, ["value"], order=list(groups))
    return [
        Difference(comparison.first, comparison.second, comparison.difference, comparison.interval)
        for comparison in compared
        if min(comparison.n)
    ]


def spread_dots(values: Values, *, rows: int = 40, width: float = 0.36) -> Values:
    """Return sideways offsets (n,) that place the dots of nearly equal values side by side.

    Args:
        values: the value of each dot, (n,).
        rows: the number of rows into which the range of the values is divided; dots in a row lie side by side.
        width: the largest offset to either side.
    """
    if not len(values):
        return np.zeros(0)
    extent = float(np.ptp(values))
    height = np.zeros(len(values))
    if extent:
        height = (values - values.min()) / extent
    row_of_dot = (height * (rows - 1)).round().astype(int)
    offsets = np.zeros(len(values))
    largest_row = max(np.bincount(row_of_dot).max(), 2)
    step = min(_LARGEST_STEP, 2 * width / largest_row)
    for row in np.unique(row_of_dot):
        dots = np.flatnonzero(row_of_dot == row)
        offsets[dots] = (np.arange(len(dots)) - (len(dots) - 1) / 2) * step
    return offsets


def draw_participants(
    ax: Axes, groups: Mapping[str, Values], *, measure: str, limits: tuple[float, float] | None = None
) -> Axes:
    """Draw one dot per participant, and beside each group's dots its mean with a 95 % interval (Student's t).

    The interval is clipped to ``limits``, the lowest and the highest possible value of the measure. ``groups`` holds
    each group's values by its name, one per participant and NaN for none. Return ``ax``.
    """
    from minihuman.figures.learning_curves import mean_and_band

    size = _choose_dot_size(max((len(values) for values in groups.values()), default=1))
    tick_labels = []
    for x, (group, values) in enumerate(groups.items()):
        colour = SERIES[x % len(SERIES)]
        present = values[~np.isnan(values)]
        tick_labels.append(f"{group}\nn = {len(present)}")
        offsets = spread_dots(present)
        mean_x = x + (max([0.1, *offsets]) + 0.08)  # to the right of all dots
        ax.plot(
            x + offsets, present, _MARKERS[x % len(_MARKERS)], ms=size, mfc=colour, mec="white", mew=0.3,
            alpha=0.85, gid=f"participants: {group}",
        )  # fmt: skip
        if len(present):
            (mean,), (low,), (high,) = mean_and_band(present[:, None])
            if np.isfinite(low):
                if limits is not None:
                    low, high = np.clip((low, high), *limits)
                ax.plot([mean_x] * 2, [low, high], color="black", lw=1.1, gid=f"interval: {group}")
            ax.plot(mean_x, mean, "D", ms=3.6, color="black", gid=f"mean: {group}")
    ax.set_xticks(range(len(groups)), tick_labels)
    ax.set(xlim=(-0.55, len(groups) - 0.4), ylabel=measure)
    return ax


def _choose_dot_size(n: int) -> float:
    """Return the size of the dots in points, which is smaller for more participants; ``n`` is their number."""
    if n <= 30:
        return 4.2
    if n <= 100:
        return 3.0
    return 1.8


def draw_differences(
    ax: Axes, differences: Sequence[Difference], *, level: str = "difference of means", are_ratios: bool = False
) -> Axes:
    """Draw the differences of pairs of groups with their intervals, one below the other, and a line at zero.

    If ``are_ratios`` is true, the differences are of natural logarithms, and the axis shows them as ratios. The label
    of the axis is ``level``. Return ``ax``.
    """
    ax.axvline(0, color=MUTED, lw=0.8, ls="--")
    for row, difference in enumerate(differences):
        groups = f"{difference.first}, {difference.second}"
        if np.isfinite(difference.interval[0]):
            ax.plot(difference.interval, [row, row], color="black", lw=1.4, gid=f"interval: {groups}")
        ax.plot(difference.estimate, row, "D", color="black", ms=4.5, gid=f"difference: {groups}")
    sign = "/" if are_ratios else "\N{MINUS SIGN}"
    names = [f"{difference.first}\n{sign} {difference.second}" for difference in differences]
    ax.set_yticks(range(len(differences)), names)
    ax.set(ylim=(len(differences) - 0.4, -0.6), xlabel=level)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    if are_ratios:
        ax.xaxis.set_major_formatter(lambda log_ratio, _: f"\N{MULTIPLICATION SIGN}{math.exp(log_ratio):.3g}")
    low, high = ax.get_xlim()
    margin = 0.05 * (high - low)
    ax.set_xlim(min(low, -margin), max(high, margin))  # the line at zero is always visible
    return ax


def estimation_figure(
    groups: Mapping[str, Values],
    differences: Sequence[Difference],
    *,
    measure: str,
    title: str = "",
    limits: tuple[float, float] | None = None,
    unit: str = "participant",
    are_ratios: bool = False,
) -> Figure:
    """Return a figure, a page wide, of every participant's value by group, and beside them the groups' differences.

    Args:
        groups: per group, one value per participant; NaN where a participant has no value.
        differences: the differences between groups, with 95 % intervals.
        measure: the name of the measure.
        title: the title of the figure, which names the block and the measure.
        limits: the lowest and the highest possible value of the measure; None if it has no bounds.
        unit: what a dot stands for, such as ``team``.
        are_ratios: whether the differences are of natural logarithms; they are then shown as ratios.
    """
    with figure_style():
        figure = new_figure(width_cm=PAGE_CM, height_cm=7.4)
        figure.suptitle(title)
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        draw_participants(left, groups, measure=measure, limits=limits)
        level = "ratio of geometric means" if are_ratios else "difference of means"
        draw_differences(right, differences, level=level, are_ratios=are_ratios)
        titles = (f"every {unit}, mean and 95 % interval", level.partition(" ")[0])
        for index, (ax, name) in enumerate(zip((left, right), titles, strict=True)):
            ax.set_title(name, loc="left")
            label_panel(ax, index)
    return figure


def draw_reaction_times(ax: Axes, groups: Mapping[str, NDArray[np.float64]], edges_ms: Values) -> Axes:
    """Draw each participant's distribution of reaction times as a thin line, and each group's mean as a thick one.

    If any group has more than `figure_data.MOST_LINES` participants, whose lines would hide each other, each has a
    band from its participants' 10th to their 90th percentile instead. Return ``ax``.

    Args:
        ax: the axes to draw on.
        groups: per group, the share of each participant's reaction times in each bin, (participants, bins).
        edges_ms: the edges of the bins, (bins + 1,).
    """
    middles_ms = np.sqrt(edges_ms[:-1] * edges_ms[1:])
    has_lines = are_few(groups)
    for number, (group, shares) in enumerate(groups.items()):
        colour = SERIES[number % len(SERIES)]
        if has_lines:
            ax.plot(middles_ms, 100 * shares.T, color=colour, lw=0.4, alpha=0.5)
        else:
            low, high = np.percentile(100 * shares, (10, 90), axis=0)
            ax.fill_between(middles_ms, low, high, color=colour, alpha=0.2, lw=0, gid=f"band: {group}")
        mean = 100 * shares.mean(axis=0)
        line = _LINE_STYLES[number % len(_LINE_STYLES)]
        ax.plot(
            middles_ms, mean, line, color=colour, lw=1.8, zorder=3,
            label=f"{group} (n = {len(shares)})", path_effects=[withStroke(linewidth=3, foreground="white")],
        )  # fmt: skip
    ax.set(xscale="log", xlabel="reaction time (ms, log scale)", ylabel="share of responses (%)", ylim=(0, None))
    ticks_ms = [ms for ms in _TICKS_MS if edges_ms[0] <= ms <= edges_ms[-1]]
    ax.set_xticks(ticks_ms, [str(ms) for ms in ticks_ms])
    ax.set_xticks([], minor=True)
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2, ncols=min(2, len(groups)))
    return ax


def reaction_time_figure(groups: Mapping[str, NDArray[np.float64]], edges_ms: Values, *, title: str) -> Figure:
    """Return a figure, one column wide, of the distributions of reaction times.

    ``groups`` and ``edges_ms`` are those of ``draw_reaction_times``.
    """
    with figure_style():
        figure = new_figure(height_cm=6.6)
        figure.suptitle(title)
        draw_reaction_times(figure.subplots(), groups, edges_ms)
    return figure


ScoreBar = tuple[str, PlayerScore, tuple[float, ...]]  # player, score, and share of successes by episode of a block


def score_figure(bars: Sequence[ScoreBar], *, reference: str) -> Figure:
    """Return a figure of players' success, normalised score, relative efficiency, and success by episode of a block.

    The last panel is omitted if no player has several episodes in a block. A dashed line marks the score of 1 that the
    reference player has by definition; ``reference`` describes this player in words.
    """
    width_ratios = [1.0, 1.0, 1.0]
    has_curves = any(len(shares) > 1 for _, _, shares in bars)
    if has_curves:
        width_ratios.append(1.1)
    with figure_style():
        figure = new_figure(width_cm=PAGE_CM, height_cm=max(5.0, 2.2 + 0.62 * len(bars)))
        figure.suptitle(f"reference: {reference}", fontsize=7.0, x=0.01, ha="left")
        axes = figure.subplots(1, len(width_ratios), width_ratios=width_ratios)
        draw_scores(axes[0], bars, "success", label="success", limits=(0, 1))
        draw_scores(axes[1], bars, "normalised", label="normalised score", mark=1.0)
        draw_scores(axes[2], bars, "relative_efficiency", label="relative efficiency", mark=1.0)
        for axis in axes[1:3]:
            axis.set_yticklabels([])
        if has_curves:
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
) -> None:
    """Draw one of each player's scores with its interval, the first player at the top.

    Args:
        ax: the axes to draw on.
        bars: the players and their scores.
        name: the field of `PlayerScore` to draw.
        label: the label of the axis.
        mark: the reference player's score, drawn as a line; None for no line.
        limits: the lowest and the highest possible score; None if it has no bounds.
    """
    if mark is not None:
        ax.axvline(mark, color=MUTED, lw=0.8, ls="--")
    for row, (_, score, _) in enumerate(bars):
        estimate: Estimate = getattr(score, name)
        colour = SERIES[row % len(SERIES)]
        ax.plot([estimate.low, estimate.high], [row, row], color=colour, lw=1.6, solid_capstyle="butt")
        ax.plot([estimate.value], [row], "o", ms=4, color=colour)
    ax.set_yticks(range(len(bars)), [player for player, _, _ in bars])
    ax.set_ylim(len(bars) - 0.5, -0.5)
    ax.set_xlabel(label)
    if limits is not None:
        ax.set_xlim(limits[0] - 0.03, limits[1] + 0.03)


def draw_curves(ax: Axes, bars: Sequence[ScoreBar]) -> None:
    """Draw each player's share of successes over the episodes of a block."""
    for number, (_, _, shares) in enumerate(bars):
        size = 5.0 - 3.0 * number / max(1, len(bars))  # smaller in front, so that markers behind still show
        colour = SERIES[number % len(SERIES)]
        ax.plot(
            np.arange(1, len(shares) + 1),
            shares,
            marker=_MARKERS[number % len(_MARKERS)],
            ms=size,
            color=colour,
        )
    ax.set(xlabel="episode in the block", ylabel="success", ylim=(-0.03, 1.03))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
