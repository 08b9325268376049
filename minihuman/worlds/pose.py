"""Poses and maps on the ground plane (x, z) that grid and first-person worlds share, and the outlines of walls on it.

x points right, z down the page (along the grid's rows) and y up. The unit is a cell in the grid and a metre in
first-person worlds. A grid cell (column, row) is the unit square centred on (x=column, z=row).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Pose:
    """A position in the world, and the direction of view.

    ``yaw_rad`` is 0 along +x and grows counter-clockwise seen from above, so +pi/2 looks along -z (up the page).
    In the grid it is one of 0, -pi/2 (down), pi (left), pi/2 (up).
    """

    x: float
    y: float
    z: float
    yaw_rad: float


_BELOW_FLOOR_M = 1.0  # a body on stairs belongs to the floor above it from this far below it


def floor_at(levels: Sequence[float], y: float) -> int:
    """Return the number of the floor to which a height belongs, counted from 0 at the bottom.

    Args:
        levels: the heights of the floors in metres, from the lowest to the highest.
        y: the height in metres. A height below every floor belongs to floor 0.
    """
    below = [number for number, level in enumerate(levels) if level <= y + _BELOW_FLOOR_M]
    return below[-1] if below else 0


@dataclass(frozen=True, slots=True)
class Thing:
    """An object in the world: its name ("green goal"), position, radius, colour as "#rrggbb", and floor, from 0."""

    name: str
    x: float
    z: float
    radius: float
    colour: str
    floor: int = 0


@dataclass(frozen=True, slots=True)
class Map:
    """The floor plan seen from above, sufficient to draw paths without the world.

    A building has several floors: ``levels`` are their heights from below, and ``wall_floors`` the floor of each wall.
    Both are empty in a flat world.
    """

    unit: Literal["cell", "m"]
    bounds: tuple[float, float, float, float]  # x0, z0, x1, z1
    walls: tuple[tuple[float, float, float, float], ...]  # segments x0, z0, x1, z1
    things: tuple[Thing, ...]
    levels: tuple[float, ...] = ()
    wall_floors: tuple[int, ...] = ()

    def floor_at(self, y: float) -> int:
        """Return the number of the floor to which a height belongs, from 0."""
        return floor_at(self.levels, y)

    def plan_of(self, floor: int) -> "Map":
        """Return the plan of one floor, as the map of a flat world."""
        walls = tuple(wall for wall, number in zip(self.walls, self.wall_floors, strict=True) if number == floor)
        return Map(self.unit, self.bounds, walls, tuple(thing for thing in self.things if thing.floor == floor))


def wall_outlines(is_wall: NDArray[np.bool_]) -> tuple[tuple[float, float, float, float], ...]:
    """Return the outlines of the walls as the longest possible straight segments x0, z0, x1, z1.

    Args:
        is_wall: bool[width, height], indexed by column and row; cell (c, r) is the unit square centred on (c, r).
    """
    solid = np.pad(is_wall, 1)
    upright = _join_faces(solid[1:, 1:-1] != solid[:-1, 1:-1])
    level = _join_faces((solid[1:-1, 1:] != solid[1:-1, :-1]).T)
    walls = [(edge, start, edge, end) for edge, start, end in upright]
    walls += [(start, edge, end, edge) for edge, start, end in level]
    return tuple(walls)


def _join_faces(edges: NDArray[np.bool_]) -> list[tuple[float, float, float]]:
    """Join adjacent faces of walls into the longest possible segments (line, start, end), in cells.

    Args:
        edges: bool[line, cell], whether the wall has a face on a line of the grid, along a cell. As cells are centred
            on whole numbers, line n lies at n - 0.5.
    """
    padded = np.pad(edges, ((0, 0), (1, 1))).astype(np.int8)
    turns = np.diff(padded, axis=1)
    starts = np.argwhere(turns == 1)
    ends = np.argwhere(turns == -1)
    return [(line - 0.5, start - 0.5, end - 0.5) for (line, start), (_, end) in zip(starts, ends, strict=True)]
