"""Who steered when: a row an episode, each run of steps in the colour of whoever made it, and what was rated."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from minihuman.figures.style import SERIES, blank, our_style
from minihuman.recorded.episode import Episode

AGENT, PERSON = SERIES[0], SERIES[1]
_RATED = {1.0: ("^", SERIES[2], "good"), -1.0: ("v", SERIES[5], "bad")}


def draw_steering(ax: Axes, episodes: Sequence[Episode]) -> Axes:
    """Draw episodes that an agent had a part in, the first on top; a thin line is drawn where another policy plays.

    Args:
        ax: where.
        episodes: each with ``taught``.
    """
    rated: set[float] = set()
    before: str | None = None
    for row, episode in enumerate(episodes):
        taught = episode.taught
        assert taught is not None, f"{episode.name} had no agent"
        for begin, end, person in _stretches(taught.by_person):
            ax.barh(row, end - begin, left=begin, height=0.8, color=PERSON if person else AGENT, linewidth=0)
        if before is not None and taught.policy != before:
            ax.axhline(row - 0.5, color="black", linewidth=0.6)
        before = taught.policy
        for rating in taught.ratings:
            marker, colour, _ = _RATED[rating.value]
            ax.plot(rating.step, row, marker, color=colour, ms=4, mec="white", mew=0.4)
            rated.add(rating.value)
    handles: list[Artist] = [Patch(color=AGENT, label="agent"), Patch(color=PERSON, label="person")]
    handles += [ax.plot([], [], _RATED[v][0], color=_RATED[v][1], label=_RATED[v][2])[0] for v in sorted(rated)]
    ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1), ncols=len(handles))
    every = max(1, len(episodes) // 12)
    ax.set_yticks(range(0, len(episodes), every), [str(each.number) for each in episodes[::every]])
    ax.set(xlabel="step", ylabel="episode", ylim=(len(episodes) - 0.4, -0.6))
    return ax


def steering_figure(episodes: Sequence[Episode]) -> Figure:
    """One session's episodes of one block, for one column of a page."""
    with our_style():
        figure = blank(height_cm=2.6 + 0.36 * min(40, len(episodes)))
        draw_steering(figure.subplots(), episodes)
    return figure


def _stretches(by_person: NDArray[np.bool_]) -> list[tuple[int, int, bool]]:
    """Begin, end and who of each run of steps."""
    edges = [0, *(np.flatnonzero(np.diff(by_person)) + 1).tolist(), len(by_person)]
    return [(begin, end, bool(by_person[begin])) for begin, end in pairwise(edges) if end > begin]
