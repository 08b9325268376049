"""Sectors: the rooms of a building, each with a plane of its floor and one of its ceiling, and the openings between.

A sector's outline is that of a flat room. Its floor is level, or rises along x or z. Openings in walls lie between two
heights and join two sectors; holes lie in the floor of one sector and the ceiling of the one below. Lengths are in
metres, and heights are y in the world.
"""

import math
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from minihuman.errors import WorldError
from minihuman.worlds.first_person.heights.planes import Plane
from minihuman.worlds.first_person.rooms import (
    WALL_HEIGHT,
    OpeningLimits,
    OutlineEdge,
    Point,
    Room,
    RoomOutline,
    outline_of,
)

LEAST_OPENING_M = 0.01  # the least width and height of an opening
_ROUNDING_M = 1e-9  # by which rounding may exceed a limit
_TOUCHING_M = 0.001  # walls that are no farther apart touch, without a passage between them
_INSIDE_M = 0.05  # a wall that lies farther inside a room does not face it
_PARALLEL = 0.999  # of walls that face each other: the least of the cosine of their angle
_EDGE_TO_A = 1  # the edges of a passage that lie on the walls of the sectors a and b, by the order of its corners
_EDGE_TO_B = 3


class WallOpening(NamedTuple):
    """An opening in the wall on one edge of a sector, from ``start`` to ``end`` along it, into another sector.

    ``bottom`` and ``top`` are its heights at its start and at its end.
    """

    edge: int
    start: float
    end: float
    bottom: tuple[float, float]
    top: tuple[float, float]
    into: int

    def heights_at(self, along: float) -> tuple[float, float]:
        """Return the heights of its bottom and top at a distance along the edge."""
        share = (along - self.start) / (self.end - self.start)
        share = min(max(share, 0.0), 1.0)
        return (
            self.bottom[0] + share * (self.bottom[1] - self.bottom[0]),
            self.top[0] + share * (self.top[1] - self.top[0]),
        )


class Hole(NamedTuple):
    """A rectangular hole in a floor or a ceiling, and the number of the sector behind it."""

    min_x: float
    min_z: float
    max_x: float
    max_z: float
    into: int

    def contains(self, x: float, z: float) -> bool:
        """Return whether a point of the plan is over the hole."""
        return self.min_x < x < self.max_x and self.min_z < z < self.max_z


@dataclass(slots=True, eq=False)
class Sector(Room):
    """One room of a building; ``floor_plane`` and ``ceiling_plane`` replace the ground and the height of a flat room.

    ``levels`` are the lowest and the highest height that it leads between, which differ for stairs and ramps. A sector
    that is not ``must_be_reached`` may be out of the agent's reach.
    """

    floor_plane: Plane = field(default_factory=partial(Plane, 0.0))
    ceiling_plane: Plane = field(default_factory=partial(Plane, WALL_HEIGHT))
    levels: tuple[float, float] = (0.0, 0.0)
    must_be_reached: bool = True
    openings: list[WallOpening] = field(default_factory=list)
    floor_holes: list[Hole] = field(default_factory=list)
    ceiling_holes: list[Hole] = field(default_factory=list)

    @property
    def is_flight(self) -> bool:
        """Return whether it is a part of stairs or a ramp."""
        return self.levels[0] != self.levels[1]

    def describe(self) -> str:
        """Return a description of the sector for an error: its number, extents and the height of its floor."""
        low = min(self.floor_plane.at(x, z) for x, z in self.outline.corners)
        high = max(self.floor_plane.at(x, z) for x, z in self.outline.corners)
        floor = f"floor at {low:g} m" if low == high else f"floor from {low:g} to {high:g} m"
        return f"room {self.number} (x {self.min_x:g} to {self.max_x:g}, z {self.min_z:g} to {self.max_z:g}, {floor})"


class Flight(NamedTuple):
    """Stairs or a ramp: the sectors at its lower and upper end, and all of its sectors from below to above."""

    bottom: Sector
    top: Sector
    sectors: tuple[Sector, ...]

    def nearest_end(self, height: float) -> Sector:
        """Return the lower or the upper end, whichever is nearer to a height."""
        low, high = self.bottom.levels
        if abs(height - low) <= abs(high - height):
            return self.bottom
        return self.top


class FacingWalls(NamedTuple):
    """Two edges that face each other, the part of each that lies before the other, and the gap between them in m."""

    edge_a: int
    span_a: tuple[float, float]
    edge_b: int
    span_b: tuple[float, float]
    gap_m: float


def connect_sectors(
    a: Sector, b: Sector, limits: OpeningLimits, *, min_y: float | None, max_y: float | None, number: int
) -> Sector | None:
    """Cut facing openings into two sectors, and return the passage between them; None if they touch.

    Args:
        a: a sector.
        b: another sector.
        limits: the range of x or z in which the opening lies; without any, as far as the two walls face each other.
        min_y: the lowest height of the opening; None for the higher of the two floors.
        max_y: the highest height; None for the lower of the two ceilings.
        number: the number that a passage gets.

    Raises:
        WorldError: if the walls do not face each other, or no opening of the limits and heights fits them.
    """
    walls = find_facing_walls(a, b, limits)
    if walls.gap_m <= _TOUCHING_M:
        _cut_openings(a, b, walls, min_y, max_y)
        return None
    gap_room = _build_passage(a, b, walls, max_y, number)
    gap_edges = gap_room.outline.edges
    for room, edge, span, gap_edge in (
        (a, walls.edge_a, walls.span_a, _EDGE_TO_A),
        (b, walls.edge_b, walls.span_b, _EDGE_TO_B),
    ):
        whole = (0.0, gap_edges[gap_edge].length)
        _cut_openings(room, gap_room, FacingWalls(edge, span, gap_edge, whole, 0.0), min_y, max_y)
    return gap_room


def find_facing_walls(a: Sector, b: Sector, limits: OpeningLimits) -> FacingWalls:
    """Return the nearest pair of walls that face each other, within limits.

    Raises:
        WorldError: if there are none, or the limits do not fit.
    """
    edges = ((edge_a, edge_b) for edge_a in enumerate(a.outline.edges) for edge_b in enumerate(b.outline.edges))
    facing = (_match_edges(*edge_a, *edge_b) for edge_a, edge_b in edges)
    pairs = [pair for pair in facing if pair is not None]
    if not pairs:
        raise WorldError(f"no wall of {a.describe()} faces a wall of {b.describe()}; place them side by side")
    nearest = min(pairs, key=lambda pair: pair.gap_m)
    if limits == OpeningLimits():
        return nearest
    return _limit_walls(a, b, nearest, limits)


def _match_edges(index_a: int, edge_a: OutlineEdge, index_b: int, edge_b: OutlineEdge) -> FacingWalls | None:
    """Return the parts of two edges that face each other, with the gap between them; None if there are none."""
    nx, nz = edge_a.normal
    if nx * edge_b.normal[0] + nz * edge_b.normal[1] > -_PARALLEL:
        return None
    gap = -(nx * (edge_b.start[0] - edge_a.start[0]) + nz * (edge_b.start[1] - edge_a.start[1]))
    if gap < -_INSIDE_M:
        return None
    low = max(0.0, _project(edge_a, edge_b.end))
    high = min(edge_a.length, _project(edge_a, edge_b.start))
    if high - low < LEAST_OPENING_M:
        return None
    return FacingWalls(index_a, (low, high), index_b, _opposite(edge_a, edge_b, low, high), gap)


def _project(edge: OutlineEdge, point: Point) -> float:
    """Return the distance along an edge at which the projection of a point lies."""
    distance = (point[0] - edge.start[0]) * edge.direction[0] + (point[1] - edge.start[1]) * edge.direction[1]
    return distance + 0.0  # never -0.0


def _opposite(edge_a: OutlineEdge, edge_b: OutlineEdge, low: float, high: float) -> tuple[float, float]:
    """Return the part (from, to) of the edge ``edge_b`` that lies opposite the part of ``edge_a`` from low to high."""
    return max(0.0, _project(edge_b, edge_a.at(high))), min(edge_b.length, _project(edge_b, edge_a.at(low)))


def _limit_walls(a: Sector, b: Sector, walls: FacingWalls, limits: OpeningLimits) -> FacingWalls:
    """Return the part of facing walls that lies within limits of x or z.

    Raises:
        WorldError: if the limits are not two of x or two of z, or the walls do not face each other there.
    """
    edge = a.outline.edges[walls.edge_a]
    match limits:
        case (float() | int() as low, float() | int() as high, None, None):
            axis = 0
        case (None, None, float() | int() as low, float() | int() as high):
            axis = 1
        case _:
            raise WorldError(f"an opening cannot have the limits {limits}; give min_x and max_x, or min_z and max_z")
    slope = edge.direction[axis]
    if slope == 0:
        raise WorldError(
            f"the wall {edge.start} to {edge.end} has a single {'xz'[axis]}; give limits in {'zx'[axis]} instead"
        )
    ends = (low - edge.start[axis]) / slope + 0.0, (high - edge.start[axis]) / slope + 0.0
    start, end = min(ends), max(ends)
    reach = walls.span_a
    if not reach[0] - _ROUNDING_M <= start < end <= reach[1] + _ROUNDING_M:
        fits = sorted(edge.at(along)[axis] for along in reach)
        raise WorldError(
            f"an opening from {'xz'[axis]} = {low:g} to {high:g} does not fit between {a.describe()} and "
            f"{b.describe()}, whose walls face each other from {fits[0]:g} to {fits[1]:g}"
        )
    start = max(start, reach[0])
    end = min(end, reach[1])
    return walls._replace(span_a=(start, end), span_b=_opposite(edge, b.outline.edges[walls.edge_b], start, end))


def _cut_openings(a: Sector, b: Sector, walls: FacingWalls, min_y: float | None, max_y: float | None) -> None:
    """Cut an opening into both of two facing walls.

    Raises:
        WorldError: if the opening would have no height, or overlap another one.
    """
    ends = [a.outline.edges[walls.edge_a].at(along) for along in walls.span_a]
    _check_planes(a, b, ends)
    bottoms = []
    tops = []
    for x, z in ends:
        lowest = max(a.floor_plane.at(x, z), b.floor_plane.at(x, z))
        highest = min(a.ceiling_plane.at(x, z), b.ceiling_plane.at(x, z))
        bottoms.append(lowest if min_y is None else max(lowest, float(min_y)))
        tops.append(highest if max_y is None else min(highest, float(max_y)))
    if min(top - bottom for top, bottom in zip(tops, bottoms, strict=True)) < LEAST_OPENING_M:
        raise WorldError(
            f"there is no opening between {a.describe()} and {b.describe()}: it would be from {max(bottoms):g} to "
            f"{min(tops):g} m high; bring their floors and ceilings to common heights, or change min_y and max_y"
        )
    opening = WallOpening(walls.edge_a, *walls.span_a, (bottoms[0], bottoms[1]), (tops[0], tops[1]), b.number)
    opposite = WallOpening(walls.edge_b, *walls.span_b, (bottoms[1], bottoms[0]), (tops[1], tops[0]), a.number)
    for room, room_opening in ((a, opening), (b, opposite)):
        _check_free(room, room_opening)
        room.openings.append(room_opening)


def _check_planes(a: Sector, b: Sector, ends: list[Point]) -> None:
    """Raise a WorldError if the floors or the ceilings of two sectors cross between the ends of an opening."""
    for name in ("floor_plane", "ceiling_plane"):
        rises = [getattr(a, name).at(*end) - getattr(b, name).at(*end) for end in ends]
        if min(rises) < -_ROUNDING_M and max(rises) > _ROUNDING_M:
            raise WorldError(
                f"the {name.removesuffix('_plane')}s of {a.describe()} and {b.describe()} cross within the opening; "
                "end it where they meet"
            )


def _check_free(room: Sector, opening: WallOpening) -> None:
    """Raise a WorldError if a new opening overlaps another one in its wall."""
    for cut in room.openings:
        is_beside = (
            cut.edge != opening.edge or opening.start > cut.end - _ROUNDING_M or cut.start > opening.end - _ROUNDING_M
        )
        is_above = (
            max(opening.top) <= min(cut.bottom) + _ROUNDING_M or max(cut.top) <= min(opening.bottom) + _ROUNDING_M
        )
        if not (is_beside or is_above):
            side = room.outline.edges[opening.edge]
            raise WorldError(
                f"two openings overlap in the wall from {side.start} to {side.end} of {room.describe()}, into rooms "
                f"{cut.into} and {opening.into}; leave a gap between them"
            )


def _build_passage(a: Sector, b: Sector, walls: FacingWalls, max_y: float | None, number: int) -> Sector:
    """Return the sector that fills the gap between two facing walls.

    Raises:
        WorldError: if the floors on the two sides have different heights.
    """
    edge_a = a.outline.edges[walls.edge_a]
    edge_b = b.outline.edges[walls.edge_b]
    a_start, a_end = (edge_a.at(along) for along in walls.span_a)
    b_start, b_end = (edge_b.at(along) for along in walls.span_b)
    corners = ((a, a_start), (a, a_end), (b, b_start), (b, b_end))
    heights = {room.floor_plane.at(*point) for room, point in corners}
    if max(heights) - min(heights) > _TOUCHING_M:
        raise WorldError(
            f"there is a gap of {walls.gap_m:g} m between {a.describe()} and {b.describe()}, whose floors there are at "
            f"{min(heights):g} and {max(heights):g} m; fill it with add_stairs() or add_ramp()"
        )
    level = min(heights)
    top = min(room.ceiling_plane.at(*point) for room, point in corners)
    if max_y is not None:
        top = min(top, float(max_y))
    outline: RoomOutline = outline_of((b_start, a_end, a_start, b_end))
    return Sector(
        outline,
        max(top - level, LEAST_OPENING_M),
        a.floor,
        a.wall,
        a.ceiling,
        number,
        floor_plane=Plane(level),
        ceiling_plane=Plane(top),
        levels=(level, level),
    )


def open_hole(upper: Sector, lower: Sector, hole: tuple[float, float, float, float]) -> None:
    """Cut a hole (min_x, min_z, max_x, max_z) into the floor of one sector and the ceiling of the one below.

    Raises:
        WorldError: if the hole is not within both, or ceiling and floor are not at one height.
    """
    min_x, min_z, max_x, max_z = hole
    if not (min_x < max_x and min_z < max_z and all(map(math.isfinite, hole))):
        raise WorldError(
            f"a hole from x {min_x:g} to {max_x:g} and z {min_z:g} to {max_z:g} has no area; make each maximum greater "
            "than its minimum"
        )
    corners = [(x, z) for x in (min_x, max_x) for z in (min_z, max_z)]
    for room in (upper, lower):
        if not all(
            nx * (x - ax) + nz * (z - az) >= -_ROUNDING_M
            for (ax, az), _, _, _, (nx, nz) in room.outline.edges
            for x, z in corners
        ):
            raise WorldError(
                f"the hole from x {min_x:g} to {max_x:g} and z {min_z:g} to {max_z:g} does not lie within "
                f"{room.describe()}; make it smaller"
            )
    gaps = [upper.floor_plane.at(x, z) - lower.ceiling_plane.at(x, z) for x, z in corners]
    if max(map(abs, gaps)) > _TOUCHING_M:
        raise WorldError(
            f"the floor of {upper.describe()} and the ceiling of {lower.describe()} are {max(gaps, key=abs):g} m apart "
            "at the hole; give the lower room the height at which the upper floor lies"
        )
    if any(_overlap(hole, cut) for cut in upper.floor_holes):
        raise WorldError(f"two holes overlap in the floor of {upper.describe()}; join them")
    upper.floor_holes.append(Hole(*hole, lower.number))
    lower.ceiling_holes.append(Hole(*hole, upper.number))


def _overlap(rectangle: tuple[float, float, float, float], hole: Hole) -> bool:
    """Return whether a rectangle (min_x, min_z, max_x, max_z) overlaps a hole."""
    min_x, min_z, max_x, max_z = rectangle
    return min_x < hole.max_x and hole.min_x < max_x and min_z < hole.max_z and hole.min_z < max_z
