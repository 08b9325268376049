"""The finished plan of a building: its sectors and floors, which no step changes, and the checks of its layout."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.heights.planes import (
    LEAST_AREA_M2,
    Plane,
    area_of,
    common_area,
    cut_where_above,
)
from minihuman.worlds.first_person.heights.sectors import Hole, Sector, WallOpening
from minihuman.worlds.first_person.parameters import running_sum
from minihuman.worlds.first_person.rooms import RoomOutline, draw_variant
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import floor_at

_PLANS_KEPT = 16
_ROUNDING_M = 1e-9  # pieces of wall that are no larger come from rounding
_OVERLAP_M = 0.01  # how far two rooms may overlap in height
_LEAST_STOREY_M = 2.0  # levels less apart count as one floor: a podium belongs to the floor around it


class WallPiece(NamedTuple):
    """A piece of wall on an edge: its start and end along it, and its heights below and above at these two."""

    edge: int
    start: float
    end: float
    bottom: tuple[float, float]
    top: tuple[float, float]


class PlannedSector(NamedTuple):
    """One finished sector."""

    outline: RoomOutline
    floor_plane: Plane
    ceiling_plane: Plane
    wall: str  # names of textures
    floor: str
    ceiling: str | None
    pictures: tuple[int, int, int]  # the numbers of the pictures of its textures: wall, floor, ceiling
    levels: tuple[float, float]
    must_be_reached: bool
    openings: tuple[WallOpening, ...]
    floor_holes: tuple[Hole, ...]
    ceiling_holes: tuple[Hole, ...]

    @property
    def is_flight(self) -> bool:
        """Return whether it is a part of stairs or a ramp."""
        return self.levels[0] != self.levels[1]


@dataclass(frozen=True, eq=False)
class SectorPlan:
    """Sectors with their openings; it is immutable, so that worlds with the same plan share it."""

    rooms: tuple[PlannedSector, ...]
    pieces: tuple[tuple[WallPiece, ...], ...]  # of each sector
    walls: NDArray[np.float64]  # (n, 4) x0, z0, x1, z1: the pieces of wall that reach from floor to ceiling
    wall_rooms: NDArray[np.int64]  # (n,) the sector of each
    room_weights: tuple[float, ...]  # running sum of the sectors' shares of the floor, stairs and ramps left out
    levels: tuple[float, ...]  # the height of each floor, from below

    def __deepcopy__(self, memo: dict[int, Any]) -> "SectorPlan":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return sector_plan, (self.rooms,)

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
        return hash64([(room.outline.table, *map(_as_plain, room[1:])) for room in self.rooms])

    def floor_at(self, height: float) -> int:
        """Return the number of the floor, from 0, to which a height belongs."""
        return floor_at(self.levels, height)

    def floors_of(self, number: int) -> tuple[int, ...]:
        """Return the floors to which a sector belongs: one for a room, two or more for stairs and ramps."""
        low, high = self.rooms[number].levels
        return tuple(range(self.floor_at(low), self.floor_at(high) + 1))

    def describe(self, number: int) -> str:
        """Return a description of a sector for an error: its number, extents and the height of its floor."""
        room = self.rooms[number]
        shape = room.outline
        heights = sorted(room.floor_plane.at(x, z) for x, z in shape.corners)
        floor = f"floor at {heights[0]:g} m"
        if heights[0] != heights[-1]:
            floor = f"floor from {heights[0]:g} to {heights[-1]:g} m"
        return f"room {number} (x {shape.min_x:g} to {shape.max_x:g}, z {shape.min_z:g} to {shape.max_z:g}, {floor})"


def _as_plain(part: Any) -> Any:
    """Return a part of a sector in the form that is hashed: tuples of numbers and texts."""
    if isinstance(part, tuple):
        return tuple(map(_as_plain, part))
    return part


def finish_sector_plan(sectors: Sequence[Sector], rng: np.random.Generator | None) -> SectorPlan:
    """Return the finished plan; with a random stream, each sector gets random pictures of its textures.

    Raises:
        WorldError: if there is no room, or two rooms overlap in plan and in height.
    """
    if not sectors:
        raise WorldError("the world has no rooms; add one before placing anything or ending build()")
    return sector_plan(tuple([_finish_sector(sector, rng) for sector in sectors]))


def _finish_sector(sector: Sector, rng: np.random.Generator | None) -> PlannedSector:
    """Return the finished sector; a random stream draws the pictures of its textures."""
    textures = sector.wall, sector.floor, sector.ceiling
    pictures = (0, 0, 0)
    if rng is not None:
        pictures = (
            draw_variant(sector.wall, rng),
            draw_variant(sector.floor, rng),
            draw_variant(sector.ceiling, rng),
        )
    openings = tuple(sorted(sector.openings, key=lambda opening: (opening.edge, opening.start, opening.bottom)))
    return PlannedSector(
        sector.outline,
        sector.floor_plane,
        sector.ceiling_plane,
        *textures,
        pictures,
        sector.levels,
        sector.must_be_reached,
        openings,
        tuple(sorted(sector.floor_holes)),
        tuple(sorted(sector.ceiling_holes)),
    )


@lru_cache(maxsize=_PLANS_KEPT)
def sector_plan(rooms: tuple[PlannedSector, ...]) -> SectorPlan:
    """Return the plan of sectors; the same object for the same sectors.

    Raises:
        WorldError: if two sectors overlap in plan and in height.
    """
    pieces = tuple(_cut_walls(room) for room in rooms)
    rows = []
    wall_rooms = []
    for number, room in enumerate(rooms):
        for piece in pieces[number]:
            if _is_whole(room, piece):
                edge = room.outline.edges[piece.edge]
                rows.append((*edge.at(piece.start), *edge.at(piece.end)))
                wall_rooms.append(number)
    weights = running_sum([0.0 if room.is_flight else room.outline.area for room in rooms])
    plan = SectorPlan(
        rooms,
        pieces,
        np.array(rows, np.float64).reshape(-1, 4),
        np.array(wall_rooms, np.int64),
        weights,
        _find_levels(rooms),
    )
    check_overlaps(plan)
    return plan


def _find_levels(rooms: tuple[PlannedSector, ...]) -> tuple[float, ...]:
    """Return the heights of the floors, from below; a height less than a storey above another one is no floor."""
    heights = {room.levels[0] for room in rooms if not room.is_flight}
    if not heights:
        heights = {rooms[0].levels[0]}
    levels: list[float] = []
    for height in sorted(heights):
        if not levels or height - levels[-1] >= _LEAST_STOREY_M:
            levels.append(height)
    return tuple(levels)


def _cut_walls(room: PlannedSector) -> tuple[WallPiece, ...]:
    """Return the pieces of a sector's walls around its openings."""
    pieces = []
    for number, edge in enumerate(room.outline.edges):
        openings = [opening for opening in room.openings if opening.edge == number]
        cuts = sorted({0.0, edge.length, *(end for opening in openings for end in (opening.start, opening.end))})
        for start, end in pairwise(cuts):
            if end - start < _ROUNDING_M:
                continue
            middle = (start + end) / 2
            within = [opening for opening in openings if opening.start < middle < opening.end]
            pieces += _cut_column(room, number, start, end, within)
    return tuple(pieces)


def _cut_column(
    room: PlannedSector, number: int, start: float, end: float, openings: Sequence[WallOpening]
) -> list[WallPiece]:
    """Return the pieces of wall on an edge below, between and above openings, which all reach from start to end."""
    edge = room.outline.edges[number]
    ends = (edge.at(start), edge.at(end))
    bottom = tuple(room.floor_plane.at(*point) for point in ends)
    ceiling = tuple(room.ceiling_plane.at(*point) for point in ends)
    pieces = []
    for opening in sorted(openings, key=lambda opening: opening.bottom):
        starts, stops = zip(opening.heights_at(start), opening.heights_at(end), strict=True)
        pieces.append(WallPiece(number, start, end, (bottom[0], bottom[1]), (starts[0], starts[1])))
        bottom = stops
    pieces.append(WallPiece(number, start, end, (bottom[0], bottom[1]), (ceiling[0], ceiling[1])))
    return [
        piece for piece in pieces if max(piece.top[0] - piece.bottom[0], piece.top[1] - piece.bottom[1]) > _ROUNDING_M
    ]


def _is_whole(room: PlannedSector, piece: WallPiece) -> bool:
    """Return whether a piece of wall reaches from the floor to the ceiling, judged at its start."""
    edge = room.outline.edges[piece.edge]
    x, z = edge.at(piece.start)
    return piece.bottom[0] == room.floor_plane.at(x, z) and piece.top[0] == room.ceiling_plane.at(x, z)


def check_overlaps(plan: SectorPlan) -> None:
    """Check that no two sectors share a part of the plan at common heights.

    Raises:
        WorldError: if two do; the message names both.
    """
    rooms = plan.rooms
    low_x, high_x, low_z, high_z = (
        np.array([getattr(room.outline, name) for room in rooms]) for name in ("min_x", "max_x", "min_z", "max_z")
    )
    across = np.minimum(high_x[:, None], high_x) - np.maximum(low_x[:, None], low_x)
    down = np.minimum(high_z[:, None], high_z) - np.maximum(low_z[:, None], low_z)
    near = np.triu((across > _OVERLAP_M) & (down > _OVERLAP_M), 1)
    for first, second in np.argwhere(near).tolist():
        a = rooms[first]
        b = rooms[second]
        shared = common_area(a.outline.corners, b.outline.corners)
        shared = cut_where_above(shared, a.ceiling_plane, b.floor_plane, _OVERLAP_M)
        shared = cut_where_above(shared, b.ceiling_plane, a.floor_plane, _OVERLAP_M)
        if len(shared) > 2 and area_of(shared) > LEAST_AREA_M2:
            x, z = shared[0]
            bottom = max(a.floor_plane.at(x, z), b.floor_plane.at(x, z))
            top = min(a.ceiling_plane.at(x, z), b.ceiling_plane.at(x, z))
            raise WorldError(
                f"{plan.describe(first)} and {plan.describe(second)} overlap between {bottom:g} and {top:g} m of "
                "height; move them apart, or make one of them lower"
            )
