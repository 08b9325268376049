"""Kaplan-Meier curves by group, with the number of participants at risk under the axis.

They are separate from the learning curves because survival analysis imports pandas (and so pyarrow), which code that
draws from logs must not import.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from minihuman.figures.style import SERIES, figure_style, new_figure
from minihuman.statistics.survival import SurvivalCurve, SurvivalTimes, kaplan_meier

_DASHES = ("-", "--", ":", "-.")
_Z_95 = 1.959964  # the quantile of the normal distribution for a 95 % interval


def survival_band(survival: SurvivalCurve) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper limits of the 95 % intervals of a curve's shares, for independent observations.

    The variance is Greenwood's on the log-log scale (Kalbfleisch and Prentice, 2002, section 1.4). The limits are NaN
    where the share is 0.
    """
    share = survival.share
    at_risk = survival.at_risk
    before = np.concatenate([[1.0], share[:-1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        events = np.round(at_risk * (1 - share / before))
        variance = np.cumsum(events / (at_risk * (at_risk - events)))
        spread = _Z_95 * np.sqrt(variance) / np.abs(np.log(share))
        return share ** np.exp(spread), share ** np.exp(-spread)


def draw_survival(ax: Axes, groups: Mapping[str, SurvivalTimes], *, label: str, independent: bool = False) -> Axes:
    """Draw each group's Kaplan-Meier curve as a step function, with a tick at each censored observation; return ``ax``.

    Args:
        ax: the axes to draw on.
        groups: per group, the survival times.
        label: the label of the time axis.
        independent: whether each observation is from another participant; intervals are drawn only then.
    """
    last = max(float(survival_times.times.max()) for survival_times in groups.values())
    for index, (group, survival_times) in enumerate(groups.items()):
        survival = kaplan_meier(survival_times)
        colour = SERIES[index % len(SERIES)]
        end = float(survival_times.times.max())
        times = np.concatenate([[0.0], survival.times, [end]])
        share = np.concatenate([[1.0], survival.share, [survival.share[-1] if len(survival.share) else 1.0]])
        ax.step(times, share, _DASHES[index % len(_DASHES)], where="post", color=colour, label=group)
        if independent and len(survival.times):
            low, high = (np.concatenate([[1.0], bound]) for bound in survival_band(survival))
            at_events = np.concatenate([[0.0], survival.times])
            ax.fill_between(
                np.append(at_events, end), np.append(low, low[-1]), np.append(high, high[-1]),
                step="post", color=colour, alpha=0.16, lw=0, gid=f"band: {group}",
            )  # fmt: skip
        censored = np.unique(survival_times.times[~survival_times.observed])
        censored_share = np.array([share[np.searchsorted(times, time, side="right") - 1] for time in censored])
        ax.plot(censored, censored_share, "|", color=colour, ms=5)
    ax.set(xlabel=label, ylabel="share without the event", ylim=(0, 1.02), xlim=(0, last * 1.02))
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2, ncols=min(2, len(groups)))
    return ax


def survival_figure(
    groups: Mapping[str, SurvivalTimes],
    *,
    label: str,
    title: str = "",
    independent: bool = False,
    counted: str = "at risk",
) -> Figure:
    """Return a figure, one column wide, of the survival curves of one event, with the number at risk under the axis.

    Args:
        groups: per group, the survival times.
        label: the label of the time axis.
        title: the title of the figure.
        independent: whether each observation is from another participant; intervals are drawn only then.
        counted: the words for what is counted under the axis.
    """
    with figure_style():
        figure = new_figure(height_cm=6.2 + 0.45 * len(groups) + 0.4 * len(title.splitlines()))
        axes, below = figure.subplots(2, height_ratios=(6, len(groups) + 0.6))
        figure.suptitle(title)
        draw_survival(axes, groups, label=label, independent=independent)
        below.set(xlim=axes.get_xlim(), ylim=(-0.6, len(groups) + 0.4))
        below.axis("off")
        last = max(float(survival_times.times.max()) for survival_times in groups.values())
        ticks = np.array([tick for tick in axes.get_xticks() if 0 <= tick <= last])
        for index, (group, survival_times) in enumerate(groups.items()):
            y = len(groups) - 1 - index
            colour = SERIES[index % len(SERIES)]
            for time, count in zip(ticks, survival_times.count_at_risk(ticks), strict=True):
                below.text(time, y, str(count), ha="center", va="center", color=colour, fontsize=6.5)
            below.text(0, y + 0.45, f"{counted}, {group}:", ha="left", va="center", color=colour, fontsize=6)
    return figure
