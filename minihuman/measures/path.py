"""The path of an episode: how far, how straight, and where it only turned."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.recorded.episode import Episode

TURN = np.dtype([("row", np.int64), ("turned_rad", np.float64), ("steps", np.int64)])
_STILL = 1e-9  # floating-point noise, in the map's unit
_APART = np.full((1, 4), math.nan)  # between two episodes' poses: nobody strides or turns from one into the next

Poses = NDArray[np.float64]  # (n + 1, 4) of an episode; of several with a row between them


class Walk(NamedTuple):
    """An episode's path in numbers."""

    length: float  # ground covered, in cells or metres; NaN where the world tells no pose
    efficiency: float  # straight distance over ground covered: 1 is a straight line; NaN for one who never moved
    turns: int  # runs of turning in place


def walks(episodes: Sequence[Episode]) -> list[Walk]:
    """The paths of several episodes; it takes hardly longer for twenty than for one."""
    poses = np.concatenate([_APART, *(part for episode in episodes for part in (episode.poses, _APART))])
    begins = np.cumsum([1, *(len(episode.poses) + 1 for episode in episodes)])
    covered, (_, turned, _) = _strides(poses), _turning(poses)
    turns = np.bincount(np.searchsorted(begins, turned, side="right") - 1, minlength=len(episodes))
    walked = []
    for episode, begin, number in zip(episodes, begins[:-1].tolist(), turns.tolist(), strict=True):
        length = float(covered[begin : begin + len(episode.poses) - 1].sum())
        efficiency = net_displacement(episode) / length if length > _STILL else math.nan
        walked.append(Walk(length, efficiency, number))
    return walked


def net_displacement(episode: Episode) -> float:
    """Straight distance from the first place to the last, in cells or metres."""
    (x0, _, z0, _), (x1, _, z1, _) = episode.poses[0], episode.poses[-1]
    return float(np.hypot(x1 - x0, z1 - z0))


def turned_rad(episode: Episode) -> NDArray[np.float64]:
    """Angle turned by each step, (n,), in [-pi, pi], counter-clockwise positive seen from above."""
    return _turned_rad(episode.poses)


def turns_in_place(episode: Episode) -> NDArray[np.void]:
    """Runs of turning on the spot: ``row`` of the pose they end at, ``turned_rad`` in all (unsigned), ``steps``.

    A run lasts while the place stays the same; it counts where the heading changed at least once in it.
    """
    turned = np.abs(turned_rad(episode))
    runs = zip(*(places.tolist() for places in _turning(episode.poses)), strict=True)
    return np.array([(end, turned[begin:end].sum(), steps) for begin, end, steps in runs], dtype=TURN)


def _strides(poses: Poses) -> NDArray[np.float64]:
    """Distance from each place to the next, (n,)."""
    moved = poses[1:] - poses[:-1]
    return np.asarray(np.hypot(moved[:, 0], moved[:, 2]))


def _turned_rad(poses: Poses) -> NDArray[np.float64]:
    yaw_rad = poses[:, 3]
    change: NDArray[np.float64] = yaw_rad[1:] - yaw_rad[:-1]
    return (change + math.pi) % (2 * math.pi) - math.pi


def _turning(poses: Poses) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The runs of turning on the spot: their first and last row, and in how many steps the heading changed."""
    still = _strides(poses) < _STILL
    between = np.concatenate([[False], still, [False]])
    edges = np.flatnonzero(between[1:] != between[:-1]).reshape(-1, 2)
    turned = still & (np.abs(_turned_rad(poses)) > _STILL)
    before = np.concatenate([[0], np.cumsum(turned)])  # steps that turned, up to each row
    steps = before[edges[:, 1]] - before[edges[:, 0]]
    return edges[steps > 0, 0], edges[steps > 0, 1], steps[steps > 0]
