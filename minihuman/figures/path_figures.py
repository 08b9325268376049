"""Paths on the floor plan with its objects: one numbered panel per episode, with time as the colour of the line."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from minihuman.dataset.measures import turns_in_place
from minihuman.errors import LogError
from minihuman.figures.figure_data import group_by_block
from minihuman.figures.style import (
    COLUMN_CM,
    END,
    FLOOR,
    GOAL,
    MUTED,
    PARTNERS,
    START,
    TIME_COLOURS,
    WALL,
    figure_style,
    new_figure,
)
from minihuman.log.model.session_log import EpisodeLog, SessionLog, list_partner_seats
from minihuman.worlds.pose import Map, Thing

MAX_LEGEND_ENTRIES = 16  # things in a legend
_SHAPES = {  # by the last word of a thing's name
    "ball": "o", "box": "s", "key": "^", "door": "D", "goal": "*", "lava": "X", "duckie": "v", "sign": "p",
    "medkit": "P", "cone": "<", "barrel": "H", "tree": "d",
}  # fmt: skip
_OTHER = "h"


def get_marker(thing: Thing) -> str:
    """Return Matplotlib's marker for an object, by the last known word of its name ("door" in "door locked") or "h"."""
    words = thing.name.replace("_", " ").lower().split()
    return next((_SHAPES[word] for word in reversed(words) if word in _SHAPES), _OTHER)


def draw_object(ax: Axes, thing: Thing) -> None:
    """Draw an object on a map in its true size, as the marker of its kind; the map's z axis points down the page."""
    style = MarkerStyle(get_marker(thing))
    path = style.get_path().transformed(style.get_transform())
    reach = max(abs(path.get_extents().get_points()).max(), 1e-9)
    size = thing.radius / reach
    transform = Affine2D().scale(size, -size).translate(thing.x, thing.z)
    patch = PathPatch(
        path.transformed(transform), facecolor=thing.colour, edgecolor=WALL, alpha=0.6, linewidth=0.4, zorder=1
    )
    patch.set_gid(f"thing: {thing.name}")
    ax.add_patch(patch)


def build_object_legend(maps: Iterable[Map | None]) -> list[Line2D]:
    """Return legend entries for the objects on some maps, one per name, at most ``MAX_LEGEND_ENTRIES``.

    Objects without a name are omitted, and so are goals, because they have a separate entry. A map may be None.
    """
    handles: dict[tuple[str, str], Line2D] = {}
    things = [thing for floor in maps if floor is not None for thing in floor.things]
    for thing in things:
        marker = get_marker(thing)
        key = (thing.name, marker)
        if thing.name and "goal" not in thing.name and key not in handles:
            handles[key] = Line2D(
                [], [], ls="", marker=marker, ms=5, mfc=thing.colour, mec=WALL, mew=0.4, alpha=0.6, label=thing.name
            )  # fmt: skip
    return list(handles.values())[:MAX_LEGEND_ENTRIES]


_SPREAD_CELLS = 0.11  # how far a cell's next visit is drawn from its last, so that ways there and back both show
_FLOOR_GAP = 1.15  # from one floor of a building to the next, in depths of the plan
_RING_FROM_RAD = math.pi / 4  # a smaller turn is a bend of the line, which shows without a ring
_ROUNDING_RAD = 1e-6
_FULL_CIRCLE = 2 * math.pi
_ACROSS = 4  # panels beside each other that stay readable in a column
_PANEL_TITLE_CM = 0.3  # height of the number and outcome above a panel
_GROUP_TITLE_CM = 0.5  # height of the title above a group of columns
_KEY_CM = 1.25  # height of the strip that explains colours and marks
_NAMES_CM = 0.35  # and of each row of things named in it


def get_valid_bounds(floor: Map) -> tuple[float, float, float, float]:
    """Return the bounds of a map (x0, z0, x1, z1) if they are valid.

    Raises:
        LogError: if the bounds are not finite, or do not increase.
    """
    x0, z0, x1, z1 = floor.bounds
    if not (np.isfinite(floor.bounds).all() and x0 < x1 and z0 < z1):
        raise LogError(
            f"a map's bounds are x {x0:g} to {x1:g}, z {z0:g} to {z1:g}, which must increase; the log was changed or "
            "the world's map is wrong; run: minihuman verify"
        )
    return floor.bounds


def draw_map(ax: Axes, floor: Map) -> Axes:
    """Draw the floor, walls and objects as seen from above, x to the right and z down the page; return ``ax``.

    The floors of a building lie below each other, the highest at the top.

    Raises:
        LogError: if the map's bounds are invalid.
    """
    x0, z0, x1, z1 = get_valid_bounds(floor)
    shifts = find_floor_shifts(floor)
    segments = []
    for number, shift in enumerate(shifts):
        ax.add_patch(Rectangle((x0, z0 + shift), x1 - x0, z1 - z0, facecolor=FLOOR, edgecolor="none", zorder=0))
        plan = floor.plan_of(number) if floor.levels else floor
        segments += [((wall[0], wall[1] + shift), (wall[2], wall[3] + shift)) for wall in plan.walls]
        for thing in plan.things:
            draw_object(ax, replace(thing, z=thing.z + shift))
        if floor.levels:
            ax.annotate(
                f"floor {number}", (x0, (z0 + z1) / 2 + shift), (-1.5, 0), textcoords="offset points", rotation=90,
                fontsize=4.5, color=MUTED, ha="right", va="center",
            )  # fmt: skip
    ax.add_collection(LineCollection(segments, colors=WALL, linewidths=0.8, capstyle="projecting", zorder=2))
    margin = 0.03 * max(x1 - x0, z1 - z0)
    top = z0 + shifts.min() - margin
    ax.set(xlim=(x0 - margin, x1 + margin), ylim=(z1 + margin, top), aspect="equal", xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    return ax


def find_floor_shifts(floor: Map) -> NDArray[np.float64]:
    """Return how far along z each floor is drawn from the lowest one, in the map's unit, float64[floors].

    Higher floors have negative shifts. A flat world has one floor, whose shift is 0.
    """
    _, z0, _, z1 = floor.bounds
    return np.array([-_FLOOR_GAP * (z1 - z0) * number for number in range(max(1, len(floor.levels)))])


def _find_floors(episode: EpisodeLog, poses: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the floor on which each pose lies, int64[n], 0 for the lowest; 0 in a flat world.

    ``poses`` has the shape (n, 4).
    """
    floor = episode.start.map
    if floor is None or not floor.levels:
        return np.zeros(len(poses), np.int64)
    return np.array([floor.floor_at(y) for y in poses[:, 1].tolist()], np.int64)


def draw_path(ax: Axes, episode: EpisodeLog) -> Axes:
    """Draw the path of an episode; the colour shows the time since its start, from dark to light; return ``ax``.

    Rings mark turns in place of 45 degrees and more; larger turns have larger rings. In the grid, where paths overlap
    exactly, each further visit to a cell is drawn slightly offset. An episode without poses draws nothing.
    """
    has_pose = ~np.isnan(episode.poses[:, 0])
    if not has_pose.any():
        return ax
    _draw_partners(ax, episode)
    unit = episode.start.map.unit if episode.start.map else "m"
    floors = _find_floors(episode, episode.poses[has_pose])
    if unit == "cell":
        points = _spread_visits(episode.poses[has_pose][:, [0, 2]])
    else:
        points = episode.poses[has_pose][:, [0, 2]]
    if episode.start.map is not None and episode.start.map.levels:
        points[:, 1] += find_floor_shifts(episode.start.map)[floors]
    time_share = (episode.t_ns[has_pose] - episode.t_ns[0]) / max(1, int(episode.t_ns[-1] - episode.t_ns[0]))
    segments = np.stack([points[:-1], points[1:]], axis=1)
    has_moved = (np.abs(np.diff(points, axis=0)).sum(axis=1) > 0) & (np.diff(floors) == 0)
    line = LineCollection(
        list(segments[has_moved]),
        array=time_share[1:][has_moved],
        cmap=TIME_COLOURS,
        clim=(0, 1),
        linewidths=1.1,
        capstyle="round",
        zorder=4,
    )
    line.set_gid("path")
    ax.add_collection(line)
    _draw_turns(ax, episode, points, has_pose)
    ax.plot(*points[0], "o", ms=3.4, mfc=START, mec="black", mew=0.7, zorder=7, gid="start")
    ax.plot(*points[-1], "X", ms=3.4, mfc=END, mec="black", mew=0.4, zorder=8, gid="end")
    return ax


def _draw_turns(ax: Axes, episode: EpisodeLog, points: NDArray[np.float64], has_pose: NDArray[np.bool_]) -> None:
    """Draw a ring at each turn in place of 45 degrees and more, larger for larger turns.

    ``points`` has the drawn position of each pose that is not missing; ``has_pose`` says which poses are these.
    """
    turns = turns_in_place(episode)
    turns = turns[turns["turned_rad"] > _RING_FROM_RAD - _ROUNDING_RAD]
    if not turns.size:
        return
    index = np.cumsum(has_pose)[turns["row"]] - 1
    rings = ax.scatter(
        points[index, 0], points[index, 1], s=3 + 20 * np.minimum(1.0, turns["turned_rad"] / _FULL_CIRCLE),
        facecolors="none", edgecolors=WALL, linewidths=0.45, zorder=5,
    )  # fmt: skip
    rings.set_gid("turns in place")


def _draw_partners(ax: Axes, episode: EpisodeLog) -> None:
    """Draw the paths of the other bodies of a team, each as a plain line from a dot to a cross."""
    for number, seat in enumerate(list_partner_seats(episode)):
        assert episode.team is not None
        points = episode.team.poses[:, seat][:, [0, 2]]
        points = points[~np.isnan(points[:, 0])]
        colour = PARTNERS[number % len(PARTNERS)]
        ax.plot(*points.T, "-", color=colour, lw=1.0, alpha=0.8, zorder=3, gid=f"path of seat {seat}")
        ax.plot(*points[:1].T, "o", ms=2.8, mfc=colour, mec="black", mew=0.5, zorder=6, gid=f"start of seat {seat}")
        ax.plot(*points[-1:].T, "X", ms=2.8, mfc=colour, mec="black", mew=0.3, zorder=7, gid=f"end of seat {seat}")


def draw_goal(ax: Axes, episode: EpisodeLog) -> Axes:
    """Draw a star at the episode's goal, if `find_goal` finds one; return ``ax``."""
    goal = find_goal(episode)
    if goal is not None:
        ax.plot(*goal, "*", ms=9.0, mfc=GOAL, mec="black", mew=0.4, zorder=6, gid="goal")
    return ax


def find_goal(episode: EpisodeLog) -> tuple[float, float] | None:
    """Return the position (x, z) of the episode's goal, or None if the map does not show it.

    The goal is the first object with "goal" in its name, or else the only one that the mission names, or else the only
    object. On a map with several floors, z is where the goal is drawn.
    """
    if episode.start.map is None:
        return None
    things = episode.start.map.things
    candidates = [thing for thing in things if "goal" in thing.name]
    mentioned = [thing for thing in things if thing.name and thing.name in episode.start.mission]
    if len(mentioned) == 1:  # "put the ball near the box", or a kitchen's mission, has no single place to reach
        candidates += mentioned
    if len(things) == 1:
        candidates += things
    if not candidates:
        return None
    goal = candidates[0]
    return goal.x, goal.z + float(find_floor_shifts(episode.start.map)[goal.floor])


def episode_panel(ax: Axes, episode: EpisodeLog) -> Axes:
    """Draw the panel of one episode: its number, map, goal and path, and how it ended; return ``ax``."""
    if episode.start.map is not None:
        draw_map(ax, episode.start.map)
        draw_goal(ax, episode)
    draw_path(ax, episode)
    if episode.start.map is None or np.isnan(episode.poses[:, 0]).all():
        ax.text(
            0.5, 0.5, "this world tells\nno map or pose", ha="center", va="center", transform=ax.transAxes, color=MUTED
        )
        ax.axis("off")
    steps = len(episode.actions)
    if episode.outcome == "goal":
        outcome_text = f"{steps} steps"
    else:
        outcome_text = f"{episode.outcome_word} ({steps})"
    ax.set_title(f"{episode.number}", loc="left", fontweight="bold", pad=2)
    ax.set_title(outcome_text, loc="right", x=0.96, fontsize=6.0, pad=2)
    return ax


def paths_figure(
    columns: Sequence[tuple[str, Sequence[EpisodeLog]]], *, across: int = 2, width_cm: float = COLUMN_CM
) -> Figure:
    """Return a figure with a panel per episode, and a titled group of columns for each sequence of episodes.

    Args:
        columns: the title and the episodes of each group of columns.
        across: the number of panels side by side in each group; 4 in all fill a journal's column.
        width_cm: the width of the figure in centimetres.
    """
    groups = [(title, list(episodes)) for title, episodes in columns if episodes]
    rows = max((math.ceil(len(episodes) / across) for _, episodes in groups), default=1)
    panels_cm = rows * (width_cm / max(1, across * len(groups)) + _PANEL_TITLE_CM) + _GROUP_TITLE_CM
    all_episodes = [episode for _, episodes in groups for episode in episodes]
    marks = _build_mark_legend(has_goal=any(find_goal(episode) is not None for episode in all_episodes))
    things = [*_build_partner_legend(all_episodes), *build_object_legend(episode.start.map for episode in all_episodes)]
    key_cm = _KEY_CM + _NAMES_CM * math.ceil(len(things) / _ACROSS)
    with figure_style():
        figure = new_figure(width_cm=width_cm, height_cm=panels_cm + key_cm)
        figure.set_layout_engine("constrained", w_pad=0.01, h_pad=0.01, wspace=0.0, hspace=0.0)
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[panels_cm, key_cm])[:, 0]
        parts = above.subfigures(1, max(1, len(groups)), squeeze=False)[0]
        for part, (title, episodes) in zip(parts, groups, strict=False):
            part.suptitle(title, fontsize=7.5)
            axes = part.subplots(rows, across, squeeze=False).ravel()
            for ax in axes[len(episodes) :]:
                ax.axis("off")
            for ax, episode in zip(axes, episodes, strict=False):
                episode_panel(ax, episode)
        _draw_key(below, [*marks, *things], key_cm)
    return figure


def _build_partner_legend(episodes: Sequence[EpisodeLog]) -> list[Line2D]:
    """Return a legend entry for each partner's path, as many as the largest team of the episodes has.

    A single partner is called "partner", several are called "other 1", "other 2" and so on.
    """
    n_partners = max((len(list_partner_seats(episode)) for episode in episodes), default=0)
    if n_partners == 1:
        labels = ["partner"]
    else:
        labels = [f"other {number}" for number in range(1, n_partners + 1)]
    colours = cycle(PARTNERS)
    return [Line2D([], [], color=colour, lw=1.2, label=label) for label, colour in zip(labels, colours, strict=False)]


def session_paths(log: SessionLog) -> Figure:
    """Return a figure of a session's paths, with a titled group of columns for the first ten episodes of each block."""
    return blocks_figure(group_by_block(log))


def blocks_figure(blocks: Sequence[tuple[str, Sequence[EpisodeLog]]]) -> Figure:
    """Return a figure of the paths of blocks side by side, with as many panels across as stay readable in a column.

    Each block is given by its name and its episodes.
    """
    return paths_figure(blocks, across=max(1, _ACROSS // max(1, len(blocks))))


def _draw_key(part: SubFigure, entries: Sequence[Line2D], key_cm: float) -> None:
    """Draw the key to colours, marks, partners and objects in the strip below the panels, which is ``key_cm`` high."""
    from_top = 0.25 / key_cm  # the colour bar keeps its size whatever is named below it
    bar = part.colorbar(
        ScalarMappable(cmap=TIME_COLOURS),
        cax=part.add_axes((0.2, 1 - from_top, 0.6, 0.14 / key_cm)),
        orientation="horizontal",
    )
    bar.set_ticks([0, 1], labels=["first step", "last step"])
    bar.set_label("time within the episode", labelpad=-8)
    part.legend(
        handles=[*entries],
        loc="lower center",
        ncols=_ACROSS,
        handletextpad=0.2,
        columnspacing=1.2,
    )


def _build_mark_legend(*, has_goal: bool) -> list[Line2D]:
    """Return legend entries for the marks that every path has, and for the goal where one is drawn."""

    def make_entry(label: str, marker: str, size: float, face: str, edge: str = "black") -> Line2D:
        return Line2D([], [], ls="", marker=marker, ms=size, mfc=face, mec=edge, mew=0.6, label=label)

    goal_entries = [make_entry("goal", "*", 7, GOAL)] if has_goal else []
    return [
        make_entry("start", "o", 4, START),
        *goal_entries,
        make_entry("end", "X", 5, END),
        make_entry("turned in place", "o", 5, "none", WALL),
    ]


def _spread_visits(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (n, 2), with further visits to a cell shifted along its diagonal, cycling through five offsets.

    The offsets are 0, 1, 2, -2 and -1 times ``_SPREAD_CELLS``; the first visit is not shifted.
    """
    shifted = points.copy()
    visits: dict[tuple[float, float], int] = {}
    for row in range(len(points)):
        cell = (float(points[row, 0]), float(points[row, 1]))
        has_arrived = row == 0 or bool((points[row] != points[row - 1]).any())
        if has_arrived:
            visits[cell] = visits.get(cell, -1) + 1
        shifted[row] += _SPREAD_CELLS * ((visits[cell] + 2) % 5 - 2) * np.array([1.0, 1.0])
    return shifted
