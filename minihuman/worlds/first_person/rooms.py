"""Rooms: convex outlines on the ground with walls, and portals (openings) in the walls. No rules, no pictures.

An outline is listed counter-clockwise as seen from above (x right, z towards the reader), so that the room lies to
the left of every edge. Lengths are metres.
"""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from minihuman.errors import WorldError

WALL_HEIGHT = 2.74

Point = tuple[float, float]  # x, z


class Portal(NamedTuple):
    """An opening in one wall, from ``start`` to ``end`` along its edge and from ``bottom`` to ``top`` in height.

    ``into`` is the number of the room behind it, None where it leads outside.
    """

    start: float
    end: float
    bottom: float
    top: float
    into: int | None


class Limits(NamedTuple):
    """Where two rooms open to each other: from one x to another, or from one z to another."""

    min_x: float | None = None
    max_x: float | None = None
    min_z: float | None = None
    max_z: float | None = None


class Edge(NamedTuple):
    """One side of an outline: where it starts and ends, its length, its direction, and its normal into the room."""

    start: Point
    end: Point
    length: float
    direction: Point
    normal: Point

    def at(self, distance: float) -> Point:
        """The point so far along the edge."""
        return self.start[0] + distance * self.direction[0], self.start[1] + distance * self.direction[1]


class WallPiece(NamedTuple):
    """A rectangle of wall: from ``start`` to ``end`` along edge ``edge``, from ``bottom`` to ``top`` in height."""

    edge: int
    start: float
    end: float
    bottom: float
    top: float


@dataclass(slots=True, eq=False)
class Room:
    """One room: an outline, how high its walls are, what covers them, and the portals cut so far."""

    outline: tuple[Point, ...]
    wall_height: float = WALL_HEIGHT
    floor: str = "floor_tiles_bw"  # names of textures
    wall: str = "concrete"
    ceiling: str | None = "concrete_tiles"  # None: open to the sky
    number: int = -1  # its place in the floor plan, from 0; -1 outside of one
    min_x: float = field(init=False)  # the extent of the outline
    max_x: float = field(init=False)
    min_z: float = field(init=False)
    max_z: float = field(init=False)
    edges: tuple[Edge, ...] = field(init=False)
    portals: tuple[list[Portal], ...] = field(init=False)

    def __post_init__(self) -> None:
        self.outline = tuple((float(x), float(z)) for x, z in self.outline)
        if len(self.outline) < 3:
            raise WorldError(f"the outline {list(self.outline)} has fewer than 3 corners; a room has to close")
        across, down = zip(*self.outline, strict=True)
        self.min_x, self.max_x, self.min_z, self.max_z = min(across), max(across), min(down), max(down)
        self.edges = tuple(
            _edge(start, end) for start, end in zip(self.outline, self.outline[1:] + self.outline[:1], strict=True)
        )
        self.portals = tuple([] for _ in self.edges)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Room":
        return self  # no step changes a room: copies of a world share it

    @property
    def area(self) -> float:
        """The area of the bounding rectangle, m²: what a room weighs when one is drawn by chance."""
        return (self.max_x - self.min_x) * (self.max_z - self.min_z)

    def contains(self, x: float, z: float) -> bool:
        """Is the point inside the outline, not on it?"""
        return all(nx * (x - ax) + nz * (z - az) > 0 for (ax, az), _, _, _, (nx, nz) in self.edges)

    def check_convex(self) -> None:
        """Raise if the outline turns the wrong way anywhere.

        Raises:
            WorldError: if the outline is clockwise, crosses itself or has a dent.
        """
        turned = 0.0
        for before, after in zip(self.edges, self.edges[1:] + self.edges[:1], strict=True):
            (ax, az), (bx, bz) = before.direction, after.direction
            turn = az * bx - ax * bz
            turned += math.atan2(turn, ax * bx + az * bz)
            if turn < -1e-9:
                raise WorldError(
                    f"the outline {list(self.outline)} turns right at {before.end}; "
                    "list a convex outline counter-clockwise as seen from above"
                )
        if abs(turned - 2 * math.pi) > 1e-6:
            raise WorldError(f"the outline {list(self.outline)} goes round more than once; a room closes in one turn")

    def open(self, edge: int, start: float, end: float, *, top: float | None = None, into: int | None = None) -> None:
        """Cut a portal into a wall, from the ground up, between two distances along it.

        Raises:
            WorldError: if the portal reaches past its wall, or has no width or no height.
        """
        if not 0 <= edge < len(self.edges):
            raise WorldError(f"a room with {len(self.edges)} walls has no wall {edge}; walls count from 0")
        portal = Portal(start, end, 0.0, self.wall_height if top is None else top, into)
        self._check_fits(portal, edge)
        self.portals[edge].append(portal)
        self.portals[edge].sort(key=lambda portal: portal.start)

    def _check_fits(self, portal: Portal, edge: int) -> None:
        side = self.edges[edge]
        if not 0 <= portal.start < portal.end <= side.length:
            raise WorldError(
                f"the portal from {portal.start:g} to {portal.end:g} m does not fit the wall "
                f"{side.start} to {side.end}, which is {side.length:g} m long"
            )
        if not 0 <= portal.bottom < portal.top:
            raise WorldError(
                f"the portal is {portal.bottom:g} to {portal.top:g} m high; its top has to be above its bottom"
            )

    def wall_pieces(self) -> list[WallPiece]:
        """The walls with the portals cut out of them, edge by edge, from the edge's start to its end."""
        pieces = []
        for index, (edge, portals) in enumerate(zip(self.edges, self.portals, strict=True)):
            reached = 0.0
            for start, end, bottom, top, _ in portals:
                if start != reached:
                    pieces.append(WallPiece(index, reached, start, 0.0, self.wall_height))
                if bottom != 0.0:
                    pieces.append(WallPiece(index, start, end, 0.0, bottom))
                if top != self.wall_height:
                    pieces.append(WallPiece(index, start, end, top, self.wall_height))
                reached = end
            if reached != edge.length:
                pieces.append(WallPiece(index, reached, edge.length, 0.0, self.wall_height))
        return pieces


def rectangle(min_x: float, max_x: float, min_z: float, max_z: float) -> tuple[Point, ...]:
    """The outline of a rectangle; its walls are east (0), north (1), west (2) and south (3).

    Raises:
        WorldError: if the rectangle has no width or no depth.
    """
    if not (min_x < max_x and min_z < max_z):
        raise WorldError(f"a room from x {min_x:g} to {max_x:g} and z {min_z:g} to {max_z:g} has no floor")
    return (max_x, max_z), (max_x, min_z), (min_x, min_z), (min_x, max_z)


def facing_edges(a: Room, b: Room) -> tuple[int, int]:
    """The first pair of walls of two rooms that look at each other.

    Raises:
        WorldError: if no wall of one faces a wall of the other.
    """
    for index_a, edge_a in enumerate(a.edges):
        (nx, nz), (ax, az) = edge_a.normal, edge_a.start
        for index_b, edge_b in enumerate(b.edges):
            if nx * edge_b.normal[0] + nz * edge_b.normal[1] > -0.9:
                continue
            if nx * (edge_b.start[0] - ax) + nz * (edge_b.start[1] - az) > 0.05:
                continue  # it lies inside the room
            return index_a, index_b
    raise WorldError(f"no wall of the room {list(a.outline)} faces a wall of the room {list(b.outline)}")


def stretch(edge: Edge, limits: Limits) -> tuple[float, float]:
    """From where to where along a wall the limits reach.

    Raises:
        WorldError: if the limits are not two x or two z, or the wall runs across them.
    """
    match limits:
        case (float() | int() as low, float() | int() as high, None, None):
            axis = 0
        case (None, None, float() | int() as low, float() | int() as high):
            axis = 1
        case _:
            raise WorldError(f"an opening goes from min_x to max_x or from min_z to max_z, not {limits}")
    origin, slope = edge.start[axis], edge.direction[axis]
    if slope == 0:
        raise WorldError(f"the wall {edge.start} to {edge.end} runs across {'xz'[axis]}; give {'zx'[axis]} instead")
    ends = (low - origin) / slope, (high - origin) / slope
    return min(ends), max(ends)


def passage(a: Room, b: Room, *, limits: Limits, top: float | None, number: int) -> Room | None:
    """Cut facing portals into two rooms and give the passage between them, or None where they touch.

    The passage takes its textures from ``a``, and is as high as its portals.

    Raises:
        WorldError: if the rooms do not face each other or the portal does not fit a wall.
    """
    index_a, index_b = facing_edges(a, b)
    edge_a, edge_b = a.edges[index_a], b.edges[index_b]
    stretch_a, stretch_b = stretch(edge_a, limits), stretch(edge_b, limits)
    a_start, a_end = edge_a.at(stretch_a[0]), edge_a.at(stretch_a[1])
    b_start, b_end = edge_b.at(stretch_b[0]), edge_b.at(stretch_b[1])
    if _distance(a_start, b_end) < 0.001:
        a.open(index_a, *stretch_a, top=top, into=b.number)
        b.open(index_b, *stretch_b, top=top, into=a.number)
        return None
    height = a.wall_height if top is None else top
    between = Room((b_start, a_end, a_start, b_end), height, a.floor, a.wall, a.ceiling, number)
    a.open(index_a, *stretch_a, top=top, into=number)
    b.open(index_b, *stretch_b, top=top, into=number)
    between.open(1, 0.0, _distance(a_start, a_end), into=a.number)
    between.open(3, 0.0, _distance(b_start, b_end), into=b.number)
    return between


def _edge(start: Point, end: Point) -> Edge:
    length = _distance(start, end)
    if length == 0:
        raise WorldError(f"an outline has the corner {start} twice in a row; a wall has a length")
    x, z = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    norm = math.sqrt(z * z + x * x)
    return Edge(start, end, length, (x, z), (z / norm, -x / norm))


def _distance(a: Point, b: Point) -> float:
    dx, dz = b[0] - a[0], b[1] - a[1]
    return math.sqrt(dx * dx + dz * dz)
