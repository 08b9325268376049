"""What darkens the faces of a building where they meet others, in the look of a display.

The faces come in the order of `surfaces`: of each sector its floors, its ceilings and its pieces of wall. An occluder
is a segment in the plane of a face's texture: x and z on a floor or ceiling, the distance along the edge and the height
on a wall. What is lower than the shade reaches, such as a riser, has none: it would be dark all over.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from minihuman.worlds.first_person.heights.plan import PlannedSector, SectorPlan, WallPiece
from minihuman.worlds.first_person.render.kernel_tables import F64, I32, OCCLUDER_SIZE

Segment = tuple[float, float, float, float, float]  # x, y, direction x, y, length

_LOW_M = 0.8  # pieces of wall that are lower have no joints
_SAME_M = 1e-6  # heights that differ by less count as equal
_NOWHERE: Segment = (1e6, 1e6, 1.0, 0.0, 0.0)  # too far from a face to darken it


def floor_joints(plan: SectorPlan, number: int) -> list[Segment]:
    """Return the segments at which walls meet a sector's floor or a neighbour's floor that continues it, level with it.

    Low pieces of wall are left out.
    """
    rooms = _find_level_sectors(plan, number)
    return [segment for room in rooms for segment in _find_joints(plan, room, is_floor=True)]


def ceiling_joints(plan: SectorPlan, number: int) -> list[Segment]:
    """Return the segments at which pieces of wall that are not low meet a sector's ceiling."""
    return list(_find_joints(plan, number, is_floor=False))


def _find_level_sectors(plan: SectorPlan, number: int) -> list[int]:
    """Return the number of a sector, and of those behind its openings whose floors have the same height there."""
    room = plan.rooms[number]
    rooms = [number]
    for opening in room.openings:
        x, z = room.outline.edges[opening.edge].at(opening.start)
        rise = plan.rooms[opening.into].floor_plane.at(x, z) - room.floor_plane.at(x, z)
        if abs(rise) < _SAME_M and opening.into not in rooms:
            rooms.append(opening.into)
    return rooms


def _find_joints(plan: SectorPlan, number: int, *, is_floor: bool) -> Iterator[Segment]:
    """Yield the segments at which pieces of wall meet the floor, or the ceiling, of their sector."""
    room = plan.rooms[number]
    for piece in plan.pieces[number]:
        if not _is_low(piece) and _meets(room, piece, is_floor=is_floor):
            edge = room.outline.edges[piece.edge]
            x, z = edge.at(piece.start)
            yield x, z, *edge.direction, piece.end - piece.start


def _is_low(piece: WallPiece) -> bool:
    return max(piece.top[0] - piece.bottom[0], piece.top[1] - piece.bottom[1]) < _LOW_M


def _meets(room: PlannedSector, piece: WallPiece, *, is_floor: bool) -> bool:
    """Return whether a piece of wall stands on the floor or, without ``is_floor``, reaches to the ceiling."""
    edge = room.outline.edges[piece.edge]
    plane = room.floor_plane if is_floor else room.ceiling_plane
    heights = piece.bottom if is_floor else piece.top
    ends = (edge.at(piece.start), edge.at(piece.end))
    return all(abs(plane.at(*end) - height) < _SAME_M for end, height in zip(ends, heights, strict=True))


def wall_joints(plan: SectorPlan, number: int, piece: WallPiece) -> list[Segment]:
    """Return the sides of a piece of wall at which it meets the floor, the ceiling or another wall."""
    room = plan.rooms[number]
    segments: list[Segment] = []
    if _is_low(piece):
        return segments
    if not room.is_flight and _meets(room, piece, is_floor=True):
        segments.append(_segment_between((piece.start, piece.bottom[0]), (piece.end, piece.bottom[1])))
    if room.ceiling is not None and _meets(room, piece, is_floor=False):
        segments.append(_segment_between((piece.start, piece.top[0]), (piece.end, piece.top[1])))
    starts, ends = _corner_heights(plan, number)
    previous_edge = (piece.edge - 1) % len(room.outline.edges)
    next_edge = (piece.edge + 1) % len(room.outline.edges)
    if piece.start == 0.0 and (previous_edge, piece.bottom[0]) in ends:
        segments.append(_segment_between((piece.start, piece.bottom[0]), (piece.start, piece.top[0])))
    if piece.end == room.outline.edges[piece.edge].length and (next_edge, piece.bottom[1]) in starts:
        segments.append(_segment_between((piece.end, piece.bottom[1]), (piece.end, piece.top[1])))
    return [segment for segment in segments if segment[4] > 0.0]


def _corner_heights(plan: SectorPlan, number: int) -> tuple[set[tuple[int, float]], set[tuple[int, float]]]:
    """Return the edges with a piece of wall at their start, and those with one at their end.

    Each is given as the edge's number and the height of the piece's lower end there. Low pieces are left out.
    """
    room = plan.rooms[number]
    pieces = [piece for piece in plan.pieces[number] if not _is_low(piece)]
    starts = {(piece.edge, piece.bottom[0]) for piece in pieces if piece.start == 0.0}
    ends = {(piece.edge, piece.bottom[1]) for piece in pieces if piece.end == room.outline.edges[piece.edge].length}
    return starts, ends


def _segment_between(start: tuple[float, float], end: tuple[float, float]) -> Segment:
    """Return the segment between two points of a plane; along x, with a length of 0, if they are the same."""
    x = end[0] - start[0]
    y = end[1] - start[1]
    length = math.sqrt(x * x + y * y)
    if length == 0.0:
        return *start, 1.0, 0.0, 0.0
    return *start, x / length, y / length, length


class OccludedFace(NamedTuple):
    """A face that segments darken, the metres that its texture covers, and whether things darken it as a floor."""

    segments: list[Segment]
    size_m: tuple[float, float]  # right and up
    is_floor: bool


def occluder_table(faces: Sequence[OccludedFace]) -> tuple[I32, F64]:
    """Return the arrays ``first_occluder`` and ``occluder`` of a `RoomTable`; a face without any gets a far segment."""
    rows = []
    starts = [0]
    for face in faces:
        rows += [(*segment, *face.size_m, float(face.is_floor)) for segment in face.segments or [_NOWHERE]]
        starts.append(len(rows))
    return np.array(starts, np.int32), np.array(rows, np.float64).reshape(-1, OCCLUDER_SIZE)
