"""Figures of teaching sessions: when the person or the agent steered, and how the agent was rated over time."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from minihuman.figures.style import MUTED, SERIES, figure_style, new_figure
from minihuman.log.model.session_log import EpisodeLog

AGENT = SERIES[0]
PERSON = SERIES[1]
_MOST_TICKS = 12
_RATED = {1.0: ("^", SERIES[2], "good"), -1.0: ("v", SERIES[5], "bad")}


def draw_steering(ax: Axes, episodes: Sequence[EpisodeLog]) -> Axes:
    """Draw who steered at each step, the first episode on top, with a thin line at each change of the policy.

    Ratings are drawn as marks at their steps. Return ``ax``.

    Args:
        ax: the axes to draw on.
        episodes: the episodes, each with the record ``taught`` of its agent and ratings.
    """
    drawn_ratings: set[float] = set()
    last_policy: str | None = None
    for row, episode in enumerate(episodes):
        taught = episode.taught
        assert taught is not None, f"{episode.name} had no agent"
        for begin, end, person in _split_runs(taught.by_person):
            ax.barh(row, end - begin, left=begin, height=0.8, color=PERSON if person else AGENT, linewidth=0)
        if last_policy is not None and taught.policy != last_policy:
            ax.axhline(row - 0.5, color="black", linewidth=0.6)
        last_policy = taught.policy
        for rating in taught.ratings:
            marker, colour, _ = _RATED[rating.value]
            ax.plot(rating.step, row, marker, color=colour, ms=4, mec="white", mew=0.4)
            drawn_ratings.add(rating.value)
    handles: list[Artist] = [Patch(color=AGENT, label="agent"), Patch(color=PERSON, label="person")]
    for number in sorted(drawn_ratings):
        marker, colour, label = _RATED[number]
        handles += ax.plot([], [], marker, color=colour, label=label)
    ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1), ncols=len(handles))
    tick_step = max(1, len(episodes) // _MOST_TICKS)
    ax.set_yticks(range(0, len(episodes), tick_step), [str(episode.number) for episode in episodes[::tick_step]])
    ax.set(xlabel="step", ylabel="episode", ylim=(len(episodes) - 0.4, -0.6))
    return ax


def steering_figure(episodes: Sequence[EpisodeLog]) -> Figure:
    """Return a figure, one column wide, of who steered in a session's episodes of one block."""
    with figure_style():
        figure = new_figure(height_cm=2.6 + 0.36 * min(40, len(episodes)))
        draw_steering(figure.subplots(), episodes)
    return figure


def _split_runs(by_person: NDArray[np.bool_]) -> list[tuple[int, int, bool]]:
    """Split steps into runs of one actor; return the begin and end of each, and whether the actor was the person."""
    edges = [0, *(np.flatnonzero(np.diff(by_person)) + 1).tolist(), len(by_person)]
    return [(begin, end, bool(by_person[begin])) for begin, end in pairwise(edges) if end > begin]


WINDOW_PRESSES = 10  # the latest rating presses, of which the share of good ones is drawn
NS_PER_MIN = 60e9


def compute_shares_of_good(values: NDArray[np.float64], *, latest: int = WINDOW_PRESSES) -> NDArray[np.float64]:
    """Return, for each press, the share of good presses among the latest ones, including itself.

    Args:
        values: 1 for good and -1 for bad, in order of time, (n,).
        latest: the number of presses of which the share is computed; the first presses have fewer.
    """
    good = np.concatenate(([0], np.cumsum(values > 0)))
    last = np.arange(1, len(values) + 1)
    first = np.maximum(0, last - latest)
    shares: NDArray[np.float64] = (good[last] - good[first]) / (last - first)
    return shares


def draw_ratings(ax: Axes, episodes: Sequence[EpisodeLog]) -> Axes:
    """Draw the rating presses of a block over the minutes since its start, with a dotted line where the policy changes.

    A line shows the share of good ones among the latest ``WINDOW_PRESSES`` presses. Return ``ax``.

    Args:
        ax: the axes to draw on.
        episodes: the block's episodes in order, those with an agent having ``taught``; one must have a press.
    """
    begins_ns = episodes[0].t_ns[0]
    for change_ns in _find_policy_changes_ns(episodes):
        ax.axvline((change_ns - begins_ns) / NS_PER_MIN, color=MUTED, linewidth=0.6, linestyle=":")
    presses = sorted(
        (rating.pressed_ns, rating.value) for episode in episodes if episode.taught for rating in episode.taught.ratings
    )
    minutes = (np.array([t_ns for t_ns, _ in presses]) - begins_ns) / NS_PER_MIN
    values = np.array([value for _, value in presses])
    good_minutes = minutes[values > 0]
    bad_minutes = minutes[values <= 0]
    ax.plot(good_minutes, np.ones(len(good_minutes)), "^", color=SERIES[2], ms=3, label="good")
    ax.plot(bad_minutes, np.zeros(len(bad_minutes)), "v", color=SERIES[5], ms=3, label="bad")
    ax.plot(
        minutes,
        compute_shares_of_good(values),
        color=SERIES[0],
        drawstyle="steps-post",
        label=f"good, of the last {WINDOW_PRESSES}",
    )
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
    ax.set(xlabel="minutes", ylabel="share of good presses", ylim=(-0.06, 1.06), xlim=(0, None))
    return ax


def _find_policy_changes_ns(episodes: Sequence[EpisodeLog]) -> Iterator[int]:
    """Yield the start times of the episodes whose policy differs from that of the episode before, in ns."""
    last_policy: str | None = None
    for episode in episodes:
        if episode.taught is None:
            continue
        policy = episode.taught.policy
        if last_policy is not None and policy != last_policy:
            yield episode.t_ns[0]
        last_policy = policy


def ratings_figure(episodes: Sequence[EpisodeLog]) -> Figure:
    """Return a figure, one column wide, of a session's rating presses in one block."""
    with figure_style():
        figure = new_figure(height_cm=5.0)
        draw_ratings(figure.subplots(), episodes)
    return figure
