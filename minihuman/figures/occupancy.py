"""Occupancy: the share of steps spent in each place, over many episodes of one world."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.figures.path_figures import get_valid_bounds
from minihuman.figures.style import COLUMN_CM, OCCUPANCY_COLOURS, PAGE_CM, WALL, figure_style, label_panel, new_figure
from minihuman.log.model.session_log import EpisodeLog, SessionLog

_SQUARE_SIZE = {"cell": 1.0, "m": 0.5}  # in the unit of the map
_ROUNDING = 1e-9  # so that a rounding error adds no edge beyond the last one
_MAX_SQUARES = 4_000_000
_WALL_DECIMALS = 6  # of coordinates; walls that differ by less are the same
_COLOUR_RANGE = 300  # the largest percentage over the smallest on the colour scale


def compute_occupancy(
    participants: Sequence[Sequence[EpisodeLog]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the share of steps in each square of the floor, (columns, rows), and the squares' edges along x and z.

    The shares sum to 1. Squares are cells in the grid and half metres in first-person worlds. Every participant has the
    same weight, however many steps they took. Episodes without a map or poses are omitted.

    Args:
        participants: per participant, the episodes, all in worlds with the same unit of places.

    Raises:
        ValueError: if no episode has a map and poses, or cells and metres are mixed.
        LogError: if a map's bounds are invalid, or too far apart.
    """
    participant_episodes = []
    for episodes in participants:
        placed_episodes = [episode for episode in episodes if has_positions(episode)]
        if placed_episodes:
            participant_episodes.append(placed_episodes)
    all_episodes = list(chain.from_iterable(participant_episodes))
    low, high, size = _measure_extent(all_episodes)
    x_edges = np.arange(low[0], high[0] + size - _ROUNDING, size)
    z_edges = np.arange(low[1], high[1] + size - _ROUNDING, size)
    total = np.zeros((len(x_edges) - 1, len(z_edges) - 1))
    for episodes in participant_episodes:
        positions = _stack_positions(episodes)
        counts = np.histogram2d(positions[:, 0], positions[:, 1], bins=[x_edges, z_edges])[0]
        total += counts / counts.sum() / len(participant_episodes)
    return total, x_edges, z_edges


def _measure_extent(episodes: Sequence[EpisodeLog]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the lowest and the highest (x, z) of all maps and steps, and the size of a square, in the maps' unit.

    Raises:
        ValueError: if there is no map, or cells and metres are mixed.
        LogError: if a map's bounds are invalid, or too far apart.
    """
    maps = [episode.start.map for episode in episodes if episode.start.map]
    units = {floor.unit for floor in maps}
    if len(units) != 1:
        names = ", ".join(sorted(units)) or "none"
        raise ValueError(f"occupancy needs episodes with a map and poses in one unit; found units: {names}")
    size = _SQUARE_SIZE[units.pop()]
    bounds = np.array([get_valid_bounds(floor) for floor in maps])
    positions = _stack_positions(episodes)
    low = np.minimum(bounds[:, :2].min(axis=0), positions.min(axis=0))  # a step can lie outside its world's map
    high = np.maximum(bounds[:, 2:].max(axis=0), positions.max(axis=0))
    if ((high - low) / size).prod() > _MAX_SQUARES:
        raise LogError(
            f"{episodes[0].plan.world}: its maps and paths span {low.tolist()} to {high.tolist()}, too much to draw; "
            "the log was changed or the world's map is wrong; run: minihuman verify"
        )
    return low, high, size


def _stack_positions(episodes: Sequence[EpisodeLog]) -> NDArray[np.float64]:
    """Return the position (x, z) at every step of all episodes, (steps, 2)."""
    return np.concatenate([episode.poses[:, [0, 2]] for episode in episodes])


def draw_occupancy(
    ax: Axes, participants: Sequence[Sequence[EpisodeLog]], *, limits: tuple[float, float] | None = None
) -> Axes:
    """Draw the share of steps in each square of the floor, darker for more, with the walls of every map; return ``ax``.

    Squares that were never visited are white. Walls that only some of the episodes have are paler.

    Args:
        ax: the axes to draw on.
        participants: per participant, the episodes.
        limits: the percentages that are drawn palest and darkest; by default, those of the data.
    """
    share, x_edges, z_edges = compute_occupancy(participants)
    shades = mpl.colormaps[OCCUPANCY_COLOURS](np.linspace(0.14, 1, 256))  # the palest differs from white
    colours = mpl.colors.ListedColormap(shades).with_extremes(bad="white")
    percent = np.ma.masked_equal(100 * share.T, 0)
    low, high = limits or find_occupancy_limits(share)
    mesh = ax.pcolormesh(x_edges, z_edges, percent, cmap=colours, norm=mpl.colors.LogNorm(low, high))
    mesh.set_gid("occupancy")
    walls = [
        wall
        for episodes in participants
        for episode in episodes
        if episode.start.map
        for wall in episode.start.map.walls
    ]
    distinct_walls, counts = np.unique(np.round(walls, _WALL_DECIMALS), axis=0, return_counts=True)
    segments = [((x0, z0), (x1, z1)) for x0, z0, x1, z1 in distinct_walls]
    lines = LineCollection(segments, colors=WALL, linewidths=0.8, alpha=list(counts / counts.max()))
    ax.add_collection(lines)
    ax.set(aspect="equal", xticks=[], yticks=[])
    ax.set_ylim(z_edges[-1] + 0.1, z_edges[0] - 0.1)
    ax.spines[:].set_visible(False)
    return ax


def find_occupancy_limits(*shares: NDArray[np.float64]) -> tuple[float, float]:
    """Return the lowest and the highest percentage of the colour scale for some arrays of shares from 0 to 1.

    The highest is the largest share; the lowest is the smallest share above 0, but at least a 300th of the highest.
    """
    highest = max(100 * float(share.max()) for share in shares)
    lowest = min(100 * float(share[share > 0].min()) for share in shares)
    return max(lowest, highest / _COLOUR_RANGE), highest


def occupancy_figure(title: str, groups: Mapping[str, Sequence[Sequence[EpisodeLog]]]) -> Figure:
    """Return a figure of the occupancy of each group, with one colour scale for all.

    The figure is a column wide for one group, and a page wide for several.

    Args:
        title: the title of the figure, such as the world's name.
        groups: per group, the participants; per participant, the episodes.
    """
    limits = find_occupancy_limits(*(compute_occupancy(participants)[0] for participants in groups.values()))
    with figure_style():
        width_cm = COLUMN_CM if len(groups) == 1 else PAGE_CM
        figure = new_figure(width_cm=width_cm, height_cm=7.6)
        axes = figure.subplots(1, len(groups), squeeze=False)[0]
        for index, (ax, (group, participants)) in enumerate(zip(axes, groups.items(), strict=True)):
            draw_occupancy(ax, participants, limits=limits)
            noun = "participant" if len(participants) == 1 else "participants"
            name = title if len(groups) == 1 else group
            ax.set_title(f"{name}, {len(participants)} {noun}", loc="left")
            if len(groups) > 1:
                label_panel(ax, index)
        if len(groups) > 1:
            figure.suptitle(title)
        bar = figure.colorbar(axes[0].collections[0], ax=list(axes), shrink=0.8)
        bar.ax.yaxis.set_major_formatter(lambda percent, _: f"{percent:g}")
        bar.set_label("share of steps (%, log scale)")
    return figure


def group_by_participant(logs: Iterable[SessionLog], world: str) -> list[list[EpisodeLog]]:
    """Return a list per participant of the episodes in a world that have positions, over all of their sessions."""
    participants: dict[tuple[str, str], list[EpisodeLog]] = {}
    for log in logs:
        episodes = [episode for episode in log.episodes if episode.plan.world == world and has_positions(episode)]
        if episodes:
            participants.setdefault((log.plan.study, log.plan.participant.id), []).extend(episodes)
    return list(participants.values())


def group_participants_by_group(logs: Iterable[SessionLog], world: str) -> dict[str, list[list[EpisodeLog]]]:
    """Return, for each group that played a world, the episodes of each participant; groups are in alphabetical order.

    Only episodes with positions are included.
    """
    logs = list(logs)
    groups = sorted({log.plan.participant.group for log in logs})
    by_group = {
        group: group_by_participant((log for log in logs if log.plan.participant.group == group), world)
        for group in groups
    }
    return {group: participants for group, participants in by_group.items() if participants}


def has_positions(episode: EpisodeLog) -> bool:
    """Return whether an episode has a map, and a pose at every step."""
    return episode.start.map is not None and not bool(np.isnan(episode.poses[:, [0, 2]]).any())
