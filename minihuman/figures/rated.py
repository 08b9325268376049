"""What was said of an agent over time: each press that says good or bad, and the share of good ones of late."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from minihuman.figures.style import QUIET, SERIES, blank, our_style
from minihuman.recorded.episode import Episode

LATEST = 10  # presses that a share is of
NS_PER_MIN = 60e9


def shares_of_good(values: NDArray[np.float64], *, latest: int = LATEST) -> NDArray[np.float64]:
    """For each press the share of good ones among the latest, itself the last of them: of fewer at the beginning.

    Args:
        values: (n,) 1 good, -1 bad, in order of time.
        latest: how many are looked at.
    """
    good = np.concatenate(([0], np.cumsum(values > 0)))
    last = np.arange(1, len(values) + 1)
    first = np.maximum(0, last - latest)
    shares: NDArray[np.float64] = (good[last] - good[first]) / (last - first)
    return shares


def draw_ratings(ax: Axes, episodes: Sequence[Episode]) -> Axes:
    """Draw the presses of a block's episodes over minutes since its first; a dotted line where another policy plays.

    Args:
        ax: where.
        episodes: each with ``taught``, in order; some press in one of them.
    """
    begins_ns = episodes[0].t_ns[0]
    presses = sorted(
        (rating.pressed_ns, rating.value) for each in episodes if each.taught for rating in each.taught.ratings
    )
    minutes = (np.array([t_ns for t_ns, _ in presses]) - begins_ns) / NS_PER_MIN
    values = np.array([value for _, value in presses])
    before: str | None = None
    for episode in episodes:
        policy = episode.taught.policy if episode.taught else before
        if before is not None and policy != before:
            ax.axvline((episode.t_ns[0] - begins_ns) / NS_PER_MIN, color=QUIET, linewidth=0.6, linestyle=":")
        before = policy
    for good, marker, colour in ((True, "^", SERIES[2]), (False, "v", SERIES[5])):
        at = minutes[(values > 0) == good]
        ax.plot(at, np.full(len(at), float(good)), marker, color=colour, ms=3, label="good" if good else "bad")
    ax.plot(
        minutes, shares_of_good(values), color=SERIES[0], drawstyle="steps-post", label=f"good, of the last {LATEST}"
    )
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
    ax.set(xlabel="minutes", ylabel="share of good presses", ylim=(-0.06, 1.06), xlim=(0, None))
    return ax


def ratings_figure(episodes: Sequence[Episode]) -> Figure:
    """One session's presses in one block, for one column of a page."""
    with our_style():
        figure = blank(height_cm=5.0)
        draw_ratings(figure.subplots(), episodes)
    return figure
