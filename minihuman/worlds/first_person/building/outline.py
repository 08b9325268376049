"""Outlines: convex shapes on the ground and the edges around them. Pure geometry, worked out once a shape.

An outline is listed counter-clockwise as seen from above (x right, z towards the reader), so that what it encloses lies
to the left of every edge. Lengths are metres.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError

KEPT = 4096  # shapes that are remembered: worlds are built anew at every reset, mostly of the same ones

Point = tuple[float, float]  # x, z


class Edge(NamedTuple):
    """One side of an outline: where it starts and ends, its length, its direction, and its normal inwards."""

    start: Point
    end: Point
    length: float
    direction: Point
    normal: Point

    def at(self, distance: float) -> Point:
        """The point so far along the edge."""
        return self.start[0] + distance * self.direction[0], self.start[1] + distance * self.direction[1]


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A shape; made by ``outline_of`` and ``rectangle`` only, which give the same one for the same corners."""

    corners: tuple[Point, ...]
    edges: tuple[Edge, ...]
    table: NDArray[np.float64]  # (edges, 7) start x, z, length, direction x, z, normal x, z
    min_x: float
    max_x: float
    min_z: float
    max_z: float

    @property
    def area(self) -> float:
        """The area of the bounding rectangle, m²: what a room weighs when one is drawn by chance."""
        return (self.max_x - self.min_x) * (self.max_z - self.min_z)

    def contains(self, x: float, z: float) -> bool:
        """Is the point inside, not on an edge?"""
        return all(nx * (x - ax) + nz * (z - az) > 0 for (ax, az), _, _, _, (nx, nz) in self.edges)

    def __reduce__(self) -> tuple[Any, ...]:
        return outline_of, (self.corners,)


@lru_cache(maxsize=KEPT)
def outline_of(corners: tuple[Point, ...]) -> Outline:
    """The shape with these corners (x, z).

    Raises:
        WorldError: if it does not close.
    """
    if len(corners) < 3:
        raise WorldError(f"the outline {list(corners)} has fewer than 3 corners; a room has to close")
    # + 0.0: of two zeros only one is kept, for shapes are remembered by their corners, in which the two are equal
    corners = tuple((float(x) + 0.0, float(z) + 0.0) for x, z in corners)
    edges = tuple(_edge(start, end) for start, end in zip(corners, corners[1:] + corners[:1], strict=True))
    across, down = zip(*corners, strict=True)
    table = np.array([(*edge.start, edge.length, *edge.direction, *edge.normal) for edge in edges])
    return Outline(corners, edges, table, min(across), max(across), min(down), max(down))


@lru_cache(maxsize=KEPT)
def rectangle(min_x: float, max_x: float, min_z: float, max_z: float) -> Outline:
    """A rectangle; its edges are east (0), north (1), west (2) and south (3).

    Raises:
        WorldError: if it has no width or no depth.
    """
    if not (min_x < max_x and min_z < max_z):
        raise WorldError(f"a room from x {min_x:g} to {max_x:g} and z {min_z:g} to {max_z:g} has no floor")
    return outline_of(((max_x, max_z), (max_x, min_z), (min_x, min_z), (min_x, max_z)))


@lru_cache(maxsize=KEPT)
def check_convex(shape: Outline) -> None:
    """Raise if the outline turns the wrong way anywhere.

    Raises:
        WorldError: if it is clockwise, crosses itself or has a dent.
    """
    turned = 0.0
    for before, after in zip(shape.edges, shape.edges[1:] + shape.edges[:1], strict=True):
        (ax, az), (bx, bz) = before.direction, after.direction
        turn = az * bx - ax * bz
        turned += math.atan2(turn, ax * bx + az * bz)
        if turn < -1e-9:
            raise WorldError(
                f"the outline {list(shape.corners)} turns right at {before.end}; "
                "list a convex outline counter-clockwise as seen from above"
            )
    if abs(turned - 2 * math.pi) > 1e-6:
        raise WorldError(f"the outline {list(shape.corners)} goes round more than once; a room closes in one turn")


def distance(a: Point, b: Point) -> float:
    """How far apart two points are."""
    dx, dz = b[0] - a[0], b[1] - a[1]
    return math.sqrt(dx * dx + dz * dz)


def _edge(start: Point, end: Point) -> Edge:
    length = distance(start, end)
    if length == 0:
        raise WorldError(f"an outline has the corner {start} twice in a row; a wall has a length")
    if not math.isfinite(length):
        raise WorldError(f"the wall {start} to {end} has no length; corners are two finite numbers, x and z in metres")
    x, z = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    norm = math.sqrt(z * z + x * x)
    return Edge(start, end, length, (x, z), (z / norm, -x / norm))
