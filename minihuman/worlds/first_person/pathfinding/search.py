"""Search kernels: A* over places and headings, distance and clearance maps on small cells, a lower bound on distance.

Paths consist of real moves: turns by one angle and steps of one length, with a body that must fit at every stop. The
heuristic is the distance of every place from the goal around obstacles. A carried entity floats ahead and must fit,
too; then the path brings it to the goal. The lower bound is the shortest path of a point around the ends of walls.

The module shares no code with `grid.core.search`. A grid's states are whole numbers, found by their content and queued
in buckets by whole costs. Here, places are real numbers, identified by cell and heading, and costs are real. The queue
is therefore a binary heap in arrays of the caller: an entry is a key and a number, the smaller number comes first among
equal keys, and the first `size` places are in use.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.walls import touches_wall
from minihuman.worlds.kernels import device_function, kernel

Keys = NDArray[np.float64]
Numbers = NDArray[np.int64]


@device_function(nogil=True)
def push(keys: Keys, numbers: Numbers, size: int, key: float, number: int) -> int:
    """Add an entry to the heap, which must have room for it; return the new size."""
    place = size
    while place > 0:
        above = (place - 1) >> 1
        if not _before(key, number, keys[above], numbers[above]):
            break
        keys[place] = keys[above]
        numbers[place] = numbers[above]
        place = above
    keys[place] = key
    numbers[place] = number
    return size + 1


@device_function(nogil=True)
def drop_first(keys: Keys, numbers: Numbers, size: int) -> int:
    """Remove the first entry, which is at index 0, so that the next one is there; return the new size."""
    size -= 1
    key = keys[size]
    number = numbers[size]
    place = 0
    while 2 * place + 1 < size:
        below = 2 * place + 1
        if below + 1 < size and _before(keys[below + 1], numbers[below + 1], keys[below], numbers[below]):
            below += 1
        if not _before(keys[below], numbers[below], key, number):
            break
        keys[place] = keys[below]
        numbers[place] = numbers[below]
        place = below
    keys[place] = key
    numbers[place] = number
    return size


@device_function(nogil=True)
def _before(key: float, number: int, other_key: float, other_number: int) -> bool:
    """Return whether an entry of the heap comes before another one."""
    return key < other_key or (key == other_key and number < other_number)


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
    """Return a mask of the cells (column, row) over ``bounds`` (x0, z0, x1, z1) in which a body of a radius can stand.

    ``discs`` are (n, 3 or more): x, z and the distance that the body's middle keeps from there. ``zones`` are (rooms,
    edges, 4): convex areas that it avoids, each edge given by a point on it and its inward normal.
    """
    columns = int((bounds[2] - bounds[0]) / cell) + 1
    rows = int((bounds[3] - bounds[1]) / cell) + 1
    free = np.ones((columns, rows), np.bool_)
    _clear(walls, discs, zones, bounds, cell, radius, free)
    return free


def distance_map(free: NDArray[np.bool_], goal_column: int, goal_row: int, goal_cells: float) -> NDArray[np.float64]:
    """Return each cell's distance from the goal in cells; 0 within ``goal_cells``, infinite without a path."""
    capacity = free.size
    while True:
        distance = np.full(free.shape, np.inf)
        keys = np.empty(capacity)
        numbers = np.empty(capacity, np.int64)
        if _measure(free, goal_column, goal_row, goal_cells, distance, keys, numbers):
            return distance
        capacity *= 2  # the queue may contain a cell several times, once for each shorter path to it


@kernel(
    "(float64[:, ::1], float64[:, ::1], float64[:, :, ::1], float64[::1], float64, float64, boolean[:, ::1])",
    nogil=True,
)
def _clear(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    bounds: NDArray[np.float64],
    cell: float,
    radius: float,
    free: NDArray[np.bool_],
) -> None:
    """Mark the cells in which the body cannot stand as not free; the arguments are those of `clearance_map`."""
    columns, rows = free.shape
    for index in range(walls.shape[0]):
        first_c = max(int((min(walls[index, 0], walls[index, 2]) - radius - bounds[0]) / cell), 0)
        last_c = min(int((max(walls[index, 0], walls[index, 2]) + radius - bounds[0]) / cell) + 1, columns - 1)
        first_r = max(int((min(walls[index, 1], walls[index, 3]) - radius - bounds[1]) / cell), 0)
        last_r = min(int((max(walls[index, 1], walls[index, 3]) + radius - bounds[1]) / cell) + 1, rows - 1)
        for column in range(first_c, last_c + 1):
            for row in range(first_r, last_r + 1):
                x = bounds[0] + (column + 0.5) * cell
                z = bounds[1] + (row + 0.5) * cell
                if free[column, row] and touches_wall(walls[index : index + 1], x, z, radius):
                    free[column, row] = False
    for column in range(columns):
        for row in range(rows):
            x = bounds[0] + (column + 0.5) * cell
            z = bounds[1] + (row + 0.5) * cell
            for index in range(discs.shape[0]):
                dx = x - discs[index, 0]
                dz = z - discs[index, 1]
                if dx * dx + dz * dz < discs[index, 2] * discs[index, 2]:
                    free[column, row] = False
            if in_zone(zones, x, z):
                free[column, row] = False


@device_function(nogil=True)
def in_zone(zones: NDArray[np.float64], x: float, z: float) -> bool:
    """Return whether a place is inside one of the convex areas ``zones``, as `clearance_map` describes them."""
    for zone in range(zones.shape[0]):
        inside = True
        for edge in range(zones.shape[1]):
            off_x = x - zones[zone, edge, 0]
            off_z = z - zones[zone, edge, 1]
            if zones[zone, edge, 2] * off_x + zones[zone, edge, 3] * off_z <= 0:
                inside = False
        if inside:
            return True
    return False


@kernel("(boolean[:, ::1], int64, int64, float64, float64[:, ::1], float64[::1], int64[::1])", nogil=True)
def _measure(
    free: NDArray[np.bool_],
    goal_column: int,
    goal_row: int,
    goal_cells: float,
    distance: NDArray[np.float64],
    keys: Keys,
    numbers: Numbers,
) -> bool:
    """Fill in ``distance``, which is infinite before; return whether the queue had room for all cells."""
    columns, rows = free.shape
    waiting = 0
    reach = int(goal_cells) + 1
    for column in range(max(goal_column - reach, 0), min(goal_column + reach, columns - 1) + 1):
        for row in range(max(goal_row - reach, 0), min(goal_row + reach, rows - 1) + 1):
            if free[column, row] and math.hypot(column - goal_column, row - goal_row) <= goal_cells:
                distance[column, row] = 0.0
                waiting = push(keys, numbers, waiting, 0.0, column * rows + row)
    while waiting > 0:
        reached = keys[0]
        column = numbers[0] // rows  # the number of a cell is column * rows + row
        row = numbers[0] % rows
        waiting = drop_first(keys, numbers, waiting)
        if reached > distance[column, row]:
            continue
        for right, down, length in _AROUND:
            c = column + right
            r = row + down
            if 0 <= c < columns and 0 <= r < rows and free[c, r] and reached + length < distance[c, r]:
                if waiting == len(keys):
                    return False
                distance[c, r] = reached + length
                waiting = push(keys, numbers, waiting, reached + length, c * rows + r)
    return True


def shortest_way(barriers: NDArray[np.float64], nodes: NDArray[np.float64]) -> float:
    """Return the length of the shortest path from node 0 to node 1 that crosses no barrier; infinite if none.

    ``barriers`` are (n, 4): x0, z0, x1, z1, and can be touched; ``nodes`` are (m, 2): x, z, at which the path can bend.
    """
    return _shortest(barriers, nodes, np.full(len(nodes), np.inf), np.zeros(len(nodes), np.bool_))


def lies_on(barriers: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of the points, (m, 2), lie on a barrier, (n, 4), and not at its ends."""
    marks = np.zeros(len(points), np.bool_)
    _mark(barriers, points, marks)
    return marks


@kernel("(float64[:, ::1], float64[:, ::1], float64[::1], boolean[::1])", nogil=True)
def _shortest(
    barriers: NDArray[np.float64], nodes: NDArray[np.float64], reached: NDArray[np.float64], settled: NDArray[np.bool_]
) -> float:
    """Return the length of `shortest_way` (Dijkstra); at the start, ``reached`` is infinite and ``settled`` false."""
    count = nodes.shape[0]
    reached[0] = 0.0
    while True:
        nearest = -1
        for node in range(count):
            if not settled[node] and reached[node] < np.inf and (nearest < 0 or reached[node] < reached[nearest]):
                nearest = node
        if nearest < 0 or nearest == 1:
            return float(reached[1])
        settled[nearest] = True
        for node in range(count):
            length = math.hypot(nodes[node, 0] - nodes[nearest, 0], nodes[node, 1] - nodes[nearest, 1])
            if (
                not settled[node]
                and reached[nearest] + length < reached[node]
                and _sees(barriers, nodes, nearest, node)
            ):
                reached[node] = reached[nearest] + length


@kernel("(float64[:, ::1], float64[:, ::1], boolean[::1])", nogil=True)
def _mark(barriers: NDArray[np.float64], points: NDArray[np.float64], marks: NDArray[np.bool_]) -> None:
    """Set ``marks`` to true for the points that `lies_on` returns."""
    for place in range(points.shape[0]):
        x = points[place, 0]
        z = points[place, 1]
        for index in range(barriers.shape[0]):
            ax = barriers[index, 0]
            az = barriers[index, 1]
            bx = barriers[index, 2]
            bz = barriers[index, 3]
            length = math.hypot(bx - ax, bz - az)
            along = ((x - ax) * (bx - ax) + (z - az) * (bz - az)) / length
            across = ((x - ax) * (bz - az) - (z - az) * (bx - ax)) / length
            if abs(across) < 1e-9 and 1e-6 < along < length - 1e-6:
                marks[place] = True


@device_function(nogil=True)
def _sees(barriers: NDArray[np.float64], nodes: NDArray[np.float64], a: int, b: int) -> bool:
    """Return whether the straight line between two nodes crosses no barrier."""
    ax = nodes[a, 0]
    az = nodes[a, 1]
    bx = nodes[b, 0]
    bz = nodes[b, 1]
    for index in range(barriers.shape[0]):
        cx = barriers[index, 0]
        cz = barriers[index, 1]
        dx = barriers[index, 2]
        dz = barriers[index, 3]
        if (
            _side(ax, az, bx, bz, cx, cz) * _side(ax, az, bx, bz, dx, dz) < 0
            and _side(cx, cz, dx, dz, ax, az) * _side(cx, cz, dx, dz, bx, bz) < 0
        ):
            return False
    return True


@device_function(nogil=True)
def _side(ax: float, az: float, bx: float, bz: float, x: float, z: float) -> float:
    """Return a number above 0 on one side of the line from a to b, below 0 on the other, and 0 on it when rounded."""
    turn = (bx - ax) * (z - az) - (bz - az) * (x - ax)
    return 0.0 if abs(turn) < 1e-9 else turn


# the moves of a path
TURN_LEFT = 0
TURN_RIGHT = 1
FORWARD = 2
BACK = 3
_MOST_STOPS = 2_000_000  # a search that has reached so many stops gives up


class Body(NamedTuple):
    """The moves and size of an agent in metres and radians; ``ahead`` and ``carried`` are 0 if it carries nothing."""

    step: float
    turn: float
    radius: float
    moves: int  # the number of moves: 4 if it may step back, else 3
    ahead: float  # from its middle to the middle of what it carries
    carried: float  # the radius of what it carries


class Stops(NamedTuple):
    """The stops of all paths in the search; the arrays have room for the maximum, but use memory only as they fill."""

    x: NDArray[np.float64]
    z: NDArray[np.float64]
    heading: NDArray[np.int64]  # turns to the left since the start
    parent: NDArray[np.int64]
    action: NDArray[np.int8]
    cost: NDArray[np.int64]
    keys: NDArray[np.float64]  # of a heap of the stops to expand: the expected cost of the path through each
    numbers: NDArray[np.int64]


def search(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    start: tuple[float, float, float],
    goal: tuple[float, float, float],
    body: Body,
    bounds: NDArray[np.float64],
    distance: NDArray[np.float64],
    cell: float,
) -> list[int]:
    """Return moves that bring the agent, or what it carries, from ``start`` to ``goal``; empty if no path is found.

    ``start`` is (x, z, yaw), and ``goal`` is (x, z, radius): the path ends within that radius.

    ``discs`` are (n, 4): x, z, and the distances that the middles of the body and of its load keep from there.
    ``distance`` comes from ``distance_map`` over cells of size ``cell``.
    """
    most = _MOST_STOPS
    stops = Stops(  # in the order of its fields
        *(np.empty(most), np.empty(most), np.empty(most, np.int64), np.empty(most, np.int64)),
        *(np.empty(most, np.int8), np.empty(most, np.int64), np.empty(most), np.empty(most, np.int64)),
    )
    visited = np.zeros((*distance.shape, round(2 * math.pi / body.turn)), np.bool_)
    last = _search(walls, discs, zones, start, goal, body, bounds, distance, cell, stops, visited)
    moves = []
    while last > 0:
        moves.append(int(stops.action[last]))
        last = stops.parent[last]
    return moves[::-1]


@kernel(
    "(float64[:, ::1], float64[:, ::1], float64[:, :, ::1], UniTuple(float64, 3), UniTuple(float64, 3), "
    "NamedTuple((float64, float64, float64, int64, float64, float64), Body), float64[::1], float64[:, ::1], "
    "float64, NamedTuple((float64[::1], float64[::1], int64[::1], int64[::1], int8[::1], int64[::1], "
    "float64[::1], int64[::1]), Stops), boolean[:, :, ::1])",
    nogil=True,
)
def _search(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    zones: NDArray[np.float64],
    start: tuple[float, float, float],
    goal: tuple[float, float, float],
    body: Body,
    bounds: NDArray[np.float64],
    distance: NDArray[np.float64],
    cell: float,
    stops: Stops,
    visited: NDArray[np.bool_],
) -> int:
    """Return the index of the stop at the goal, or -1 if none is found; fill in ``stops`` and ``visited``."""
    columns, rows, headings = visited.shape
    stops.x[0] = start[0]
    stops.z[0] = start[1]
    stops.heading[0] = 0
    stops.parent[0] = -1
    stops.action[0] = -1
    stops.cost[0] = 0
    count = 1
    waiting = push(stops.keys, stops.numbers, 0, 0.0, 0)
    while waiting > 0 and count < len(stops.x) - 3:  # so that there is room for four moves from a stop
        stop = stops.numbers[0]
        waiting = drop_first(stops.keys, stops.numbers, waiting)
        x = stops.x[stop]
        z = stops.z[stop]
        heading = stops.heading[stop]
        place = int((x - bounds[0]) / cell), int((z - bounds[1]) / cell), heading % headings
        if visited[place]:
            continue
        visited[place] = True
        yaw = start[2] + heading * body.turn
        ahead_x = x + body.ahead * math.cos(yaw)
        ahead_z = z - body.ahead * math.sin(yaw)
        if math.hypot(ahead_x - goal[0], ahead_z - goal[1]) < goal[2]:
            return int(stop)
        for move in range(body.moves):
            new_x = x
            new_z = z
            new_heading = heading
            if move in (FORWARD, BACK):
                if move == FORWARD:
                    step = body.step
                else:
                    step = -body.step
                new_x = new_x + math.cos(yaw) * step
                new_z = new_z - math.sin(yaw) * step
                if _blocked(walls, discs, 2, new_x, new_z, body.radius) or in_zone(zones, new_x, new_z):
                    continue
            else:
                new_heading += 1 if move == TURN_LEFT else -1
            new_yaw = start[2] + new_heading * body.turn
            if body.carried > 0.0:
                ahead_x = new_x + body.ahead * math.cos(new_yaw)
                ahead_z = new_z - body.ahead * math.sin(new_yaw)
                if _blocked(walls, discs, 3, ahead_x, ahead_z, body.carried):
                    continue
            column = int((new_x - bounds[0]) / cell)
            row = int((new_z - bounds[1]) / cell)
            if not (0 <= column < columns and 0 <= row < rows) or visited[column, row, new_heading % headings]:
                continue
            left = _still_to_go(distance, column, row, new_yaw, cell, body.step, body.turn)
            stops.x[count] = new_x
            stops.z[count] = new_z
            stops.heading[count] = new_heading
            stops.parent[count], stops.action[count], stops.cost[count] = stop, move, stops.cost[stop] + 1
            waiting = push(stops.keys, stops.numbers, waiting, stops.cost[count] + 1.5 * left, count)  # weighted A*
            count += 1
    return -1


@device_function(nogil=True)
def _blocked(
    walls: NDArray[np.float64], discs: NDArray[np.float64], column: int, x: float, z: float, radius: float
) -> bool:
    """Return whether a circle overlaps a wall, or is nearer to a disc than the distance in a column of ``discs``."""
    for index in range(discs.shape[0]):
        if math.hypot(discs[index, 0] - x, discs[index, 1] - z) < discs[index, column]:
            return True
    return touches_wall(walls, x, z, radius)


@device_function(nogil=True)
def _still_to_go(
    distance: NDArray[np.float64], column: int, row: int, yaw: float, cell: float, step: float, turn: float
) -> float:
    """Estimate the remaining number of moves from the distance in cells and the turn towards the path."""
    columns, rows = distance.shape
    best = np.inf
    best_yaw = yaw
    cells_left = distance[column, row]
    for right in range(-3, 4):
        for down in range(-3, 4):
            c = column + right
            r = row + down
            if (right or down) and 0 <= c < columns and 0 <= r < rows:
                through = distance[c, r] + math.hypot(right, down)
                if through < best:
                    best = through
                    best_yaw = math.atan2(-float(down), float(right))
    if cells_left == np.inf:
        cells_left = best
    if cells_left == 0.0:
        return 0.0
    off = abs((best_yaw - yaw + math.pi) % (2 * math.pi) - math.pi)
    return float(cells_left * cell / step + max(off - turn, 0.0) / turn)
