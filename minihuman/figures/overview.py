"""Overview of one session: the steps, playing time, outcome and keys of each episode."""

from collections import Counter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from minihuman.dataset.measures import playing_s
from minihuman.errors import LogError
from minihuman.experiment.machine.events import UNPRESSED_VERDICTS
from minihuman.figures.style import MUTED, OUTCOME_COLOURS, OUTCOME_MARKERS, SERIES, figure_style, new_figure
from minihuman.log.model.session_log import EpisodeLog, SessionLog

_DOT: dict[str, Any] = {"ms": 4, "mec": "black", "mew": 0.4}
_TICKS = 12  # episodes that can each have their number under the axis
_KEY_KINDS = (("steps", SERIES[0]), ("no action", SERIES[1]), ("not playing", MUTED))


def draw_steps(ax: Axes, log: SessionLog) -> Axes:
    """Draw each episode's steps, its outcome as colour and shape, and its step limit as a bar; return ``ax``."""
    numbers = _list_episode_numbers(log)
    for episode, number in zip(log.episodes, numbers, strict=True):
        name = episode.outcome_word
        ax.plot([number, number], [0, len(episode.actions)], color=OUTCOME_COLOURS[name], lw=1.4, zorder=1)
        ax.plot(
            number, len(episode.actions), OUTCOME_MARKERS[name], color=OUTCOME_COLOURS[name], ms=4, mec="black", mew=0.4
        )
        limit = episode.plan.max_steps
        ax.plot([number - 0.35, number + 0.35], [limit, limit], color=MUTED, lw=0.8)
    outcomes = dict.fromkeys(episode.outcome_word for episode in log.episodes)
    for name in outcomes:
        ax.plot([], [], OUTCOME_MARKERS[name], color=OUTCOME_COLOURS[name], label=name, **_DOT)
    ax.plot([], [], color=MUTED, lw=0.8, label="step limit")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=len(outcomes) + 1, borderaxespad=0, handlelength=1.2)
    ax.set_ylabel("steps")
    ax.set_ylim(bottom=0)
    return ax


def draw_time(ax: Axes, log: SessionLog) -> Axes:
    """Draw each episode's playing time in seconds, without pauses, from the reset to the last step; return ``ax``."""
    seconds = [playing_s(episode) for episode in log.episodes]
    ax.bar(_list_episode_numbers(log), seconds, width=0.7, color=SERIES[4])
    ax.set_ylabel("playing time (s)")
    return ax


def draw_keys(ax: Axes, log: SessionLog) -> Axes:
    """Draw each episode's key presses: those that made a step, had no action, or came outside play; return ``ax``."""
    counts = [_count_presses(episode) for episode in log.episodes]
    bottom = np.zeros(len(counts))
    for kind, colour in _KEY_KINDS:
        heights = np.array([count[kind] for count in counts], dtype=float)
        ax.bar(_list_episode_numbers(log), heights, bottom=bottom, width=0.7, color=colour, label=kind)
        bottom += heights
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderaxespad=0, handlelength=1.0)
    ax.set_ylabel("presses")
    return ax


def draw_different_keys(ax: Axes, log: SessionLog) -> Axes:
    """Draw how many different keys were pressed in each episode, and how many have an action; return ``ax``."""
    n_pressed = [len({press.key for press in episode.keys if press.down}) for episode in log.episodes]
    ax.bar(_list_episode_numbers(log), n_pressed, width=0.7, color=SERIES[3])
    for number, episode in zip(_list_episode_numbers(log), log.episodes, strict=True):
        n_mapped = len(episode.plan.key_map.keys)
        ax.plot([number - 0.42, number + 0.42], [n_mapped, n_mapped], color="black", lw=0.9)
    ax.plot([], [], color="black", lw=0.9, label="keys with an action")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0, handlelength=1.2)
    ax.set_ylabel("different keys")
    ax.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    return ax


def overview_figure(log: SessionLog) -> Figure:
    """Return a figure, one column wide, with four panels over a session's episodes; every other block is shaded.

    The panels are those of ``draw_steps``, ``draw_time``, ``draw_keys`` and ``draw_different_keys``.

    Raises:
        LogError: if the session has no episode.
    """
    if not log.episodes:
        raise LogError(f"{log.path} has no included episode to draw; include others with --with")
    with figure_style():
        figure = new_figure(height_cm=11.5)
        axes = figure.subplots(4, 1, sharex=True)
        for ax, draw in zip(axes, (draw_steps, draw_time, draw_keys, draw_different_keys), strict=True):
            draw(ax, log)
            _shade_blocks(ax, log)
        axes[-1].set_xlabel("episode")
        axes[-1].set_xlim(min(_list_episode_numbers(log)) - 0.8, max(_list_episode_numbers(log)) + 0.8)
        axes[-1].set_xticks(_list_episode_numbers(log), minor=len(log.episodes) > _TICKS)
        if len(log.episodes) > _TICKS:
            axes[-1].xaxis.set_major_locator(MaxNLocator(_TICKS, integer=True, steps=[1, 2, 5, 10]))
        _name_blocks(axes[0], log)
        participant = log.plan.participant
        unclean = "" if log.clean else ", cut off"
        figure.suptitle(f"{participant.id} ({participant.group}), {log.plan.study}{unclean}", fontsize=7.5)
    return figure


def _list_episode_numbers(log: SessionLog) -> list[int]:
    return [episode.number for episode in log.episodes]


def _count_presses(episode: EpisodeLog) -> Counter[str]:
    """Count an episode's key presses by the kinds that `draw_keys` draws: "steps", "no action" and "not playing"."""
    kinds = {"accepted": "steps", "queued": "steps", "unmapped": "no action", "spare": "no action"}
    return Counter(
        kinds.get(press.verdict, "not playing")
        for press in episode.keys
        if press.down and press.verdict not in UNPRESSED_VERDICTS
    )


def _name_blocks(ax: Axes, log: SessionLog) -> None:
    """Write the name of each block above its episodes on the axes of steps, and extend them to make room for it."""
    ax.set_ylim(top=1.2 * max(episode.plan.max_steps for episode in log.episodes))
    for name in dict.fromkeys(episode.plan.block_name for episode in log.episodes):
        numbers = [episode.number for episode in log.episodes if episode.plan.block_name == name]
        middle = (min(numbers) + max(numbers)) / 2
        ax.text(middle, 0.98, name, ha="center", va="top", transform=ax.get_xaxis_transform(), fontweight="bold")


def _shade_blocks(ax: Axes, log: SessionLog) -> None:
    """Shade the episodes of every other block."""
    blocks = dict.fromkeys(episode.plan.block for episode in log.episodes)
    for index, block in enumerate(blocks):
        numbers = [episode.number for episode in log.episodes if episode.plan.block == block]
        if index % 2 == 1:
            ax.axvspan(min(numbers) - 0.5, max(numbers) + 0.5, color="#efefef", zorder=-1, lw=0)
