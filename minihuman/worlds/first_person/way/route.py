"""A way to a goal by the real moves: turns of one angle, steps of one length, a body that must fit at every stop.

A* over places and headings. What guides it is how far every place is from the goal, going round what is in the way.
What is carried floats ahead, and has to fit too: then it is what the way brings to the goal.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.collision import touches_wall
from minihuman.worlds.first_person.way.ground import in_zone
from minihuman.worlds.first_person.way.heap import drop_first, push
from minihuman.worlds.kernels import kernel, part

TURN_LEFT, TURN_RIGHT, FORWARD, BACK = 0, 1, 2, 3  # what the route is made of
_MOST_STOPS = 2_000_000  # a search that has seen so many has no way


class Body(NamedTuple):
    """How an agent moves and what room it takes: metres, radians; ``ahead`` and ``carried`` are 0 with empty hands."""

    step: float
    turn: float
    radius: float
    moves: int  # 4 where it steps back too, else 3
    ahead: float  # from its middle to the middle of what it carries
    carried: float  # the radius of that


class Stops(NamedTuple):
    """Places on the ways that are being tried: room for as many as there may be, of which memory is what is used."""

    x: NDArray[np.float64]
    z: NDArray[np.float64]
    heading: NDArray[np.int64]  # turns to the left since the start
    parent: NDArray[np.int64]
    action: NDArray[np.int8]
    cost: NDArray[np.int64]
    keys: NDArray[np.float64]  # a heap of those to go on from, by what the way through them is expected to cost
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
    """The moves from ``start`` (x, z, yaw) to within ``goal`` (x, z, radius); empty where there is no way.

    ``discs`` are (n, 4): x, z, and how far from it the body's middle and that of what it carries have to stay.
    ``distance`` comes from ``distance_map`` over cells of size ``cell``.
    """
    most = _MOST_STOPS
    stops = Stops(
        *(np.empty(most), np.empty(most), np.empty(most, np.int64), np.empty(most, np.int64)),
        *(np.empty(most, np.int8), np.empty(most, np.int64), np.empty(most), np.empty(most, np.int64)),
    )
    seen = np.zeros((*distance.shape, round(2 * math.pi / body.turn)), np.bool_)
    last = _search(walls, discs, zones, start, goal, body, bounds, distance, cell, stops, seen)
    moves = []
    while last > 0:
        moves.append(int(stops.action[last]))
        last = stops.parent[last]
    return moves[::-1]


@kernel(lean=True)
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
    seen: NDArray[np.bool_],
) -> int:
    """The stop at the goal; -1 where there is none."""
    columns, rows, headings = seen.shape
    stops.x[0], stops.z[0], stops.heading[0] = start[0], start[1], 0
    stops.parent[0], stops.action[0], stops.cost[0] = -1, -1, 0
    count = 1
    waiting = push(stops.keys, stops.numbers, 0, 0.0, 0)
    while waiting > 0 and count < len(stops.x) - 3:
        here = stops.numbers[0]
        waiting = drop_first(stops.keys, stops.numbers, waiting)
        x, z, heading = stops.x[here], stops.z[here], stops.heading[here]
        place = int((x - bounds[0]) / cell), int((z - bounds[1]) / cell), heading % headings
        if seen[place]:
            continue
        seen[place] = True
        yaw = start[2] + heading * body.turn
        ahead_x, ahead_z = x + body.ahead * math.cos(yaw), z - body.ahead * math.sin(yaw)
        if math.hypot(ahead_x - goal[0], ahead_z - goal[1]) < goal[2]:
            return int(here)
        for move in range(body.moves):
            new_x, new_z, new_heading = x, z, heading
            if move in (FORWARD, BACK):
                step = body.step if move == FORWARD else -body.step
                new_x, new_z = new_x + math.cos(yaw) * step, new_z - math.sin(yaw) * step
                if _blocked(walls, discs, 2, new_x, new_z, body.radius) or in_zone(zones, new_x, new_z):
                    continue
            else:
                new_heading += 1 if move == TURN_LEFT else -1
            new_yaw = start[2] + new_heading * body.turn
            if body.carried > 0.0:
                ahead_x, ahead_z = new_x + body.ahead * math.cos(new_yaw), new_z - body.ahead * math.sin(new_yaw)
                if _blocked(walls, discs, 3, ahead_x, ahead_z, body.carried):
                    continue
            column, row = int((new_x - bounds[0]) / cell), int((new_z - bounds[1]) / cell)
            if not (0 <= column < columns and 0 <= row < rows) or seen[column, row, new_heading % headings]:
                continue
            left = _still_to_go(distance, column, row, new_yaw, cell, body.step, body.turn)
            stops.x[count], stops.z[count], stops.heading[count] = new_x, new_z, new_heading
            stops.parent[count], stops.action[count], stops.cost[count] = here, move, stops.cost[here] + 1
            waiting = push(stops.keys, stops.numbers, waiting, stops.cost[count] + 1.5 * left, count)
            count += 1
    return -1


@part(lean=True)
def _blocked(
    walls: NDArray[np.float64], discs: NDArray[np.float64], kept: int, x: float, z: float, radius: float
) -> bool:
    for index in range(discs.shape[0]):
        if math.hypot(discs[index, 0] - x, discs[index, 1] - z) < discs[index, kept]:
            return True
    return touches_wall(walls, x, z, radius)


@part(lean=True)
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
