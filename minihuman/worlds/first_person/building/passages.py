"""Passages: how two rooms open to each other, through walls that touch or across the gap between them."""

from functools import lru_cache
from typing import NamedTuple

from minihuman.errors import WorldError
from minihuman.worlds.first_person.building.outline import KEPT, Edge, Outline, distance, outline_of
from minihuman.worlds.first_person.building.rooms import Portal, Room

_TOUCHING = 0.001  # metres: walls so close have no gap between them


class Limits(NamedTuple):
    """Where two rooms open to each other: from one x to another, or from one z to another."""

    min_x: float | None = None
    max_x: float | None = None
    min_z: float | None = None
    max_z: float | None = None


class Stretch(NamedTuple):
    """From where to where along which edge of an outline."""

    edge: int
    start: float
    end: float


class Joint(NamedTuple):
    """Where two shapes open to each other, and the shape of the gap between them; None where they touch.

    The gap's edge 1 runs along the first shape, its edge 3 along the second.
    """

    a: Stretch
    b: Stretch
    gap: Outline | None


def passage(a: Room, b: Room, *, limits: Limits, top: float | None, number: int) -> Room | None:
    """Cut facing portals into two rooms and give the passage between them, or None where they touch.

    The passage takes its textures from ``a``, and is as high as its portals.

    Raises:
        WorldError: if the rooms do not face each other or the portal does not fit a wall.
    """
    at = joint(a.outline, b.outline, limits)
    if at.gap is None:
        a.open(*at.a, top=top, into=b.number)
        b.open(*at.b, top=top, into=a.number)
        return None
    height = a.wall_height if top is None else top
    a.open(*at.a, top=top, into=number)
    b.open(*at.b, top=top, into=number)
    ends = ((edge, 0.0, at.gap.edges[edge].length, float(height)) for edge in (1, 3))
    portals = [Portal(*end, into=room.number) for end, room in zip(ends, (a, b), strict=True)]
    return Room(at.gap, height, a.floor, a.wall, a.ceiling, number, portals)


@lru_cache(maxsize=KEPT)
def joint(a: Outline, b: Outline, limits: Limits) -> Joint:
    """Where two shapes open to each other within limits.

    Raises:
        WorldError: if they do not face each other or the limits do not fit an edge.
    """
    index_a, index_b = _facing_edges(a, b)
    edge_a, edge_b = a.edges[index_a], b.edges[index_b]
    stretch_a, stretch_b = Stretch(index_a, *_stretch(edge_a, limits)), Stretch(index_b, *_stretch(edge_b, limits))
    a_start, a_end = edge_a.at(stretch_a.start), edge_a.at(stretch_a.end)
    b_start, b_end = edge_b.at(stretch_b.start), edge_b.at(stretch_b.end)
    if distance(a_start, b_end) < _TOUCHING:
        return Joint(stretch_a, stretch_b, None)
    return Joint(stretch_a, stretch_b, outline_of((b_start, a_end, a_start, b_end)))


def _facing_edges(a: Outline, b: Outline) -> tuple[int, int]:
    """The first pair of edges that look at each other."""
    for index_a, edge_a in enumerate(a.edges):
        (nx, nz), (ax, az) = edge_a.normal, edge_a.start
        for index_b, edge_b in enumerate(b.edges):
            if nx * edge_b.normal[0] + nz * edge_b.normal[1] > -0.9:
                continue
            if nx * (edge_b.start[0] - ax) + nz * (edge_b.start[1] - az) > 0.05:
                continue  # it lies inside the room
            return index_a, index_b
    raise WorldError(f"no wall of the room {list(a.corners)} faces a wall of the room {list(b.corners)}")


def _stretch(edge: Edge, limits: Limits) -> tuple[float, float]:
    """From where to where along an edge the limits reach."""
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
    ends = (low - origin) / slope + 0.0, (high - origin) / slope + 0.0  # + 0.0: of two zeros only one
    if not 0 <= min(ends) < max(ends) <= edge.length:
        raise WorldError(
            f"an opening from {'xz'[axis]} {low:g} to {high:g} does not fit the wall {edge.start} to {edge.end}, "
            f"which is {edge.length:g} m long"
        )
    return min(ends), max(ends)
