"""The path of an episode: how far, how straight, and where it only turned."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.log.episode import Episode

TURN = np.dtype([("row", np.int64), ("turned_rad", np.float64), ("steps", np.int64)])
_STILL = 1e-9  # floating-point noise, in the map's unit


def strides(episode: Episode) -> NDArray[np.float64]:
    """Distance covered on the ground by each step, (n,), in the map's unit; NaN where the world tells no pose."""
    moved = episode.poses[1:] - episode.poses[:-1]
    return np.asarray(np.hypot(moved[:, 0], moved[:, 2]))


def turned_rad(episode: Episode) -> NDArray[np.float64]:
    """Angle turned by each step, (n,), in [-pi, pi], counter-clockwise positive seen from above."""
    yaw_rad = episode.poses[:, 3]
    change: NDArray[np.float64] = yaw_rad[1:] - yaw_rad[:-1]
    return (change + math.pi) % (2 * math.pi) - math.pi


def path_length(episode: Episode) -> float:
    """Ground covered, in cells or metres; NaN where the world tells no pose."""
    return float(strides(episode).sum())


def net_displacement(episode: Episode) -> float:
    """Straight distance from the first place to the last, in cells or metres."""
    first, last = episode.poses[0, [0, 2]], episode.poses[-1, [0, 2]]
    return float(np.hypot(*(last - first)))


def path_efficiency(episode: Episode) -> float:
    """Straight distance over ground covered: 1 is a straight line, small is wandering; NaN for one who never moved."""
    length = path_length(episode)
    return net_displacement(episode) / length if length > _STILL else math.nan


def turns_in_place(episode: Episode) -> NDArray[np.void]:
    """Runs of turning on the spot: ``row`` of the pose they end at, ``turned_rad`` in all (unsigned), ``steps``.

    A run lasts while the place stays the same; it counts where the heading changed at least once in it.
    """
    still = strides(episode) < _STILL
    turned = np.where(still, np.abs(turned_rad(episode)), 0.0)
    between = np.concatenate([[False], still, [False]])
    edges = np.flatnonzero(between[1:] != between[:-1]).reshape(-1, 2)
    before = np.concatenate([[0], np.cumsum(turned > _STILL)])  # steps that turned, up to each row
    turning = before[edges[:, 1]] - before[edges[:, 0]]
    runs = zip(edges[turning > 0].tolist(), turning[turning > 0].tolist(), strict=True)
    return np.array([(end, turned[start:end].sum(), steps) for (start, end), steps in runs], dtype=TURN)
