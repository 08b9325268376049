"""Rooms as they are being built: an outline with walls, what covers them, and portals (openings) cut into the walls.

Lengths are metres. A room stands on the ground; so does every portal.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from minihuman.errors import WorldError
from minihuman.worlds.first_person.building.outline import Outline

WALL_HEIGHT = 2.74


class Portal(NamedTuple):
    """An opening in the wall along one edge of a room, from ``start`` to ``end`` along it, up to ``top``.

    ``into`` is the number of the room behind it, None where it leads outside.
    """

    edge: int
    start: float
    end: float
    top: float
    into: int | None


@dataclass(slots=True, eq=False)
class Room:
    """One room: a shape, how high its walls are, what covers them, and the portals cut so far."""

    outline: Outline
    wall_height: float = WALL_HEIGHT
    floor: str = "floor_tiles_bw"  # names of textures
    wall: str = "concrete"
    ceiling: str | None = "concrete_tiles"  # None: open to the sky
    number: int = -1  # its place in the floor plan, from 0; -1 outside of one
    portals: list[Portal] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.wall_height > 0:
            raise WorldError(f"walls {self.wall_height!r} m high hold nothing; a wall is higher than 0")

    def __deepcopy__(self, memo: dict[int, Any]) -> "Room":
        return self  # no step changes a room: copies of a world share it

    @property
    def min_x(self) -> float:
        """Where the room begins along x."""
        return self.outline.min_x

    @property
    def max_x(self) -> float:
        """Where the room ends along x."""
        return self.outline.max_x

    @property
    def min_z(self) -> float:
        """Where the room begins along z."""
        return self.outline.min_z

    @property
    def max_z(self) -> float:
        """Where the room ends along z."""
        return self.outline.max_z

    def contains(self, x: float, z: float) -> bool:
        """Is the point inside the room, not on a wall?"""
        return self.outline.contains(x, z)

    def open(self, edge: int, start: float, end: float, *, top: float | None = None, into: int | None = None) -> None:
        """Cut a portal into a wall, from the ground up, between two distances along it; None is as high as the wall.

        Raises:
            WorldError: if the portal reaches past its wall or into another portal, or has no width or no height.
        """
        sides = self.outline.edges
        if not 0 <= edge < len(sides):
            raise WorldError(f"a room with {len(sides)} walls has no wall {edge}; walls count from 0")
        if top is None:
            top = self.wall_height
        side = sides[edge]
        if not 0 <= start < end <= side.length:
            raise WorldError(
                f"the portal from {start:g} to {end:g} m does not fit the wall {side.start} to {side.end}, "
                f"which is {side.length:g} m long"
            )
        if not 0 < top <= self.wall_height:
            raise WorldError(
                f"the portal is {top:g} m high; it is above 0 and at most as high as its wall, {self.wall_height:g} m"
            )
        for other in self.portals:
            if other.edge == edge and start < other.end and other.start < end:
                raise WorldError(
                    f"the portal from {start:g} to {end:g} m along the wall {side.start} to {side.end} "
                    f"overlaps the one from {other.start:g} to {other.end:g} m; leave wall between them"
                )
        self.portals.append(Portal(edge, float(start) + 0.0, float(end), float(top), into))  # one kind of zero only
