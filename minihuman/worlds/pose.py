"""Pose and Map: one ground plane (x, z) for both kinds of world.

x points right, z points down the page (the grid's rows), y points up. Units are cells in the grid, metres in 3D.
A grid cell (column, row) is the unit square centred on (x=column, z=row).
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Pose:
    """Where someone stands and looks.

    ``yaw_rad`` is 0 along +x and grows counter-clockwise seen from above, so +pi/2 looks along -z (up the page).
    In the grid it is one of 0, -pi/2 (down), pi (left), pi/2 (up).
    """

    x: float
    y: float
    z: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Thing:
    """Something standing in the world: its name ("green goal"), place, radius and colour as "#rrggbb"."""

    name: str
    x: float
    z: float
    radius: float
    colour: str


@dataclass(frozen=True, slots=True)
class Map:
    """The floor plan seen from above, enough to draw paths without the world."""

    unit: Literal["cell", "m"]
    bounds: tuple[float, float, float, float]  # x0, z0, x1, z1
    walls: tuple[tuple[float, float, float, float], ...]  # segments x0, z0, x1, z1
    things: tuple[Thing, ...]
