"""Walls: what portals leave of them, the faces that rooms show, and the collision of circles with them.

The functions are loops over flat tables and know no rules. The rows of `edges` are start x, z, length, direction x, z,
normal x, z; those of room r are first_edge[r] to first_edge[r + 1]. The rows of `portals` and of `pieces` of wall are
edge, start and end along it, bottom and top; they are ordered by edge, and by start within each. Lengths are in metres.
"""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.kernel_tables import F64, I32, I64, FaceTable
from minihuman.worlds.kernels import kernel

SLIVER_M = 0.05  # rooms that meet at an angle leave pieces of wall up to this width, which join nothing


@kernel("(float64[:, ::1], float64, float64, float64)")
def touches_wall(walls: NDArray[np.float64], x: float, z: float, radius: float) -> bool:
    """Return whether a circle overlaps a wall (mere touching does not count); ``walls`` are (n, 4) x0, z0, x1, z1."""
    for index in range(walls.shape[0]):
        ax = walls[index, 0]
        az = walls[index, 1]
        ab_x = walls[index, 2] - ax
        ab_z = walls[index, 3] - az
        share = ((x - ax) * ab_x + (z - az) * ab_z) / (ab_x * ab_x + ab_z * ab_z)
        share = min(max(share, 0.0), 1.0)
        dx = ax + share * ab_x - x
        dz = az + share * ab_z - z
        if math.sqrt(dx * dx + dz * dz) < radius:
            return True
    return False


# the surfaces of a room that have textures
FLOOR = 0
WALL = 1
CEILING = 2


def wall_pieces(first_edge: I64, edges: F64, heights: F64, portals: F64) -> F64:
    """Return the pieces of wall beside and above the portals, (n, 5); ``heights`` are those of the rooms."""
    pieces = np.zeros((len(edges) + 2 * len(portals), 5))
    return pieces[: _cut(first_edge, edges, heights, portals, pieces)].copy()


@kernel("(int64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1])", nogil=True)
def _cut(first_edge: I64, edges: F64, heights: F64, portals: F64, pieces: F64) -> int:
    """Write the pieces of wall to ``pieces``, which is 0 before; return the number of pieces."""
    count = 0
    portal = 0
    for room in range(len(heights)):
        for edge in range(first_edge[room], first_edge[room + 1]):
            reached = 0.0
            while portal < len(portals) and portals[portal, 0] == edge:
                start = portals[portal, 1]
                end = portals[portal, 2]
                top = portals[portal, 4]
                if start != reached:
                    pieces[count, 0] = edge
                    pieces[count, 1] = reached
                    pieces[count, 2] = start
                    pieces[count, 4] = heights[room]
                    count += 1
                if top != heights[room]:
                    pieces[count, 0] = edge
                    pieces[count, 1] = start
                    pieces[count, 2] = end
                    pieces[count, 3] = top
                    pieces[count, 4] = heights[room]
                    count += 1
                reached = end
                portal += 1
            if reached != edges[edge, 2]:
                pieces[count, 0] = edge
                pieces[count, 1] = reached
                pieces[count, 2] = edges[edge, 2]
                pieces[count, 4] = heights[room]
                count += 1
    return count


def corners_of(edges: F64, parts: F64) -> F64:
    """Return the corners (n, 4, 3) of pieces or portals, counter-clockwise as seen from inside the room."""
    corners = np.empty((len(parts), 4, 3))
    _turn(edges, parts, corners)
    return corners


@kernel("(float64[:, ::1], float64[:, ::1], float64[:, :, ::1])", nogil=True)
def _turn(edges: F64, parts: F64, corners: F64) -> None:
    """Write the corners of pieces or portals to ``corners``, in the order of `corners_of`."""
    for part in range(len(parts)):
        edge = int(parts[part, 0])
        # corners 0 and 1 are at the part's start, and 2 and 3 at its end; 1 and 2 are at its top
        for nth in range(4):
            along = parts[part, 1 + nth // 2]
            corner = corners[part, nth]
            corner[0] = edges[edge, 0] + along * edges[edge, 3]
            corner[2] = edges[edge, 1] + along * edges[edge, 4]
            corner[1] = parts[part, 4 if nth == 1 or nth == 2 else 3]


def room_faces(
    first_edge: I64, edges: F64, heights: F64, pieces: F64, textures: I64, sizes_m: F64
) -> tuple[FaceTable, I32]:
    """Return the faces of all rooms: floor, ceiling and pieces of wall, all white; and the first face of each room.

    The second result has the number of faces as its last entry.

    ``textures`` are (rooms, 3): those of floor, wall and ceiling, -1 without a ceiling; ``sizes_m`` are (rooms, 3, 2):
    the metres right and up that each texture covers.
    """
    rooms = len(heights)
    faces = np.empty((2 * rooms + len(pieces) + 1, 2), np.int32)
    table = np.empty((2 * len(edges) + 4 * len(pieces), 8))
    first_face = np.empty(rooms + 1, np.int32)
    _fill(first_edge, edges, heights, pieces, corners_of(edges, pieces), textures, sizes_m, table, faces, first_face)
    start, texture = faces[: first_face[-1] + 1].T.copy()
    corners = table[: start[-1]]
    positions = corners[:, :3].copy()
    texture_positions = corners[:, 3:5].copy()
    normals = corners[:, 5:8].copy()
    first_corner = start[:-1]
    distance = -np.sum(normals[first_corner] * positions[first_corner], axis=1)
    planes = np.column_stack((normals[first_corner], distance))
    white = np.ones((len(first_corner), 3))
    return FaceTable(start, positions, texture_positions, normals, white, texture[:-1].copy(), planes), first_face


@kernel(
    "(int64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, :, ::1], int64[:, ::1], "
    "float64[:, :, ::1], float64[:, ::1], int32[:, ::1], int32[::1])",
    nogil=True,
)
def _fill(
    first_edge: I64,
    edges: F64,
    heights: F64,
    pieces: F64,
    uprights: F64,
    textures: I64,
    sizes_m: F64,
    table: F64,
    faces: I32,
    first_face: I32,
) -> None:
    """Fill ``table`` (per corner: place, texture position, normal) and ``faces`` (first corner, texture)."""
    face = 0
    row = 0
    piece = 0
    for room in range(len(heights)):
        first = first_edge[room]
        last = first_edge[room + 1]
        first_face[room] = face
        for covering in (FLOOR, CEILING):
            if textures[room, covering] < 0:
                continue
            faces[face, 0] = row
            faces[face, 1] = textures[room, covering]
            face += 1
            for nth in range(last - first):
                if covering == FLOOR:
                    edge = first + nth
                else:
                    edge = last - 1 - nth
                y, up = (0.0, 1.0) if covering == FLOOR else (heights[room], -1.0)
                table[row, 0] = edges[edge, 0]
                table[row, 1] = y
                table[row, 2] = edges[edge, 1]
                table[row, 3] = edges[edge, 0] / sizes_m[room, covering, 0]
                table[row, 4] = edges[edge, 1] / sizes_m[room, covering, 1]
                table[row, 5] = 0.0
                table[row, 6] = up
                table[row, 7] = 0.0
                row += 1
        while piece < len(pieces) and pieces[piece, 0] < last:
            faces[face, 0] = row
            faces[face, 1] = textures[room, WALL]
            face += 1
            edge = int(pieces[piece, 0])
            for nth in range(4):
                for axis in range(3):
                    table[row, axis] = uprights[piece, nth, axis]
                table[row, 3] = pieces[piece, 1 + nth // 2] / sizes_m[room, WALL, 0]  # corners as in `_turn`
                table[row, 4] = uprights[piece, nth, 1] / sizes_m[room, WALL, 1]
                table[row, 5] = edges[edge, 5]
                table[row, 6] = 0.0
                table[row, 7] = edges[edge, 6]
                row += 1
            piece += 1
    first_face[len(heights)] = face
    faces[face, 0] = row
    faces[face, 1] = -1


def room_occluders(
    first_edge: I64, edges: F64, heights: F64, pieces: F64, textures: I64, sizes_m: F64, reach_m: float
) -> tuple[I32, F64]:
    """Return the occluders that darken each face of `room_faces` at its joints with other faces.

    The result is the arrays ``first_occluder`` and ``occluder`` of a `RoomTable`.

    A floor or ceiling is darkened by all walls within ``reach_m`` of its room, including those of other rooms. A piece
    of wall is darkened at its sides where a neighbour is wider than the slivers of rooms that meet at an angle.
    """
    edge = pieces[:, 0].astype(np.int64)
    start, end, bottom, top = pieces[:, 1:].T
    direction = edges[edge, 3:5]
    near_ends = edges[edge, :2] + start[:, None] * direction
    far_ends = edges[edge, :2] + end[:, None] * direction
    ground_segments = np.column_stack((near_ends, direction, end - start))
    low = np.minimum(near_ends, far_ends) - reach_m
    high = np.maximum(near_ends, far_ends) + reach_m
    room_of = np.searchsorted(first_edge, edge, side="right") - 1
    meets_ceiling = (textures[room_of, CEILING] >= 0) & (top == heights[room_of])
    sides = _side_segments(pieces)
    is_dark = _find_dark_sides(first_edge, edges, pieces, meets_ceiling)
    rows: list[F64] = []
    for room, height in enumerate(heights):
        corners = edges[first_edge[room] : first_edge[room + 1], :2]
        is_near = np.all((low <= corners.max(axis=0)) & (high >= corners.min(axis=0)), axis=1)
        for covering, touches in ((FLOOR, bottom == 0.0), (CEILING, top == height)):
            if textures[room, covering] >= 0:
                segments = ground_segments[is_near & touches]
                rows.append(_occluder_rows(segments, sizes_m[room, covering], covering == FLOOR))
        for piece in np.flatnonzero(room_of == room):
            segments = sides[is_dark[:, piece], :, piece]
            rows.append(_occluder_rows(segments, sizes_m[room, WALL]))
    return np.cumsum([0, *map(len, rows)]).astype(np.int32), np.concatenate(rows)


def _side_segments(pieces: F64) -> F64:
    """Return the bottom, top, start and end of each piece as segments in its plane, (4, 5, pieces).

    The five numbers are the place along the wall, the height, the direction in these two, and the length.
    """
    start, end, bottom, top = pieces[:, 1:].T
    zeros = np.zeros(len(pieces))
    level = (zeros + 1.0, zeros, end - start)
    upright = (zeros, zeros + 1.0, top - bottom)
    return np.array([(start, bottom, *level), (start, top, *level), (start, bottom, *upright), (end, bottom, *upright)])


def _find_dark_sides(first_edge: I64, edges: F64, pieces: F64, meets_ceiling: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return whether the bottom, top, start and end of each piece meet another face, (4, pieces)."""
    edge = pieces[:, 0].astype(np.int64)
    start, end, bottom, _ = pieces[:, 1:].T
    is_at_start = start == 0.0
    is_at_end = end == edges[edge, 2]
    is_wide = (bottom == 0.0) & (end - start > SLIVER_M)
    has_wall_at_start = np.zeros(len(edges), np.bool_)
    has_wall_at_start[edge[is_at_start & is_wide]] = True
    has_wall_at_end = np.zeros(len(edges), np.bool_)
    has_wall_at_end[edge[is_at_end & is_wide]] = True
    # the edges before and after each edge in its room's closed outline
    previous_edge = np.arange(len(edges)) - 1
    next_edge = np.arange(len(edges)) + 1
    previous_edge[first_edge[:-1]] = first_edge[1:] - 1
    next_edge[first_edge[1:] - 1] = first_edge[:-1]
    meets_previous = is_at_start & has_wall_at_end[previous_edge[edge]]
    meets_next = is_at_end & has_wall_at_start[next_edge[edge]]
    return np.array((bottom == 0.0, meets_ceiling, meets_previous, meets_next))


def _occluder_rows(segments: F64, size_m: F64, is_floor: bool = False) -> F64:
    """Return the rows of a face's occluders; a face without any gets a segment that is too far away to darken it."""
    if len(segments) == 0:
        segments = np.array([(1e6, 1e6, 1.0, 0.0, 0.0)])
    return np.column_stack((segments, np.tile((*size_m, float(is_floor)), (len(segments), 1))))
