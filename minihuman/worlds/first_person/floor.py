"""The finished floor plan: what no step changes. Rooms, the walls that stop a body, and how the rooms are covered."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.chance import running_sum
from minihuman.worlds.first_person.extents import texture_variants
from minihuman.worlds.first_person.rooms import Room, WallPiece
from minihuman.worlds.hashing import hash64


@dataclass(frozen=True, slots=True)
class Covering:
    """Which picture of each of its textures a room has: the first is 0."""

    wall: int
    floor: int
    ceiling: int


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """Rooms with their portals cut; nothing here ever changes, so copies of a world share it."""

    rooms: tuple[Room, ...]
    coverings: tuple[Covering, ...]  # one a room
    pieces: tuple[tuple[WallPiece, ...], ...]  # one tuple a room
    walls: NDArray[np.float64]  # (n, 4) x0, z0, x1, z1: every piece of wall that stands on the ground
    room_weights: tuple[float, ...]  # running sum of the rooms' shares of the floor

    def __deepcopy__(self, memo: dict[int, Any]) -> "FloorPlan":
        return self

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """The smallest rectangle around all rooms: x0, z0, x1, z1."""
        return (
            min(room.min_x for room in self.rooms),
            min(room.min_z for room in self.rooms),
            max(room.max_x for room in self.rooms),
            max(room.max_z for room in self.rooms),
        )

    @cached_property
    def fingerprint(self) -> int:
        """A uint64 over the whole plan."""
        return hash64([_plain(room, covering) for room, covering in zip(self.rooms, self.coverings, strict=True)])


def finish(rooms: list[Room], rng: np.random.Generator | None) -> FloorPlan:
    """Close a floor plan; with a stream to draw from, each room gets a picture of each of its textures by chance.

    Raises:
        WorldError: if there is no room.
    """
    if not rooms:
        raise WorldError("the world has no room; add one before placing anything or ending build()")
    pieces = tuple(tuple(room.wall_pieces()) for room in rooms)
    walls = [
        (*room.edges[piece.edge].at(piece.end), *room.edges[piece.edge].at(piece.start))
        for room, own in zip(rooms, pieces, strict=True)
        for piece in own
        if piece.bottom == 0
    ]
    return FloorPlan(
        rooms=tuple(rooms),
        coverings=tuple(_cover(room, rng) for room in rooms),
        pieces=pieces,
        walls=np.array(walls, dtype=np.float64).reshape(-1, 4),
        room_weights=running_sum([room.area for room in rooms]),
    )


def _cover(room: Room, rng: np.random.Generator | None) -> Covering:
    if rng is None:
        return Covering(0, 0, 0)
    wall, floor = (int(rng.integers(texture_variants(texture))) for texture in (room.wall, room.floor))
    return Covering(wall, floor, int(rng.integers(texture_variants(room.ceiling))) if room.ceiling else 0)


def _plain(room: Room, covering: Covering) -> tuple[Any, ...]:
    portals = [[portal[:4] for portal in wall] for wall in room.portals]
    looks = (room.floor, room.wall, room.ceiling, covering.floor, covering.wall, covering.ceiling)
    return room.outline, room.wall_height, portals, looks
