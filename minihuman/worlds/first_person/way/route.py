"""A way to a goal by the real moves: turns of one angle, steps of one length, a body that must fit at every stop.

A* over places and headings. What guides it is how far every place is from the goal, going round what is in the way.
"""

import heapq
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.collision import touches_wall
from minihuman.worlds.kernels import kernel

TURN_LEFT, TURN_RIGHT, FORWARD = 0, 1, 2  # what the route is made of
_MOST_STOPS = 2_000_000  # a search that has seen so many has no way

_NEIGHBOURS = (  # columns right, rows down, distance
    *((1, 0, 1.0), (0, 1, 1.0), (-1, 0, 1.0), (0, -1, 1.0)),
    *((1, 1, math.sqrt(2)), (-1, 1, math.sqrt(2)), (1, -1, math.sqrt(2)), (-1, -1, math.sqrt(2))),
    *((1, 2, math.sqrt(5)), (2, 1, math.sqrt(5)), (-1, 2, math.sqrt(5)), (-2, 1, math.sqrt(5))),
    *((1, -2, math.sqrt(5)), (2, -1, math.sqrt(5)), (-1, -2, math.sqrt(5)), (-2, -1, math.sqrt(5))),
)


@kernel()
def clearance_map(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    bounds: NDArray[np.float64],
    cell: float,
    radius: float,
) -> NDArray[np.bool_]:
    """Which cells of a grid over ``bounds`` (x0, z0, x1, z1) a body of this radius may stand in the middle of.

    ``discs`` are (n, 3): x, z and how far from it the body's middle has to stay. ``zones`` are (rooms, edges, 4):
    convex areas it stays out of, each edge a point on it and its normal inwards.
    """
    columns = int((bounds[2] - bounds[0]) / cell) + 1
    rows = int((bounds[3] - bounds[1]) / cell) + 1
    free = np.ones((columns, rows), np.bool_)
    one = np.empty((1, 4))
    for index in range(walls.shape[0]):
        for part in range(4):
            one[0, part] = walls[index, part]
        first_c = max(int((min(walls[index, 0], walls[index, 2]) - radius - bounds[0]) / cell), 0)
        last_c = min(int((max(walls[index, 0], walls[index, 2]) + radius - bounds[0]) / cell) + 1, columns - 1)
        first_r = max(int((min(walls[index, 1], walls[index, 3]) - radius - bounds[1]) / cell), 0)
        last_r = min(int((max(walls[index, 1], walls[index, 3]) + radius - bounds[1]) / cell) + 1, rows - 1)
        for column in range(first_c, last_c + 1):
            for row in range(first_r, last_r + 1):
                x, z = bounds[0] + (column + 0.5) * cell, bounds[1] + (row + 0.5) * cell
                if free[column, row] and touches_wall(one, x, z, radius):
                    free[column, row] = False
    for index in range(discs.shape[0]):
        for column in range(columns):
            for row in range(rows):
                dx = bounds[0] + (column + 0.5) * cell - discs[index, 0]
                dz = bounds[1] + (row + 0.5) * cell - discs[index, 1]
                if dx * dx + dz * dz < discs[index, 2] * discs[index, 2]:
                    free[column, row] = False
    if zones.shape[0]:
        for column in range(columns):
            for row in range(rows):
                if _in_zone(zones, bounds[0] + (column + 0.5) * cell, bounds[1] + (row + 0.5) * cell):
                    free[column, row] = False
    return free


@kernel()
def _in_zone(zones: NDArray[np.float64], x: float, z: float) -> bool:
    for zone in range(zones.shape[0]):
        inside = True
        for edge in range(zones.shape[1]):
            off_x, off_z = x - zones[zone, edge, 0], z - zones[zone, edge, 1]
            if zones[zone, edge, 2] * off_x + zones[zone, edge, 3] * off_z <= 0:
                inside = False
        if inside:
            return True
    return False


@kernel()
def distance_map(free: NDArray[np.bool_], goal_column: int, goal_row: int, goal_cells: float) -> NDArray[np.float64]:
    """How far each cell is from the goal's, in cells; 0 within ``goal_cells`` of it, infinite where there is no way."""
    columns, rows = free.shape
    distance = np.full((columns, rows), np.inf)
    heap = [(0.0, goal_column, goal_row)]
    heap.pop()
    reach = int(goal_cells) + 1
    for column in range(max(goal_column - reach, 0), min(goal_column + reach, columns - 1) + 1):
        for row in range(max(goal_row - reach, 0), min(goal_row + reach, rows - 1) + 1):
            if free[column, row] and math.hypot(column - goal_column, row - goal_row) <= goal_cells:
                distance[column, row] = 0.0
                heapq.heappush(heap, (0.0, column, row))
    while heap:
        reached, column, row = heapq.heappop(heap)
        if reached > distance[column, row]:
            continue
        for right, down, length in _NEIGHBOURS:
            c, r = column + right, row + down
            if 0 <= c < columns and 0 <= r < rows and free[c, r] and reached + length < distance[c, r]:
                distance[c, r] = reached + length
                heapq.heappush(heap, (reached + length, c, r))
    return distance


@kernel()
def search(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    motion: NDArray[np.float64],
    bounds: NDArray[np.float64],
    distance: NDArray[np.float64],
    cell: float,
) -> NDArray[np.int8]:
    """The moves from ``start`` (x, z, yaw) to within ``goal`` (x, z, radius); empty where there is no way.

    ``motion`` is the length of a step, the angle of a turn and the radius of the body; ``distance`` comes from
    ``distance_map`` over cells of size ``cell``.
    """
    step, turn, radius = motion[0], motion[1], motion[2]
    headings = round(2 * math.pi / turn)
    columns, rows = distance.shape
    seen = np.zeros((columns, rows, headings), np.bool_)
    x, z = np.empty(1024), np.empty(1024)
    heading, parent, action = np.empty(1024, np.int64), np.empty(1024, np.int64), np.empty(1024, np.int8)
    cost = np.empty(1024, np.int64)
    x[0], z[0], heading[0], parent[0], action[0], cost[0] = start[0], start[1], 0, -1, -1, 0
    count = 1
    heap = [(0.0, 0)]
    while heap and count < _MOST_STOPS:
        _, here = heapq.heappop(heap)
        place = int((x[here] - bounds[0]) / cell), int((z[here] - bounds[1]) / cell), heading[here] % headings
        if seen[place]:
            continue
        seen[place] = True
        if math.hypot(x[here] - goal[0], z[here] - goal[1]) < goal[2]:
            moves = np.empty(cost[here], np.int8)
            while parent[here] >= 0:
                moves[cost[here] - 1] = action[here]
                here = parent[here]
            return moves
        for move in range(3):
            new_x, new_z, new_heading = x[here], z[here], heading[here]
            if move == FORWARD:
                yaw = start[2] + heading[here] * turn
                new_x, new_z = new_x + math.cos(yaw) * step, new_z - math.sin(yaw) * step
                if _blocked(walls, discs, new_x, new_z, radius) or _in_zone(zones, new_x, new_z):
                    continue
            else:
                new_heading += 1 if move == TURN_LEFT else -1
            column, row = int((new_x - bounds[0]) / cell), int((new_z - bounds[1]) / cell)
            if not (0 <= column < columns and 0 <= row < rows) or seen[column, row, new_heading % headings]:
                continue
            ahead = _still_to_go(distance, column, row, start[2] + new_heading * turn, cell, step, turn)
            if count == len(x):
                x, z, cost = _grown(x), _grown(z), _grown(cost)
                heading, parent, action = _grown(heading), _grown(parent), _grown(action)
            x[count], z[count], heading[count] = new_x, new_z, new_heading
            parent[count], action[count], cost[count] = here, move, cost[here] + 1
            heapq.heappush(heap, (cost[count] + 1.5 * ahead, count))
            count += 1
    return np.empty(0, np.int8)


@kernel()
def _blocked(walls: NDArray[np.float64], discs: NDArray[np.float64], x: float, z: float, radius: float) -> bool:
    for index in range(discs.shape[0]):
        if math.hypot(discs[index, 0] - x, discs[index, 1] - z) < discs[index, 2]:
            return True
    return touches_wall(walls, x, z, radius)


@kernel()
def _still_to_go(
    distance: NDArray[np.float64], column: int, row: int, yaw: float, cell: float, step: float, turn: float
) -> float:
    """About how many moves are left: the way, and the turn towards where the way leads."""
    columns, rows = distance.shape
    best, best_yaw, found = np.inf, yaw, distance[column, row]
    for right in range(-3, 4):
        for down in range(-3, 4):
            c, r = column + right, row + down
            if (right or down) and 0 <= c < columns and 0 <= r < rows:
                through = distance[c, r] + math.hypot(right, down)
                if through < best:
                    best, best_yaw = through, math.atan2(-float(down), float(right))
    if found == np.inf:
        found = best
    if found == 0.0:
        return 0.0
    off = abs((best_yaw - yaw + math.pi) % (2 * math.pi) - math.pi)
    return float(found * cell / step + max(off - turn, 0.0) / turn)


@kernel()
def _grown(values: NDArray[Any]) -> NDArray[Any]:
    larger = np.empty(2 * len(values), values.dtype)
    larger[: len(values)] = values
    return larger
