"""What a building shows: the floors, ceilings, risers and walls of its sectors, and the openings between, for drawing.

The renderer's tables take flat convex faces at any height, so that a building is drawn by the kernels of flat worlds.
"""

from collections.abc import Collection
from typing import Any

import numpy as np

from minihuman.worlds.first_person.heights.plan import PlannedSector, SectorPlan, WallPiece
from minihuman.worlds.first_person.heights.planes import Area, Plane, split_around
from minihuman.worlds.first_person.heights.sectors import Hole
from minihuman.worlds.first_person.render.assets import Library
from minihuman.worlds.first_person.render.kernel_tables import F64, FaceTable, RoomTable
from minihuman.worlds.first_person.render.scene import Opening, SceneRoom, Surface, tables_of

_FLAT_M = 1e-9  # a side of a piece of wall that is lower has one corner


def building_tables(
    plan: SectorPlan, library: Library, *, display: bool = False, rooms: Collection[int] | None = None
) -> tuple[FaceTable, RoomTable]:
    """Return the renderer's tables of a building, or of some of its sectors, which then show no openings."""
    numbers = range(len(plan.rooms)) if rooms is None else sorted(rooms)
    return tables_of([_scene_room(plan, number, opens=rooms is None) for number in numbers], library)


def _scene_room(plan: SectorPlan, number: int, *, opens: bool) -> SceneRoom:
    room = plan.rooms[number]
    surfaces = [_level_surface(area, room.floor_plane, _variant(room, 1), is_floor=True) for area in _floor_areas(room)]
    if room.ceiling is not None:
        surfaces += [
            _level_surface(area, room.ceiling_plane, _variant(room, 2), is_floor=False)
            for area in _areas_around(room.outline.corners, room.ceiling_holes)
        ]
    surfaces += [_wall_surface(room, piece) for piece in plan.pieces[number]]
    openings: list[Opening] = []
    if opens:
        openings += [
            Opening(_upright(room, WallPiece(*opening[:5])), opening.into) for opening in room.openings
        ]
        openings += [Opening(_hole_corners(hole, room.floor_plane, is_floor=True), hole.into) for hole in room.floor_holes]
        openings += [
            Opening(_hole_corners(hole, room.ceiling_plane, is_floor=False), hole.into) for hole in room.ceiling_holes
        ]
    return SceneRoom(np.array(room.outline.corners), surfaces, openings, roofed=room.ceiling is not None)


def _variant(room: PlannedSector, part: int) -> str:
    """Return the picture of a sector's wall (0), floor (1) or ceiling (2)."""
    name = (room.wall, room.floor, room.ceiling)[part]
    return f"{name}_{room.pictures[part] + 1}"


def _floor_areas(room: PlannedSector) -> list[Area]:
    return _areas_around(room.outline.corners, room.floor_holes)


def _areas_around(corners: Area, holes: tuple[Hole, ...]) -> list[Area]:
    """Return the convex parts of an outline that holes leave."""
    areas = [corners]
    for hole in holes:
        areas = [part for area in areas for part in split_around(area, hole[:4])]
    return areas


def _level_surface(area: Area, plane: Plane, texture: str, *, is_floor: bool) -> Surface:
    """Return a part of a floor, seen from above, or of a ceiling, seen from below."""
    corners = np.array([(x, plane.at(x, z), z) for x, z in area])
    if not is_floor:
        corners = corners[::-1].copy()
    return Surface(corners, corners[:, (0, 2)].copy(), texture)


def _wall_surface(room: PlannedSector, piece: WallPiece) -> Surface:
    corners = _upright(room, piece)
    along = np.array([piece.start, piece.start, piece.end, piece.end])
    places = np.column_stack((along, corners[:, 1]))
    is_kept = np.array([piece.top[0] - piece.bottom[0] > _FLAT_M, True, True, piece.top[1] - piece.bottom[1] > _FLAT_M])
    return Surface(corners[is_kept], places[is_kept], _variant(room, 0))


def _upright(room: PlannedSector, piece: WallPiece) -> F64:
    """Return the corners of a piece of wall or an opening, (4, 3), counter-clockwise as seen from inside the room."""
    edge = room.outline.edges[piece.edge]
    x0, z0 = edge.at(piece.start)
    x1, z1 = edge.at(piece.end)
    corners: Any = (
        (x0, piece.bottom[0], z0),
        (x0, piece.top[0], z0),
        (x1, piece.top[1], z1),
        (x1, piece.bottom[1], z1),
    )
    return np.array(corners, np.float64)


def _hole_corners(hole: Hole, plane: Plane, *, is_floor: bool) -> F64:
    """Return the corners of a hole, (4, 3), as those of the floor or ceiling in which it lies."""
    outline = (hole.max_x, hole.max_z), (hole.max_x, hole.min_z), (hole.min_x, hole.min_z), (hole.min_x, hole.max_z)
    corners = np.array([(x, plane.at(x, z), z) for x, z in outline])
    if is_floor:
        return corners
    return corners[::-1].copy()
