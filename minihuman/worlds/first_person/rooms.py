"""Rooms: convex outlines, portals between rooms that touch or lie apart, and the finished floor plan.

An outline is counter-clockwise as seen from above (x to the right, z towards the reader), so its inside is to the left
of every edge. Every room and every portal starts at the ground. A floor plan is what no step changes: rooms, the walls
that stop a body, and the probability with which each room is drawn. Lengths are in metres.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import texture_variants
from minihuman.worlds.first_person.parameters import running_sum
from minihuman.worlds.first_person.room_names import RoomNames
from minihuman.worlds.first_person.walls import wall_pieces
from minihuman.worlds.hashing import hash64

KEPT = 4096  # shapes in the cache: worlds are built anew at every reset, mostly of the same shapes

Point = tuple[float, float]  # x, z


class OutlineEdge(NamedTuple):
    """One side of an outline: its start, end, length, direction and inward normal."""

    start: Point
    end: Point
    length: float
    direction: Point
    normal: Point

    def at(self, distance: float) -> Point:
        """Return the point at a distance along the edge."""
        return self.start[0] + distance * self.direction[0], self.start[1] + distance * self.direction[1]


@dataclass(frozen=True, slots=True, eq=False)
class RoomOutline:
    """The shape of a room; only ``outline_of`` and ``rectangle`` make one, the same object for the same corners."""

    corners: tuple[Point, ...]
    edges: tuple[OutlineEdge, ...]
    table: NDArray[np.float64]  # (edges, 7) start x, z, length, direction x, z, normal x, z
    min_x: float
    max_x: float
    min_z: float
    max_z: float

    @property
    def area(self) -> float:
        """Return the area of the bounding rectangle in m², by which rooms are weighted when one is drawn."""
        return (self.max_x - self.min_x) * (self.max_z - self.min_z)

    def contains(self, x: float, z: float) -> bool:
        """Return whether a point is inside the outline and not on an edge."""
        return all(nx * (x - ax) + nz * (z - az) > 0 for (ax, az), _, _, _, (nx, nz) in self.edges)

    def __reduce__(self) -> tuple[Any, ...]:
        return outline_of, (self.corners,)


@lru_cache(maxsize=KEPT)
def outline_of(corners: tuple[Point, ...]) -> RoomOutline:
    """Return the outline with given corners (x, z), the last of which is joined to the first.

    Raises:
        WorldError: if there are fewer than 3 corners, or an edge has no length or an infinite one.
    """
    if len(corners) < 3:
        raise WorldError(f"the outline {list(corners)} has fewer than 3 corners; a room needs 3 or more")
    # + 0.0 turns -0.0 into 0.0: shapes are cached by their corners, in which the two zeros are equal
    corners = tuple((float(x) + 0.0, float(z) + 0.0) for x, z in corners)
    edges = tuple(_make_edge(start, end) for start, end in zip(corners, corners[1:] + corners[:1], strict=True))
    across, down = zip(*corners, strict=True)
    table = np.array([(*edge.start, edge.length, *edge.direction, *edge.normal) for edge in edges])
    return RoomOutline(corners, edges, table, min(across), max(across), min(down), max(down))


@lru_cache(maxsize=KEPT)
def rectangle(min_x: float, max_x: float, min_z: float, max_z: float) -> RoomOutline:
    """Return a rectangular outline, whose edges are east (0), north (1), west (2) and south (3).

    Raises:
        WorldError: if its width or depth is not positive.
    """
    if not (min_x < max_x and min_z < max_z):
        raise WorldError(
            f"a room from x {min_x:g} to {max_x:g} and z {min_z:g} to {max_z:g} has no area; make each maximum greater "
            "than its minimum"
        )
    return outline_of(((max_x, max_z), (max_x, min_z), (min_x, min_z), (min_x, max_z)))


@lru_cache(maxsize=KEPT)
def check_convex(shape: RoomOutline) -> None:
    """Check that an outline is convex and counter-clockwise.

    Raises:
        WorldError: if it is clockwise, crosses itself or has a dent.
    """
    turned = 0.0
    for before, after in zip(shape.edges, shape.edges[1:] + shape.edges[:1], strict=True):
        ax, az = before.direction
        bx, bz = after.direction
        turn = az * bx - ax * bz
        turned += math.atan2(turn, ax * bx + az * bz)
        if turn < -1e-9:
            raise WorldError(
                f"the outline {list(shape.corners)} turns right at {before.end}; "
                "make it convex and list its corners counter-clockwise as seen from above"
            )
    if abs(turned - 2 * math.pi) > 1e-6:
        raise WorldError(
            f"the outline {list(shape.corners)} goes round more than once; "
            "the outline of a room must go round exactly once"
        )


def distance(a: Point, b: Point) -> float:
    """Return the distance between two points."""
    dx = b[0] - a[0]
    dz = b[1] - a[1]
    return math.sqrt(dx * dx + dz * dz)


def _make_edge(start: Point, end: Point) -> OutlineEdge:
    """Return the edge from one corner to the next; raise WorldError if its length is 0 or not finite."""
    length = distance(start, end)
    if length == 0:
        raise WorldError(f"the outline has the corner {start} twice in a row; give it once")
    if not math.isfinite(length):
        raise WorldError(
            f"the wall {start} to {end} has no finite length; give each corner as finite x and z in metres"
        )
    x = (end[0] - start[0]) / length
    z = (end[1] - start[1]) / length
    norm = math.sqrt(z * z + x * x)
    return OutlineEdge(start, end, length, (x, z), (z / norm, -x / norm))


WALL_HEIGHT = 2.74


class Portal(NamedTuple):
    """An opening in the wall on one edge of a room, from ``start`` to ``end`` along the edge, up to the height ``top``.

    ``into`` is the number of the room behind it; None if it leads outside.
    """

    edge: int
    start: float
    end: float
    top: float
    into: int | None


@dataclass(slots=True, eq=False)
class Room(RoomNames):
    """One room: its shape, the height and textures of its walls, and its portals."""

    outline: RoomOutline
    wall_height: float = WALL_HEIGHT
    floor: str = "floor_tiles_bw"  # names of textures
    wall: str = "concrete"
    ceiling: str | None = "concrete_tiles"  # None: open to the sky
    number: int = -1  # its place in the floor plan, from 0; -1 outside of one
    portals: list[Portal] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.wall_height > 0:
            raise WorldError(f"wall_height is {self.wall_height!r} m; it must be above 0")

    def __deepcopy__(self, memo: dict[int, Any]) -> "Room":
        return self  # no step changes a room: copies of a world share it

    @property
    def min_x(self) -> float:
        """Return the smallest x of the room."""
        return self.outline.min_x

    @property
    def max_x(self) -> float:
        """Return the largest x of the room."""
        return self.outline.max_x

    @property
    def min_z(self) -> float:
        """Return the smallest z of the room."""
        return self.outline.min_z

    @property
    def max_z(self) -> float:
        """Return the largest z of the room."""
        return self.outline.max_z

    def contains(self, x: float, z: float) -> bool:
        """Return whether a point is inside the room and not on a wall."""
        return self.outline.contains(x, z)

    def open(self, edge: int, start: float, end: float, *, top: float | None = None, into: int | None = None) -> None:
        """Cut a portal into a wall, between two distances along it and up to ``top`` (None: as high as the wall).

        Raises:
            WorldError: if the portal extends past its wall or into another portal, or its width or height is not
                positive.
        """
        sides = self.outline.edges
        if not 0 <= edge < len(sides):
            raise WorldError(f"wall {edge} does not exist; the walls of this room are 0 to {len(sides) - 1}")
        if top is None:
            top = self.wall_height
        side = sides[edge]
        if not 0 <= start < end <= side.length:
            raise WorldError(
                f"the portal from {start:g} to {end:g} m does not fit in the wall from {side.start} to {side.end}, "
                f"which is {side.length:g} m long"
            )
        if not 0 < top <= self.wall_height:
            raise WorldError(
                f"the portal is {top:g} m high; it must be above 0 and at most its wall's {self.wall_height:g} m"
            )
        for portal in self.portals:
            if portal.edge == edge and start < portal.end and portal.start < end:
                raise WorldError(
                    f"the portal from {start:g} to {end:g} m along the wall {side.start} to {side.end} "
                    f"overlaps the one from {portal.start:g} to {portal.end:g} m; leave a gap"
                )
        self.portals.append(Portal(edge, float(start) + 0.0, float(end), float(top), into))  # + 0.0 avoids -0.0


_TOUCHING = 0.001  # metres; walls that are closer touch, without a passage between them
_OVERLAPPING = 0.05  # metres that rooms may reach into each other: Miniworld's own do, by 4 mm
_FACING = -0.9  # the greatest cosine of the angle between the normals of walls that face each other


class OpeningLimits(NamedTuple):
    """The limits of an opening between two rooms: from one x to another, or from one z to another."""

    min_x: float | None = None
    max_x: float | None = None
    min_z: float | None = None
    max_z: float | None = None


class FacingSpan(NamedTuple):
    """An edge of an outline, and the start and end of a part of it."""

    edge: int
    start: float
    end: float


class Joint(NamedTuple):
    """The opening between two shapes, and the shape of the gap between them; None if they touch.

    Edge 1 of the gap runs along the first shape, and edge 3 along the second.
    """

    a: FacingSpan
    b: FacingSpan
    gap: RoomOutline | None


def cut_passage(a: Room, b: Room, *, limits: OpeningLimits, top: float | None, number: int) -> Room | None:
    """Cut facing portals into two rooms, and return the passage between the rooms; None if the rooms touch.

    The passage gets the number ``number`` and the textures of ``a``. ``top`` is the portals' height; None: the walls'.

    Raises:
        WorldError: if the rooms do not face each other, or the portal does not fit a wall.
    """
    joint = find_joint(a.outline, b.outline, limits)
    if joint.gap is None:
        a.open(*joint.a, top=top, into=b.number)
        b.open(*joint.b, top=top, into=a.number)
        return None
    height = a.wall_height if top is None else top
    a.open(*joint.a, top=top, into=number)
    b.open(*joint.b, top=top, into=number)
    ends = ((edge, 0.0, joint.gap.edges[edge].length, float(height)) for edge in (1, 3))  # see `Joint`
    portals = [Portal(*end, into=room.number) for end, room in zip(ends, (a, b), strict=True)]
    return Room(joint.gap, height, a.floor, a.wall, a.ceiling, number, portals)


@lru_cache(maxsize=KEPT)
def find_joint(a: RoomOutline, b: RoomOutline, limits: OpeningLimits) -> Joint:
    """Return the opening between two shapes within limits.

    Raises:
        WorldError: if the shapes do not face each other, or the limits do not fit an edge.
    """
    index_a, index_b = _facing_edges(a, b)
    edge_a = a.edges[index_a]
    edge_b = b.edges[index_b]
    stretch_a = FacingSpan(index_a, *_limit_edge(edge_a, limits))
    stretch_b = FacingSpan(index_b, *_limit_edge(edge_b, limits))
    a_start = edge_a.at(stretch_a.start)
    a_end = edge_a.at(stretch_a.end)
    b_start = edge_b.at(stretch_b.start)
    b_end = edge_b.at(stretch_b.end)
    if distance(a_start, b_end) < _TOUCHING:
        return Joint(stretch_a, stretch_b, None)
    return Joint(stretch_a, stretch_b, outline_of((b_start, a_end, a_start, b_end)))


def _facing_edges(a: RoomOutline, b: RoomOutline) -> tuple[int, int]:
    """Return the first pair of edges that face each other; raise a WorldError if there is none."""
    for index_a, edge_a in enumerate(a.edges):
        nx, nz = edge_a.normal
        ax, az = edge_a.start
        for index_b, edge_b in enumerate(b.edges):
            if nx * edge_b.normal[0] + nz * edge_b.normal[1] > _FACING:
                continue
            if nx * (edge_b.start[0] - ax) + nz * (edge_b.start[1] - az) > _OVERLAPPING:
                continue  # it lies inside the room
            return index_a, index_b
    raise WorldError(
        f"no wall of the room {list(a.corners)} faces a wall of the room {list(b.corners)}; place them side by side"
    )


def _limit_edge(edge: OutlineEdge, limits: OpeningLimits) -> tuple[float, float]:
    """Return the start and end of the part of an edge within limits; raise a WorldError if the limits do not fit it."""
    match limits:
        case (float() | int() as low, float() | int() as high, None, None):
            axis = 0
        case (None, None, float() | int() as low, float() | int() as high):
            axis = 1
        case _:
            raise WorldError(f"an opening cannot have the limits {limits}; give min_x and max_x, or min_z and max_z")
    origin = edge.start[axis]
    slope = edge.direction[axis]
    if slope == 0:
        raise WorldError(
            f"the wall {edge.start} to {edge.end} has a single {'xz'[axis]}; give limits in {'zx'[axis]} instead"
        )
    ends = (low - origin) / slope + 0.0, (high - origin) / slope + 0.0  # + 0.0 avoids -0.0
    if not 0 <= min(ends) < max(ends) <= edge.length:
        raise WorldError(
            f"an opening from {'xz'[axis]} = {low:g} to {high:g} does not fit in the wall "
            f"from {edge.start} to {edge.end}, "
            f"which is {edge.length:g} m long"
        )
    return min(ends), max(ends)


_PLANS_KEPT = 16

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class RoomPlan(NamedTuple):
    """One finished room of a floor plan."""

    outline: RoomOutline
    wall_height: float
    wall: str  # names of textures
    floor: str
    ceiling: str | None
    pictures: tuple[int, int, int]  # the numbers of the pictures of its textures, from 0: wall, floor, ceiling
    portals: tuple[Portal, ...]  # by edge, and from start to end of each


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """Rooms with their portals; it is immutable, so worlds with the same plan share it."""

    rooms: tuple[RoomPlan, ...]
    first_edge: I64  # (rooms + 1,)
    edges: F64  # (edges, 7) of all rooms: start x, z, length, direction x, z, normal x, z
    portals: F64  # (portals, 6) of all rooms: edge, start and end along it, bottom, top, the room behind or -1
    pieces: F64  # (pieces, 5) what they leave of the walls: edge, start and end along it, bottom, top
    walls: F64  # (n, 4) x0, z0, x1, z1: every piece of wall that stands on the ground
    room_weights: tuple[float, ...]  # running sum of the rooms' shares of the floor

    def __deepcopy__(self, memo: dict[int, Any]) -> "FloorPlan":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return floor_plan, (self.rooms,)

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Return the smallest rectangle around all rooms: x0, z0, x1, z1."""
        shapes = [room.outline for room in self.rooms]
        return (
            min(shape.min_x for shape in shapes),
            min(shape.min_z for shape in shapes),
            max(shape.max_x for shape in shapes),
            max(shape.max_z for shape in shapes),
        )

    @cached_property
    def fingerprint(self) -> int:
        """Return a uint64 hash of the whole plan."""
        return hash64([(room.outline.table, *room[1:]) for room in self.rooms])


def finish_floor_plan(rooms: list[Room], rng: np.random.Generator | None) -> FloorPlan:
    """Return the finished floor plan; with a random stream, each room gets random pictures of its textures.

    Raises:
        WorldError: if there is no room, or two rooms overlap.
    """
    if not rooms:
        raise WorldError("the world has no rooms; add one before placing anything or ending build()")
    _check_overlap(rooms)
    return floor_plan(tuple([_finish_room(room, rng) for room in rooms]))


def _check_overlap(rooms: list[Room]) -> None:
    """Check that no rooms overlap, since the walls of each would stand in the other, where they cannot be seen.

    Raises:
        WorldError: if two rooms overlap.
    """
    low_x, high_x, low_z, high_z = (
        np.array([getattr(room.outline, name) for room in rooms]) for name in ("min_x", "max_x", "min_z", "max_z")
    )
    across = np.minimum(high_x[:, None], high_x) - np.maximum(low_x[:, None], low_x)
    down = np.minimum(high_z[:, None], high_z) - np.maximum(low_z[:, None], low_z)
    near = np.triu((across > _OVERLAPPING) & (down > _OVERLAPPING), 1)  # rooms whose bounding rectangles overlap
    for first, second in np.argwhere(near).tolist():
        a = rooms[first]
        b = rooms[second]
        if _overlap(a.outline, b.outline):
            raise WorldError(
                f"{_describe_room(first, a)} and {_describe_room(second, b)} overlap; move them apart, or make them "
                "one room with an outline of its own"
            )


def _overlap(a: RoomOutline, b: RoomOutline) -> bool:
    """Return whether two convex outlines share more than an edge.

    They do if no edge of either outline has the whole other outline on its outer side.
    """
    pairs = ((a, b), (b, a))
    return not any(_is_outside(other, edge) for outline, other in pairs for edge in outline.edges)


def _is_outside(outline: RoomOutline, edge: OutlineEdge) -> bool:
    """Return whether a whole outline is on the outer side of an edge, or touches it."""
    (x0, z0), (nx, nz) = edge.start, edge.normal
    return max(nx * (x - x0) + nz * (z - z0) for x, z in outline.corners) <= _OVERLAPPING


def _describe_room(number: int, room: Room) -> str:
    return f"room {number} (x {room.min_x:g} to {room.max_x:g}, z {room.min_z:g} to {room.max_z:g})"


@lru_cache(maxsize=_PLANS_KEPT)
def floor_plan(rooms: tuple[RoomPlan, ...]) -> FloorPlan:
    """Return the plan of rooms; the same object for the same rooms."""
    tables = [room.outline.table for room in rooms]
    first_edge = np.cumsum([0, *map(len, tables)])
    edges = np.concatenate(tables)
    portal_rows = []
    for room, first in zip(rooms, first_edge.tolist(), strict=False):
        for edge, start, end, top, into in room.portals:
            portal_rows.append((first + edge, start, end, 0.0, top, -1 if into is None else into))
    portals = np.array(portal_rows, dtype=np.float64).reshape(-1, 6)
    pieces = wall_pieces(first_edge, edges, np.array([room.wall_height for room in rooms]), portals)
    # a piece: its edge, its start and end along the edge, its lower and upper end
    standing = pieces[pieces[:, 3] == 0]
    piece_edges = edges[standing[:, 0].astype(np.int64)]
    corners = piece_edges[:, :2]
    directions = piece_edges[:, 3:5]
    starts = corners + standing[:, 1, None] * directions
    ends = corners + standing[:, 2, None] * directions
    walls = np.concatenate([ends, starts], axis=1)
    weights = running_sum([room.outline.area for room in rooms])
    return FloorPlan(rooms, first_edge, edges, portals, pieces, walls, weights)


def _finish_room(room: Room, rng: np.random.Generator | None) -> RoomPlan:
    """Return the finished room; a random stream draws the pictures of its textures."""
    textures = room.wall, room.floor, room.ceiling
    if rng is None:
        pictures = (0, 0, 0)
    else:
        pictures = (draw_variant(room.wall, rng), draw_variant(room.floor, rng), draw_variant(room.ceiling, rng))
    portals = tuple(sorted(room.portals, key=itemgetter(0, 1)))
    return RoomPlan(room.outline, float(room.wall_height), *textures, pictures, portals)


def draw_variant(texture: str | None, rng: np.random.Generator) -> int:
    """Return the number, from 0, of a picture of a texture, drawn from a random stream; 0 without a texture."""
    if texture is None:
        return 0
    return int(rng.integers(texture_variants(texture)))
