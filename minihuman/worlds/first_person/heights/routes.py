"""Routes through a building: which sectors a path leads through, and a lower bound on its length.

A route is found over points in the openings through which a body passes. Lengths are in metres in the plan, since a
step covers its length in the plan on stairs and ramps too.
"""

import heapq
import math
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from minihuman.worlds.first_person.heights.footing import Walker, can_pass, nearest_point
from minihuman.worlds.first_person.heights.plan import SectorPlan
from minihuman.worlds.first_person.heights.sectors import WallOpening
from minihuman.worlds.first_person.rooms import Point

_POINTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of an opening, between the places at which the body just fits
_ASIDE = 1e-6  # metres added per share of an opening away from its middle, by which equal routes take the middle


Node = tuple[int, Point]  # a sector and a point in it


class Route(NamedTuple):
    """The sectors from a start to a goal, and the point at which each but the first is entered."""

    sectors: tuple[int, ...]
    entries: tuple[Point, ...]
    length_m: float


def find_route(
    plan: SectorPlan,
    start: tuple[int, float, float],
    goal: tuple[int, float, float],
    body: Walker,
    avoid: Collection[int],
) -> Route | None:
    """Return the shortest route from a start to a goal, both (sector, x, z); None if there is none.

    It is the shortest one over `_POINTS` of the openings, and does not enter the sectors in ``avoid``.
    """
    waiting: list[tuple[float, int, Node]] = [(0.0, 0, (start[0], (start[1], start[2])))]
    parents: dict[Node, Node | None] = {waiting[0][2]: None}
    reached = {waiting[0][2]: 0.0}
    end = (goal[0], (goal[1], goal[2]))
    number = 0  # by which nodes at one distance leave the heap in order
    while waiting:
        length, _, node = heapq.heappop(waiting)
        if node == end:
            return _build_route(node, parents, length)
        if length > reached[node]:
            continue
        for next_node, distance in _next_nodes(plan, node, end, body, avoid):
            total = length + distance
            if total < reached.get(next_node, math.inf):
                number += 1
                reached[next_node] = total
                parents[next_node] = node
                heapq.heappush(waiting, (total, number, next_node))
    return None


def _next_nodes(
    plan: SectorPlan, node: Node, end: Node, body: Walker, avoid: Collection[int]
) -> Iterator[tuple[Node, float]]:
    """Yield the nodes to which a straight line leads from a node within its sector, and how far they are."""
    room, (x, z) = node
    if room == end[0]:
        yield end, math.hypot(end[1][0] - x, end[1][1] - z)
    for opening in plan.rooms[room].openings:
        if opening.into in avoid:
            continue
        for point, aside in _points_of(plan, room, opening, body):
            yield (opening.into, point), math.hypot(point[0] - x, point[1] - z) + aside * _ASIDE


def _points_of(plan: SectorPlan, room: int, opening: WallOpening, body: Walker) -> Iterator[tuple[Point, float]]:
    """Yield points of an opening at which a body can pass, each with its distance from the middle as a share."""
    edge = plan.rooms[room].outline.edges[opening.edge]
    inset = min(body.radius, (opening.end - opening.start) / 2)
    low = opening.start + inset
    high = opening.end - inset
    shares = _POINTS if high > low else (0.5,)  # the middle alone where the body just fits
    for share in shares:
        along = low + share * (high - low)
        if can_pass(plan.rooms[room], opening, plan.rooms[opening.into], along, body):
            yield edge.at(along), abs(share - 0.5)


def _build_route(node: Node, parents: dict[Node, Node | None], length: float) -> Route:
    """Return the route that ends at a node, which it follows back through the parents."""
    nodes = [node]
    while (parent := parents[nodes[-1]]) is not None:
        nodes.append(parent)
    nodes.reverse()
    sectors = [nodes[0][0]]
    entries: list[Point] = []
    for room, point in nodes[1:]:
        if room != sectors[-1]:
            sectors.append(room)
            entries.append(point)
    return Route(tuple(sectors), tuple(entries), length)


def least_length(
    plan: SectorPlan, start: tuple[int, float, float], goal: tuple[int, float, float], body: Walker
) -> float:
    """Return a lower bound on the length of paths from a start to a goal (sector, x, z); infinite if none leads there.

    The middle of a body crosses every opening on its way somewhere, so no path is shorter than the distances between
    openings that follow each other.
    """
    waiting: list[tuple[float, int, int]] = []  # length, sector, index of its opening
    segments = [
        [_segment(plan, room, opening) for opening in plan.rooms[room].openings] for room in range(len(plan.rooms))
    ]
    done: set[tuple[int, int]] = set()
    best = math.inf
    if start[0] == goal[0]:
        best = math.hypot(goal[1] - start[1], goal[2] - start[2])
    for index in _passable(plan, start[0], body):
        point = nearest_point(segments[start[0]][index], start[1], start[2])
        heapq.heappush(waiting, (math.hypot(point[0] - start[1], point[1] - start[2]), start[0], index))
    while waiting:
        length, room, index = heapq.heappop(waiting)
        if (room, index) in done or length >= best:
            continue
        done.add((room, index))
        into = plan.rooms[room].openings[index].into
        crossed = segments[room][index]
        if into == goal[0]:
            point = nearest_point(crossed, goal[1], goal[2])
            best = min(best, length + math.hypot(point[0] - goal[1], point[1] - goal[2]))
        for next_index in _passable(plan, into, body):
            if (into, next_index) not in done:
                gap = _distance_between(crossed, segments[into][next_index])
                heapq.heappush(waiting, (length + gap, into, next_index))
    return best


def _passable(plan: SectorPlan, room: int, body: Walker) -> Iterator[int]:
    """Yield the indices of a sector's openings that a body can pass at one of their ends."""
    for index, opening in enumerate(plan.rooms[room].openings):
        next_room = plan.rooms[opening.into]
        if any(can_pass(plan.rooms[room], opening, next_room, along, body) for along in (opening.start, opening.end)):
            yield index


def _segment(plan: SectorPlan, room: int, opening: WallOpening) -> tuple[float, float, float, float]:
    edge = plan.rooms[room].outline.edges[opening.edge]
    return *edge.at(opening.start), *edge.at(opening.end)


def _distance_between(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the least distance between two segments (x0, z0, x1, z1) that do not cross."""
    distances = []  # from each end to the other segment
    for segment, end in ((a, b[:2]), (a, b[2:]), (b, a[:2]), (b, a[2:])):
        x, z = nearest_point((segment[0], segment[1], segment[2], segment[3]), end[0], end[1])
        distances.append(math.hypot(x - end[0], z - end[1]))
    return min(distances)
