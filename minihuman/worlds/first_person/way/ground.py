"""The ground in small cells: where a body may stand, and how far each cell is from a goal, round what is there."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.collision import touches_wall
from minihuman.worlds.first_person.way.heap import Keys, Numbers, drop_first, push
from minihuman.worlds.kernels import kernel, part

_AROUND = (  # columns right, rows down, distance
    *((1, 0, 1.0), (0, 1, 1.0), (-1, 0, 1.0), (0, -1, 1.0)),
    *((1, 1, math.sqrt(2)), (-1, 1, math.sqrt(2)), (1, -1, math.sqrt(2)), (-1, -1, math.sqrt(2))),
    *((1, 2, math.sqrt(5)), (2, 1, math.sqrt(5)), (-1, 2, math.sqrt(5)), (-2, 1, math.sqrt(5))),
    *((1, -2, math.sqrt(5)), (2, -1, math.sqrt(5)), (-1, -2, math.sqrt(5)), (-2, -1, math.sqrt(5))),
)


def clearance_map(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    bounds: NDArray[np.float64],
    cell: float,
    radius: float,
) -> NDArray[np.bool_]:
    """Which cells of a grid over ``bounds`` (x0, z0, x1, z1) a body of this radius may stand in the middle of.

    ``discs`` are (n, 3 or more): x, z and how far from it the body's middle has to stay. ``zones`` are (rooms, edges,
    4): convex areas it stays out of, each edge a point on it and its normal inwards.
    """
    columns, rows = int((bounds[2] - bounds[0]) / cell) + 1, int((bounds[3] - bounds[1]) / cell) + 1
    free = np.ones((columns, rows), np.bool_)
    _clear(walls, discs, zones, bounds, cell, radius, free)
    return free


def distance_map(free: NDArray[np.bool_], goal_column: int, goal_row: int, goal_cells: float) -> NDArray[np.float64]:
    """How far each cell is from the goal's, in cells; 0 within ``goal_cells`` of it, infinite where there is no way."""
    waiting = free.size
    while True:
        distance = np.full(free.shape, np.inf)
        keys, numbers = np.empty(waiting), np.empty(waiting, np.int64)
        if _measure(free, goal_column, goal_row, goal_cells, distance, keys, numbers):
            return distance
        waiting *= 2  # a cell waits once for each shorter way to it


@kernel(lean=True)
def _clear(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    bounds: NDArray[np.float64],
    cell: float,
    radius: float,
    free: NDArray[np.bool_],
) -> None:
    columns, rows = free.shape
    for index in range(walls.shape[0]):
        first_c = max(int((min(walls[index, 0], walls[index, 2]) - radius - bounds[0]) / cell), 0)
        last_c = min(int((max(walls[index, 0], walls[index, 2]) + radius - bounds[0]) / cell) + 1, columns - 1)
        first_r = max(int((min(walls[index, 1], walls[index, 3]) - radius - bounds[1]) / cell), 0)
        last_r = min(int((max(walls[index, 1], walls[index, 3]) + radius - bounds[1]) / cell) + 1, rows - 1)
        for column in range(first_c, last_c + 1):
            for row in range(first_r, last_r + 1):
                x, z = bounds[0] + (column + 0.5) * cell, bounds[1] + (row + 0.5) * cell
                if free[column, row] and touches_wall(walls[index : index + 1], x, z, radius):
                    free[column, row] = False
    for column in range(columns):
        for row in range(rows):
            x, z = bounds[0] + (column + 0.5) * cell, bounds[1] + (row + 0.5) * cell
            for index in range(discs.shape[0]):
                dx, dz = x - discs[index, 0], z - discs[index, 1]
                if dx * dx + dz * dz < discs[index, 2] * discs[index, 2]:
                    free[column, row] = False
            if in_zone(zones, x, z):
                free[column, row] = False


@part(lean=True)
def in_zone(zones: NDArray[np.float64], x: float, z: float) -> bool:
    """Whether a place is inside one of the convex areas."""
    for zone in range(zones.shape[0]):
        inside = True
        for edge in range(zones.shape[1]):
            off_x, off_z = x - zones[zone, edge, 0], z - zones[zone, edge, 1]
            if zones[zone, edge, 2] * off_x + zones[zone, edge, 3] * off_z <= 0:
                inside = False
        if inside:
            return True
    return False


@kernel(lean=True)
def _measure(
    free: NDArray[np.bool_],
    goal_column: int,
    goal_row: int,
    goal_cells: float,
    distance: NDArray[np.float64],
    keys: Keys,
    numbers: Numbers,
) -> bool:
    """Whether there was room for all cells that had to wait."""
    columns, rows = free.shape
    waiting = 0
    reach = int(goal_cells) + 1
    for column in range(max(goal_column - reach, 0), min(goal_column + reach, columns - 1) + 1):
        for row in range(max(goal_row - reach, 0), min(goal_row + reach, rows - 1) + 1):
            if free[column, row] and math.hypot(column - goal_column, row - goal_row) <= goal_cells:
                distance[column, row] = 0.0
                waiting = push(keys, numbers, waiting, 0.0, column * rows + row)
    while waiting > 0:
        reached, column, row = keys[0], numbers[0] // rows, numbers[0] % rows
        waiting = drop_first(keys, numbers, waiting)
        if reached > distance[column, row]:
            continue
        for right, down, length in _AROUND:
            c, r = column + right, row + down
            if 0 <= c < columns and 0 <= r < rows and free[c, r] and reached + length < distance[c, r]:
                if waiting == len(keys):
                    return False
                distance[c, r] = reached + length
                waiting = push(keys, numbers, waiting, reached + length, c * rows + r)
    return True
