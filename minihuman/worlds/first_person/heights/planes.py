"""Planes of floors and ceilings over the plan, and convex areas of the plan.

All numbers are sums, products and quotients of doubles, so that they are the same on every machine. Lengths are in
metres.
"""

from collections.abc import Sequence
from typing import NamedTuple

from minihuman.worlds.first_person.rooms import Point

Area = tuple[Point, ...]  # the corners of a convex area, counter-clockwise as seen from above

LEAST_AREA_M2 = 1e-4  # two rooms that share less only touch


class Plane(NamedTuple):
    """A plane over the plan: its height at (0, 0), and by how much it rises per metre along x and z."""

    height: float
    rise_x: float = 0.0
    rise_z: float = 0.0

    def at(self, x: float, z: float) -> float:
        """Return the height of the plane over a point of the plan."""
        return self.height + self.rise_x * x + self.rise_z * z

    def raised(self, by_m: float) -> "Plane":
        """Return this plane raised by ``by_m`` metres."""
        return Plane(self.height + by_m, self.rise_x, self.rise_z)

    @property
    def is_level(self) -> bool:
        """Return whether the plane has one height everywhere."""
        return self.rise_x == 0.0 and self.rise_z == 0.0


def slope_between(axis: int, low: float, high: float, low_y: float, high_y: float) -> Plane:
    """Return the plane with the height ``low_y`` at ``low`` and ``high_y`` at ``high`` along x (axis 0) or z (1)."""
    rise = (high_y - low_y) / (high - low)
    height = low_y - rise * low
    return Plane(height, rise, 0.0) if axis == 0 else Plane(height, 0.0, rise)


def area_of(corners: Sequence[Point]) -> float:
    """Return the area in m² of a polygon with the corners (x, z)."""
    twice_area = 0.0
    for (ax, az), (bx, bz) in zip(corners, [*corners[1:], *corners[:1]], strict=True):
        twice_area += ax * bz - bx * az
    return abs(twice_area) / 2


def cut_area(corners: Sequence[Point], at_zero: float, per_x: float, per_z: float) -> list[Point]:
    """Return the corners of the part of a convex area in which ``at_zero + per_x * x + per_z * z`` is 0 or more."""
    kept: list[Point] = []
    for a, b in zip(corners, [*corners[1:], *corners[:1]], strict=True):
        side_a = at_zero + per_x * a[0] + per_z * a[1]
        side_b = at_zero + per_x * b[0] + per_z * b[1]
        if side_a >= 0:
            kept.append(a)
        if (side_a > 0 > side_b) or (side_a < 0 < side_b):
            share = side_a / (side_a - side_b)
            kept.append((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
    return kept


def common_area(a: Area, b: Area) -> list[Point]:
    """Return the corners of what two convex areas share; empty if they share nothing."""
    shared = list(a)
    for (x0, z0), (x1, z1) in zip(b, [*b[1:], *b[:1]], strict=True):
        per_x = z1 - z0  # to the left of an edge, as corners run counter-clockwise with z down the page
        per_z = x0 - x1
        shared = cut_area(shared, -(per_x * x0 + per_z * z0), per_x, per_z)
        if not shared:
            break
    return shared


def cut_where_above(corners: Sequence[Point], upper: Plane, lower: Plane, margin_m: float) -> list[Point]:
    """Return the corners of the part of a convex area in which one plane is above another by at least a margin."""
    return cut_area(
        corners, upper.height - lower.height - margin_m, upper.rise_x - lower.rise_x, upper.rise_z - lower.rise_z
    )


def split_around(corners: Area, hole: tuple[float, float, float, float]) -> list[Area]:
    """Return the convex parts of an area around a rectangular hole: min_x, min_z, max_x, max_z."""
    min_x, min_z, max_x, max_z = hole
    within_x = cut_area(cut_area(corners, -min_x, 1.0, 0.0), max_x, -1.0, 0.0)
    parts = [
        cut_area(corners, min_x, -1.0, 0.0),
        cut_area(corners, -max_x, 1.0, 0.0),
        cut_area(within_x, min_z, 0.0, -1.0),
        cut_area(within_x, -max_z, 0.0, 1.0),
    ]
    return [tuple(part) for part in parts if len(part) > 2 and area_of(part) > LEAST_AREA_M2]
