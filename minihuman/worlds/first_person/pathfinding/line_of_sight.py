"""Lines of sight over a floor of cells: what is visible from a place, and what a look from elsewhere would show."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import kernel

UNSEEN = 0
OPEN = 1
WALL = 2
BEARINGS = 72  # the number of directions in which a place is examined
RANGE_M = 6.0  # the distance up to which unseen floor counts
_BEARING_RAD = 2 * math.pi / BEARINGS


@kernel("(float64[:, ::1], float64[:, ::1], float64[::1], int64, float64[::1], float64, int8[:, ::1], boolean[:, ::1])")
def mark_seen(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    eye: NDArray[np.float64],
    rays: int,
    bounds: NDArray[np.float64],
    cell: float,
    explored: NDArray[np.int8],
    in_view: NDArray[np.bool_],
) -> int:
    """Mark the cells in sight in ``explored`` and ``in_view``, (columns, rows); return the number of new ones.

    Args:
        walls: the walls, (n, 4): x0, z0, x1, z1
        discs: the entities as high as the eye, (n, 3): x, z and radius
        eye: x, z, yaw, and the tangent of half the field of view
        rays: the number of lines of sight
        bounds: the bounds of the floor: x0, z0, x1, z1
        cell: the size of a cell in metres
        explored: UNSEEN, OPEN or WALL for each cell
        in_view: which cells are in sight now
    """
    columns, rows = explored.shape
    in_view[:] = False
    new = 0
    for ray in range(rays):
        yaw = eye[2] + math.atan(eye[3] * (2 * ray / (rays - 1) - 1))  # evenly spaced across the picture
        along_x = math.cos(yaw)
        along_z = -math.sin(yaw)
        far = _to_wall(walls, discs, eye[0], eye[1], along_x, along_z)
        count = int(min(far, 1e3) / (cell / 2)) + 1
        for part in range(count + 1):
            off = part * cell / 2
            is_wall = part == count
            if is_wall:
                off = far + 0.1 * cell
            elif off >= far:
                continue
            column = math.floor((eye[0] + off * along_x - bounds[0]) / cell)
            row = math.floor((eye[1] + off * along_z - bounds[1]) / cell)
            if not (0 <= column < columns and 0 <= row < rows):
                break
            in_view[column, row] = True
            if explored[column, row] == UNSEEN:
                new += 1
            if is_wall or explored[column, row] == UNSEEN:
                explored[column, row] = WALL if is_wall else OPEN
    return new


@kernel("(float64[:, ::1], float64[:, ::1], float64[::1], float64, float64)")
def sees(walls: NDArray[np.float64], discs: NDArray[np.float64], eye: NDArray[np.float64], x: float, z: float) -> bool:
    """Return whether a point is in the field of view and nothing hides it; the arrays are those of `mark_seen`."""
    off_x = x - eye[0]
    off_z = z - eye[1]
    distance = math.hypot(off_x, off_z)
    cos_yaw = math.cos(eye[2])
    sin_yaw = math.sin(eye[2])
    ahead = off_x * cos_yaw - off_z * sin_yaw
    aside = off_x * sin_yaw + off_z * cos_yaw
    if ahead <= 0 or abs(aside) > ahead * eye[3]:
        return False
    return bool(_to_wall(walls, discs, eye[0], eye[1], off_x / distance, off_z / distance) >= distance)


@kernel("(float64[:, ::1], float64[:, ::1], float64, float64, float64, float64)")
def _to_wall(
    walls: NDArray[np.float64], discs: NDArray[np.float64], x: float, z: float, along_x: float, along_z: float
) -> float:
    """Return the distance from (x, z) along a unit vector to the first wall or disc; infinite if there is none."""
    nearest = np.inf
    for index in range(walls.shape[0]):
        ax = walls[index, 0] - x
        az = walls[index, 1] - z
        wall_x = walls[index, 2] - walls[index, 0]
        wall_z = walls[index, 3] - walls[index, 1]
        across = along_x * wall_z - along_z * wall_x
        if abs(across) < 1e-12:  # the line is parallel to the wall
            continue
        off = (ax * wall_z - az * wall_x) / across
        share = (ax * along_z - az * along_x) / across
        if off > 0 and -1e-9 <= share <= 1 + 1e-9 and off < nearest:
            nearest = off
    for index in range(discs.shape[0]):
        off_x = discs[index, 0] - x
        off_z = discs[index, 1] - z
        middle = off_x * along_x + off_z * along_z
        gap_squared = off_x * off_x + off_z * off_z - middle * middle
        within = discs[index, 2] * discs[index, 2] - gap_squared
        if within > 0 and middle > math.sqrt(within):
            nearest = min(nearest, middle - math.sqrt(within))
    return nearest


@kernel("(int8[:, ::1], int64, int64, float64)")
def unseen_around(explored: NDArray[np.int8], column: int, row: int, cell: float) -> NDArray[np.float64]:
    """Return the unseen floor visible from a cell in m², float64[BEARINGS], by bearing counter-clockwise from +x."""
    columns, rows = explored.shape
    areas_m2 = np.zeros(BEARINGS)
    for bearing in range(BEARINGS):
        along_x = math.cos(bearing * _BEARING_RAD)
        along_z = -math.sin(bearing * _BEARING_RAD)
        for part in range(1, int(RANGE_M / cell) + 1):
            c = math.floor(column + 0.5 + part * along_x)
            r = math.floor(row + 0.5 + part * along_z)
            if not (0 <= c < columns and 0 <= r < rows) or explored[c, r] == WALL:
                break
            if explored[c, r] == UNSEEN:
                areas_m2[bearing] += part * cell * cell * _BEARING_RAD
    return areas_m2


@kernel("(float64[::1], float64, float64)")
def in_sight(around: NDArray[np.float64], yaw: float, half_rad: float) -> float:
    """Return how much of the unseen floor ``around`` a place is within ``half_rad`` on each side of ``yaw``, in m².

    ``around`` is the result of `unseen_around`, and angles are in radians.
    """
    total = 0.0
    for bearing in range(BEARINGS):
        off = (bearing * _BEARING_RAD - yaw + math.pi) % (2 * math.pi) - math.pi
        if abs(off) <= half_rad:
            total += around[bearing]
    return total


@kernel("(int8[:, ::1], int64[:, ::1], float64[::1], float64[::1], float64, float64[::1])")
def visibility_values(
    explored: NDArray[np.int8],
    places: NDArray[np.int64],
    costs: NDArray[np.float64],
    yaws: NDArray[np.float64],
    cell: float,
    taste: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the best look from each place, (n, 3): its cost minus its value, its yaw, and the unseen floor in m².

    Costs and values are in actions. If no look is worth it, the first number is infinite.

    Args:
        explored: UNSEEN, OPEN or WALL for each cell
        places: the places' columns and rows, (n, 2)
        costs: the number of actions to each place
        yaws: the heading on arrival at each place
        cell: the size of a cell in metres
        taste: the angle of a turn, half the field of view, the smallest area that is worth a look, the value of a
            square metre in actions, and the area that is enough for one look
    """
    turn = taste[0]
    half = taste[1]
    least = taste[2]
    worth = taste[3]
    enough = taste[4]
    looks = np.empty((len(places), 3))
    for place in range(len(places)):
        around = unseen_around(explored, places[place, 0], places[place, 1], cell)
        looks[place] = np.inf, 0.0, 0.0
        for bearing in range(0, BEARINGS, 3):
            yaw = bearing * _BEARING_RAD
            unseen = in_sight(around, yaw, half)
            if unseen >= least:
                off = abs((yaw - yaws[place] + math.pi) % (2 * math.pi) - math.pi)
                score = costs[place] + off / turn - worth * min(unseen, enough)
                if score < looks[place, 0]:
                    looks[place] = score, yaw, unseen
    return looks


@kernel("(int8[:, ::1], int64, int64, float64, float64, float64)")
def give_up(explored: NDArray[np.int8], column: int, row: int, cell: float, yaw: float, half_rad: float) -> None:
    """Mark as wall the first unseen cell in each bearing that a look along ``yaw`` should have shown but did not."""
    columns, rows = explored.shape
    for bearing in range(BEARINGS):
        off = (bearing * _BEARING_RAD - yaw + math.pi) % (2 * math.pi) - math.pi
        if abs(off) > half_rad:
            continue
        along_x = math.cos(bearing * _BEARING_RAD)
        along_z = -math.sin(bearing * _BEARING_RAD)
        for part in range(1, int(RANGE_M / cell) + 1):
            c = math.floor(column + 0.5 + part * along_x)
            r = math.floor(row + 0.5 + part * along_z)
            if not (0 <= c < columns and 0 <= r < rows) or explored[c, r] == WALL:
                break
            if explored[c, r] == UNSEEN:
                explored[c, r] = WALL
                break


@kernel("(boolean[:, ::1], float64[:, ::1], int64, int64)")
def waypoint(free: NDArray[np.bool_], distance: NDArray[np.float64], column: int, row: int) -> tuple[int, int]:
    """Return the farthest cell on a cell's path to the goal of a distance map that a straight line from it reaches."""
    columns, rows = free.shape
    best_c = column
    best_r = row
    c = column
    r = row
    while distance[c, r] > 0:
        next_c = c
        next_r = r
        lowest = np.inf
        for right in range(-2, 3):
            for down in range(-2, 3):
                i = c + right
                j = r + down
                if 0 <= i < columns and 0 <= j < rows and distance[i, j] < distance[c, r]:
                    through = distance[i, j] + math.hypot(right, down)
                    if through < lowest:
                        next_c = i
                        next_r = j
                        lowest = through
        if next_c == c and next_r == r:
            break
        first = c == column and r == row
        c = next_c
        r = next_r
        if not first and not _straight(free, column, row, c, r):
            break
        best_c = c
        best_r = r
    return best_c, best_r


@kernel("(boolean[:, ::1], int64, int64, int64, int64)")
def _straight(free: NDArray[np.bool_], column: int, row: int, to_column: int, to_row: int) -> bool:
    """Return whether a straight line between two cells crosses only free cells."""
    parts = 2 * max(abs(to_column - column), abs(to_row - row), 1)
    for part in range(1, parts + 1):
        c = math.floor(column + (to_column - column) * part / parts + 0.5)
        r = math.floor(row + (to_row - row) * part / parts + 0.5)
        if not free[c, r]:
            return False
    return True
