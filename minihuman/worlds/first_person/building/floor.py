"""The finished floor plan: what no step changes. Rooms, the walls that stop a body, and how the rooms are covered."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.building.masonry import wall_pieces
from minihuman.worlds.first_person.building.outline import Outline
from minihuman.worlds.first_person.building.rooms import Portal, Room
from minihuman.worlds.first_person.chance import running_sum
from minihuman.worlds.first_person.extents import texture_variants
from minihuman.worlds.hashing import hash64

_PLANS_KEPT = 16

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class RoomPlan(NamedTuple):
    """One finished room."""

    outline: Outline
    wall_height: float
    wall: str  # names of textures
    floor: str
    ceiling: str | None
    pictures: tuple[int, int, int]  # which picture of each of its textures it has, wall, floor, ceiling; the first is 0
    portals: tuple[Portal, ...]  # by edge, and from start to end of each


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """Rooms with their portals cut; nothing here ever changes, so worlds with the same plan share it."""

    rooms: tuple[RoomPlan, ...]
    first_edge: I64  # (rooms + 1,)
    edges: F64  # (edges, 7) of all rooms: start x, z, length, direction x, z, normal x, z
    portals: (
        F64  # (portals, 6) of all rooms: edge, start and end along it, bottom, top, and the room behind, -1 for none
    )
    pieces: F64  # (pieces, 5) what they leave of the walls: edge, start and end along it, bottom, top
    walls: F64  # (n, 4) x0, z0, x1, z1: every piece of wall that stands on the ground
    room_weights: tuple[float, ...]  # running sum of the rooms' shares of the floor

    def __deepcopy__(self, memo: dict[int, Any]) -> "FloorPlan":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return floor_plan, (self.rooms,)

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """The smallest rectangle around all rooms: x0, z0, x1, z1."""
        shapes = [room.outline for room in self.rooms]
        return (
            min(shape.min_x for shape in shapes),
            min(shape.min_z for shape in shapes),
            max(shape.max_x for shape in shapes),
            max(shape.max_z for shape in shapes),
        )

    @cached_property
    def fingerprint(self) -> int:
        """A uint64 over the whole plan."""
        return hash64([(room.outline.table, *room[1:]) for room in self.rooms])


def finish(rooms: list[Room], rng: np.random.Generator | None) -> FloorPlan:
    """Close a floor plan; with a stream to draw from, each room gets a picture of each of its textures by chance.

    Raises:
        WorldError: if there is no room.
    """
    if not rooms:
        raise WorldError("the world has no room; add one before placing anything or ending build()")
    return floor_plan(tuple([_finished(room, rng) for room in rooms]))


@lru_cache(maxsize=_PLANS_KEPT)
def floor_plan(rooms: tuple[RoomPlan, ...]) -> FloorPlan:
    """The plan of these rooms; of the same rooms, the same plan."""
    tables = [room.outline.table for room in rooms]
    first_edge = np.cumsum([0, *map(len, tables)])
    edges = np.concatenate(tables)
    rows = [
        number
        for room, first in zip(rooms, first_edge.tolist(), strict=False)
        for edge, start, end, top, into in room.portals
        for number in (first + edge, start, end, 0.0, top, -1 if into is None else into)
    ]
    portals = np.array(rows, dtype=np.float64).reshape(-1, 6)
    pieces = wall_pieces(first_edge, edges, np.array([room.wall_height for room in rooms]), portals)
    standing = pieces[pieces[:, 3] == 0]
    along = edges[standing[:, 0].astype(np.int64)]
    walls = np.concatenate([along[:, :2] + standing[:, at, None] * along[:, 3:5] for at in (2, 1)], axis=1)
    weights = running_sum([room.outline.area for room in rooms])
    return FloorPlan(rooms, first_edge, edges, portals, pieces, walls, weights)


def _finished(room: Room, rng: np.random.Generator | None) -> RoomPlan:
    textures = room.wall, room.floor, room.ceiling
    pictures = (
        (0, 0, 0) if rng is None else (_drawn(room.wall, rng), _drawn(room.floor, rng), _drawn(room.ceiling, rng))
    )
    portals = tuple(sorted(room.portals, key=itemgetter(0, 1)))
    return RoomPlan(room.outline, float(room.wall_height), *textures, pictures, portals)


def _drawn(texture: str | None, rng: np.random.Generator) -> int:
    return 0 if texture is None else int(rng.integers(texture_variants(texture)))
