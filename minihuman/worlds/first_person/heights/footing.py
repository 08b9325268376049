"""What carries a body in a building, and what stops it.

A body is a vertical cylinder that stands in the sector under its middle, on the plane of that sector's floor. It passes
an opening if the step up or down to the other floor is no higher than a step, the opening no lower than the body, and
its wall elsewhere stops it, as in a flat room. From an edge deeper than a step it falls if that is allowed, and lands
beside it. Everything is computed with sums, products, quotients and square roots of doubles, in one order.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

from minihuman.worlds.first_person.heights.plan import PlannedSector, SectorPlan
from minihuman.worlds.first_person.heights.sectors import WallOpening
from minihuman.worlds.first_person.rooms import OutlineEdge

Segment = tuple[float, float, float, float]  # x0, z0, x1, z1

_ROUNDING_M = 1e-9
_MOST_CROSSINGS = 256  # openings that a body may pass in one move
_MOST_PUSHES = 4  # out of walls, for a body that lands


class Walker(NamedTuple):
    """The size of a body and the steps that it takes, in metres."""

    radius: float
    height: float
    step: float  # the highest step up or down
    fall: float  # the deepest edge over which it falls; it falls from none if this is no more than a step


class Footing(NamedTuple):
    """The sector in which a move ends, and whether it went over an edge deeper than a step."""

    room: int
    fell: bool


def room_below(plan: SectorPlan, x: float, z: float, height: float) -> int | None:
    """Return the number of the sector whose floor is the highest one at or below a point; None if there is none.

    ``height`` is the y of the point. Over a hole in a floor, the floor below it counts.
    """
    best: int | None = None
    best_floor = -math.inf
    for number, room in enumerate(plan.rooms):
        floor = room.floor_plane.at(x, z)
        is_higher = best_floor < floor <= height + _ROUNDING_M
        if is_higher and _is_inside(room, x, z) and not _is_over_hole(room, x, z):
            best = number
            best_floor = floor
    return best


def _is_inside(room: PlannedSector, x: float, z: float) -> bool:
    """Return whether a point is in a sector or on its edge."""
    return all(nx * (x - ax) + nz * (z - az) >= -_ROUNDING_M for (ax, az), _, _, _, (nx, nz) in room.outline.edges)


def _is_over_hole(room: PlannedSector, x: float, z: float) -> bool:
    return any(hole.contains(x, z) for hole in room.floor_holes)


def can_pass(room: PlannedSector, opening: WallOpening, next_room: PlannedSector, along: float, body: Walker) -> bool:
    """Return whether a body that stands in a sector can go through an opening at a distance along its edge."""
    x, z = room.outline.edges[opening.edge].at(along)
    bottom, top = opening.heights_at(along)
    floor = room.floor_plane.at(x, z)
    next_floor = next_room.floor_plane.at(x, z)
    deepest = max(body.step, body.fall)
    return (
        bottom - floor <= body.step + _ROUNDING_M
        and bottom - next_floor <= deepest + _ROUNDING_M
        and top - bottom >= body.height - _ROUNDING_M
    )


def lets_through(opening: WallOpening, along: float, bottom: float, top: float) -> bool:
    """Return whether a thing that floats between two heights fits through an opening at a distance along its edge."""
    low, high = opening.heights_at(along)
    return low <= bottom + _ROUNDING_M and top <= high + _ROUNDING_M


def trace_move(
    plan: SectorPlan, room: int, start: tuple[float, float], end: tuple[float, float], body: Walker
) -> Footing | None:
    """Return where the middle of a body arrives that moves straight from one point (x, z) to another.

    The result is None if a wall, or an edge that is too deep, is in the way, or the move passes too many openings.
    """
    fell = False
    x0, z0 = start
    dx = end[0] - x0
    dz = end[1] - z0
    share = 0.0
    for _ in range(_MOST_CROSSINGS):
        sector = plan.rooms[room]
        crossing = _find_exit(sector, x0, z0, dx, dz, share)
        if crossing is None:
            break
        edge, share = crossing
        side = sector.outline.edges[edge]
        x = x0 + share * dx
        z = z0 + share * dz
        along = (x - side.start[0]) * side.direction[0] + (z - side.start[1]) * side.direction[1]
        opening = _find_opening(plan, room, edge, along, body)
        if opening is None:
            return None
        next_room = plan.rooms[opening.into]
        fell = fell or opening.heights_at(along)[0] - next_room.floor_plane.at(x, z) > body.step + _ROUNDING_M
        room = opening.into
    else:
        return None
    return _fall(plan, room, end, body, fell)


def _fall(plan: SectorPlan, room: int, point: tuple[float, float], body: Walker, fell: bool) -> Footing | None:
    """Return the footing of a body at a point (x, z) of a sector, after it fell through holes in the floor below it.

    The result is None if a fall would be deeper than the body may fall. ``fell`` says whether it fell before.
    """
    for _ in range(len(plan.rooms)):
        sector = plan.rooms[room]
        hole = next((hole for hole in sector.floor_holes if hole.contains(*point)), None)
        if hole is None:
            return Footing(room, fell)
        depth = sector.floor_plane.at(*point) - plan.rooms[hole.into].floor_plane.at(*point)
        if depth > body.fall + _ROUNDING_M:
            return None
        fell = True
        room = hole.into
    return None


def _find_exit(
    sector: PlannedSector, x0: float, z0: float, dx: float, dz: float, min_share: float
) -> tuple[int, float] | None:
    """Return the edge by which a line leaves a sector, and at which share of its length; None if it ends inside.

    The line goes from (x0, z0) by (dx, dz), and is in the sector from the share ``min_share`` on.
    """
    best: tuple[int, float] | None = None
    for number, (start, _, _, _, (nx, nz)) in enumerate(sector.outline.edges):
        towards = nx * dx + nz * dz
        if towards >= 0.0:
            continue
        inside = nx * (x0 - start[0]) + nz * (z0 - start[1])
        share = max(inside / -towards, min_share)
        if share < 1.0 and (best is None or share < best[1]):
            best = number, share
    return best


def _find_opening(plan: SectorPlan, room: int, edge: int, along: float, body: Walker) -> WallOpening | None:
    """Return the opening through which a body passes at a distance along an edge; None if there is none."""
    sector = plan.rooms[room]
    for opening in sector.openings:
        if opening.edge != edge or not opening.start - _ROUNDING_M <= along <= opening.end + _ROUNDING_M:
            continue
        if can_pass(sector, opening, plan.rooms[opening.into], along, body):
            return opening
    return None


def find_solids(plan: SectorPlan, room: int, x: float, z: float, body: Walker) -> Iterator[Segment]:
    """Yield the segments of walls, and of edges that stop a body, which a body at (x, z) in a sector overlaps."""
    waiting = [room]
    reached = {room}
    for number in waiting:  # the loop appends to it
        sector = plan.rooms[number]
        for edge_number, edge in enumerate(sector.outline.edges):
            inside = edge.normal[0] * (x - edge.start[0]) + edge.normal[1] * (z - edge.start[1])
            if inside >= body.radius or (number != room and inside <= -body.radius):
                continue
            along = (x - edge.start[0]) * edge.direction[0] + (z - edge.start[1]) * edge.direction[1]
            free: list[tuple[float, float]] = []
            for opening in sector.openings:
                if opening.edge != edge_number:
                    continue
                nearest = min(max(along, opening.start), opening.end)
                is_behind = opening.into in reached  # the body overlaps what lies above an edge that it goes over
                if is_behind or can_pass(sector, opening, plan.rooms[opening.into], nearest, body):
                    free.append((opening.start, opening.end))
                    if opening.into not in reached and _is_near(edge, nearest, x, z, body.radius):
                        reached.add(opening.into)
                        waiting.append(opening.into)
            yield from _find_blocked_parts(edge, free, x, z, body.radius)
        if number == room:
            yield from _hole_edges(sector, x, z, body)


def _hole_edges(sector: PlannedSector, x: float, z: float, body: Walker) -> Iterator[Segment]:
    """Yield the edges of holes in a floor through which a body does not fall, where it overlaps them."""
    for hole in sector.floor_holes:
        if body.fall > body.step:
            continue
        near_x = min(max(x, hole.min_x), hole.max_x)
        near_z = min(max(z, hole.min_z), hole.max_z)
        if math.sqrt((near_x - x) ** 2 + (near_z - z) ** 2) < body.radius:
            yield hole.min_x, hole.min_z, hole.max_x, hole.min_z
            yield hole.max_x, hole.min_z, hole.max_x, hole.max_z
            yield hole.max_x, hole.max_z, hole.min_x, hole.max_z
            yield hole.min_x, hole.max_z, hole.min_x, hole.min_z


def _find_blocked_parts(
    edge: OutlineEdge, free: list[tuple[float, float]], x: float, z: float, radius: float
) -> Iterator[Segment]:
    """Yield the parts of an edge outside its free intervals (from, to) that a circle around (x, z) overlaps."""
    free_until = 0.0
    for start, end in [*sorted(free), (edge.length, edge.length)]:
        if start - free_until > _ROUNDING_M:
            a = edge.at(free_until)
            b = edge.at(start)
            along = (x - edge.start[0]) * edge.direction[0] + (z - edge.start[1]) * edge.direction[1]
            if _is_near(edge, min(max(along, free_until), start), x, z, radius):
                yield *a, *b
        free_until = max(free_until, end)


def _is_near(edge: OutlineEdge, along: float, x: float, z: float, radius: float) -> bool:
    """Return whether a circle around (x, z) contains the point at a distance along an edge."""
    px, pz = edge.at(along)
    return math.sqrt((px - x) ** 2 + (pz - z) ** 2) < radius


def can_float_at(plan: SectorPlan, x: float, z: float, bottom: float, top: float, radius: float) -> bool:
    """Return whether a cylinder between two heights overlaps no floor, wall or ceiling around the point (x, z)."""
    room = room_below(plan, x, z, bottom)
    if room is None or plan.rooms[room].ceiling_plane.at(x, z) < top - _ROUNDING_M:
        return False
    waiting = [room]
    reached = {room}
    for number in waiting:  # the loop appends to it
        sector = plan.rooms[number]
        for edge_number, edge in enumerate(sector.outline.edges):
            along = (x - edge.start[0]) * edge.direction[0] + (z - edge.start[1]) * edge.direction[1]
            free: list[tuple[float, float]] = []
            for opening in sector.openings:
                if opening.edge != edge_number:
                    continue
                nearest = min(max(along, opening.start), opening.end)
                if lets_through(opening, nearest, bottom, top):
                    free.append((opening.start, opening.end))
                    if opening.into not in reached and _is_near(edge, nearest, x, z, radius):
                        reached.add(opening.into)
                        waiting.append(opening.into)
            if next(_find_blocked_parts(edge, free, x, z, radius), None) is not None:
                return False
    return True


def has_headroom(plan: SectorPlan, room: int, x: float, z: float, height: float) -> bool:
    """Return whether something of a height fits between the floor and the ceiling at a place of a sector."""
    sector = plan.rooms[room]
    return sector.ceiling_plane.at(x, z) - sector.floor_plane.at(x, z) >= height - _ROUNDING_M


def push_from_walls(plan: SectorPlan, room: int, x: float, z: float, body: Walker) -> tuple[float, float] | None:
    """Return the point (x, z) beside walls at which a body lands after a fall; None if there is no room for it.

    The body would land at the given point if no walls were there.
    """
    for _ in range(_MOST_PUSHES):
        nearest: tuple[float, float, float] | None = None
        for segment in find_solids(plan, room, x, z, body):
            px, pz = nearest_point(segment, x, z)
            distance = math.sqrt((px - x) ** 2 + (pz - z) ** 2)
            if nearest is None or distance < nearest[0]:
                nearest = distance, px, pz
        if nearest is None:
            return x, z
        distance, px, pz = nearest
        if distance < _ROUNDING_M:
            return None
        share = (body.radius + _ROUNDING_M) / distance
        x = px + share * (x - px)
        z = pz + share * (z - pz)
    return None


def nearest_point(segment: Segment, x: float, z: float) -> tuple[float, float]:
    """Return the point (x, z) of a segment that is nearest to a given point."""
    ax, az, bx, bz = segment
    along_x = bx - ax
    along_z = bz - az
    share = ((x - ax) * along_x + (z - az) * along_z) / (along_x * along_x + along_z * along_z)
    share = min(max(share, 0.0), 1.0)
    return ax + share * along_x, az + share * along_z
