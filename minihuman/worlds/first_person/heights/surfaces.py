"""What a building shows: the floors, ceilings, risers and walls of its sectors, and the openings between, for drawing.

The renderer's tables take flat convex faces at any height, so that a building is drawn by the kernels of flat worlds.
"""

import math
from collections.abc import Sequence, Sized
from typing import Any

import numpy as np

from minihuman.worlds.first_person.heights.joints import (
    OccludedFace,
    ceiling_joints,
    floor_joints,
    occluder_table,
    wall_joints,
)
from minihuman.worlds.first_person.heights.plan import PlannedSector, SectorPlan, WallPiece
from minihuman.worlds.first_person.heights.planes import Area, Plane, split_around
from minihuman.worlds.first_person.heights.sectors import Hole
from minihuman.worlds.first_person.render.assets import Library, pack
from minihuman.worlds.first_person.render.kernel_tables import F64, I32, FaceTable, RoomTable
from minihuman.worlds.first_person.render.scene import Opening, SceneRoom, Surface

_FLAT_M = 1e-9  # a piece of wall has one corner at a side that is lower
_RISER_M = 0.5  # the highest riser of stairs
_LINE_M = 0.14  # the width of walls on a plan
_WALL_SHADE = 0.12  # the brightness of walls on a plan, as a share of that of the floor beside them
_DARKEST = 0.6  # the share of its brightness that the upper end of stairs loses on a plan

# a sector's textures
_WALL = 0
_FLOOR = 1
_CEILING = 2


def building_tables(plan: SectorPlan, library: Library, *, display: bool = False) -> tuple[FaceTable, RoomTable]:
    """Return the renderer's tables of a building; for a display, with the occluders that darken its corners."""
    faces, room_table = _join_rooms([_scene_room(plan, number) for number in range(len(plan.rooms))], library)
    if display:
        occluded = [face for number in range(len(plan.rooms)) for face in _occluded_faces(plan, library, number)]
        first_occluder, occluder = occluder_table(occluded)
        room_table = room_table._replace(first_occluder=first_occluder, occluder=occluder)
    return faces, room_table


def _join_rooms(rooms: Sequence[SceneRoom], library: Library) -> tuple[FaceTable, RoomTable]:
    """Return the renderer's tables of rooms."""
    surfaces = [surface for room in rooms for surface in room.surfaces]
    openings = [opening for room in rooms for opening in room.openings]
    faces = pack(
        [surface.corners for surface in surfaces],
        [surface.texture_m / np.array(library.texture_size_m(surface.texture)) for surface in surfaces],
        [library.texture_row(surface.texture) for surface in surfaces],
    )
    outlines = [room.outline for room in rooms]
    table = RoomTable(
        _starts([room.surfaces for room in rooms]),
        np.array([(*outline.min(axis=0), *outline.max(axis=0)) for outline in outlines]),
        _starts(outlines),
        np.concatenate([_edge_lines(outline) for outline in outlines]),
        _starts([room.openings for room in rooms]),
        np.array([opening.corners for opening in openings]).reshape(-1, 4, 3),
        np.array([opening.into for opening in openings], np.int32),
        np.array([room.roofed for room in rooms]),
    )
    return faces, table


def _starts(parts: Sequence[Sized]) -> I32:
    """Return where the parts of each room begin in a table of all rooms, int32[rooms + 1]."""
    return np.cumsum([0, *map(len, parts)]).astype(np.int32)


def _edge_lines(outline: F64) -> F64:
    """Return the line of each edge of an outline, (n, 3) a, b, c: a*x + b*z + c is above 0 inside."""
    along = np.roll(outline, -1, axis=0) - outline
    along /= np.sqrt(np.sum(along * along, axis=1, keepdims=True))
    a = along[:, 1]
    b = -along[:, 0]
    return np.column_stack([a, b, -(a * outline[:, 0] + b * outline[:, 1])])


def _occluded_faces(plan: SectorPlan, library: Library, number: int) -> list[OccludedFace]:
    """Return the faces of a sector with the segments that darken them, in the order of its surfaces."""
    room = plan.rooms[number]
    floor = OccludedFace(
        floor_joints(plan, number),
        library.texture_size_m(_texture_name(room, _FLOOR)),
        room.floor_plane == Plane(0.0),  # the kernel darkens the floor around things only at y = 0
    )
    faces = [floor] * len(_areas_around(room.outline.corners, room.floor_holes))
    if room.ceiling is not None:
        ceiling = OccludedFace(
            ceiling_joints(plan, number), library.texture_size_m(_texture_name(room, _CEILING)), False
        )
        faces += [ceiling] * len(_areas_around(room.outline.corners, room.ceiling_holes))
    for piece in plan.pieces[number]:
        size_m = library.texture_size_m(_piece_texture(plan, number, piece))
        faces.append(OccludedFace(wall_joints(plan, number, piece), size_m, False))
    return faces


def floor_tables(plan: SectorPlan, library: Library, rooms: Sequence[int]) -> tuple[FaceTable, RoomTable]:
    """Return the renderer's tables of some sectors as they are seen from above, in the bounds of the whole building.

    Walls are dark lines. Stairs get dark from below to above, so that a plan shows where they rise.
    """
    scene_rooms = []
    shades: list[float] = []
    for number in rooms:
        floors = _floor_surfaces(plan.rooms[number])
        lines = _wall_lines(plan, number)
        shades += [_plan_shade(plan.rooms[number])] * len(floors) + [_WALL_SHADE] * len(lines)
        scene_rooms.append(SceneRoom(np.array(plan.rooms[number].outline.corners), [*floors, *lines]))
    faces, room_table = _join_rooms(scene_rooms, library)
    faces.colour[:] = np.array(shades)[:, None]
    x0, z0, x1, z1 = plan.bounds
    bounds = np.tile(np.array((x0, z0, x1, z1)), (len(rooms), 1))
    return faces, room_table._replace(bounds=bounds)


def _wall_lines(plan: SectorPlan, number: int) -> list[Surface]:
    """Return the walls of a sector as level strips, a little above its floor."""
    room = plan.rooms[number]
    surfaces = []
    for x0, z0, x1, z1 in plan.walls[plan.wall_rooms == number].tolist():
        length = math.hypot(x1 - x0, z1 - z0)
        ahead_x = _LINE_M / 2 * (x1 - x0) / length
        ahead_z = _LINE_M / 2 * (z1 - z0) / length
        area = (  # also half a width beyond both ends, so that lines join at corners
            (x1 + ahead_x + ahead_z, z1 + ahead_z - ahead_x),
            (x0 - ahead_x + ahead_z, z0 - ahead_z - ahead_x),
            (x0 - ahead_x - ahead_z, z0 - ahead_z + ahead_x),
            (x1 + ahead_x - ahead_z, z1 + ahead_z + ahead_x),
        )
        surfaces.append(
            _level_surface(area, room.floor_plane.raised(_LINE_M), _texture_name(room, _FLOOR), is_floor=True)
        )
    return surfaces


def _plan_shade(room: PlannedSector) -> float:
    """Return the brightness of a sector on a plan: 1 for a room, and less for higher parts of stairs and ramps."""
    if not room.is_flight:
        return 1.0
    low, high = room.levels
    heights = [room.floor_plane.at(x, z) for x, z in room.outline.corners]
    return 1.0 - _DARKEST * ((min(heights) + max(heights)) / 2 - low) / (high - low)


def _scene_room(plan: SectorPlan, number: int) -> SceneRoom:
    """Return a sector as a room for the renderer: floors, ceilings, walls, and the openings to other sectors."""
    room = plan.rooms[number]
    surfaces = _floor_surfaces(room)
    if room.ceiling is not None:
        surfaces += [
            _level_surface(area, room.ceiling_plane, _texture_name(room, _CEILING), is_floor=False)
            for area in _areas_around(room.outline.corners, room.ceiling_holes)
        ]
    surfaces += [_wall_surface(room, piece, _piece_texture(plan, number, piece)) for piece in plan.pieces[number]]
    # the first five fields of an opening are those of a piece of wall in its place
    openings = [Opening(_upright_corners(room, WallPiece(*opening[:5])), opening.into) for opening in room.openings]
    openings += [Opening(_hole_corners(hole, room.floor_plane, is_floor=True), hole.into) for hole in room.floor_holes]
    openings += [
        Opening(_hole_corners(hole, room.ceiling_plane, is_floor=False), hole.into) for hole in room.ceiling_holes
    ]
    return SceneRoom(np.array(room.outline.corners), surfaces, openings, roofed=room.ceiling is not None)


def _texture_name(room: PlannedSector, part: int) -> str:
    """Return the name of the texture of a sector's wall, floor or ceiling, with the number of its picture."""
    name = (room.wall, room.floor, room.ceiling)[part]
    return f"{name}_{room.pictures[part] + 1}"


def _floor_surfaces(room: PlannedSector) -> list[Surface]:
    areas = _areas_around(room.outline.corners, room.floor_holes)
    return [_level_surface(area, room.floor_plane, _texture_name(room, _FLOOR), is_floor=True) for area in areas]


def _areas_around(corners: Area, holes: tuple[Hole, ...]) -> list[Area]:
    """Return the convex areas into which an outline is divided around its holes."""
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


def _piece_texture(plan: SectorPlan, number: int, piece: WallPiece) -> str:
    """Return the texture of a piece of wall; the first riser of stairs, below an opening onto them, has theirs."""
    room = plan.rooms[number]
    for opening in room.openings:
        is_above = opening.edge == piece.edge and opening.start <= piece.start and piece.end <= opening.end
        behind = plan.rooms[opening.into]
        if is_above and behind.is_flight and opening.heights_at(piece.start)[0] == piece.top[0]:
            return _texture_name(behind, _FLOOR)
    return _texture_name(room, _FLOOR if room.is_flight and _is_riser(room, piece) else _WALL)


def _is_riser(room: PlannedSector, piece: WallPiece) -> bool:
    """Return whether a piece of a tread's wall is low and stands on it, as the riser below a landing does."""
    edge = room.outline.edges[piece.edge]
    x, z = edge.at(piece.start)
    return piece.bottom[0] == room.floor_plane.at(x, z) and piece.top[0] - piece.bottom[0] <= _RISER_M


def _wall_surface(room: PlannedSector, piece: WallPiece, texture: str) -> Surface:
    """Return a piece of wall as a surface of three or four corners."""
    corners = _upright_corners(room, piece)
    along = np.array([piece.start, piece.start, piece.end, piece.end])
    texture_m = np.column_stack((along, corners[:, 1]))
    is_kept = np.array([piece.top[0] - piece.bottom[0] > _FLAT_M, True, True, piece.top[1] - piece.bottom[1] > _FLAT_M])
    return Surface(corners[is_kept], texture_m[is_kept], texture)


def _upright_corners(room: PlannedSector, piece: WallPiece) -> F64:
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
