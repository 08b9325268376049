"""Visibility: which rooms and things are in sight, what hides what, which face covers each sample, and its distance.

From the camera's room through openings to the next; what is sure to be hidden is left out, by how near all that was
drawn before is at least, in tiles. Also the buffers that a picture is drawn in, cut out of two long arrays, as a kernel
takes few arrays.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.kernel_tables import (
    AROUND,
    BEGIN,
    END,
    F64,
    FACE,
    FIRST,
    I32,
    LAST,
    OCCLUDER_SIZE,
    REACH,
    THING_BOX,
    THING_NORMAL_SCALE,
    THING_SCALE,
    THING_TINT,
    DrawBuffers,
    FaceTable,
    RoomTable,
)
from minihuman.worlds.first_person.render.rasterisation import (
    BOTTOM,
    CENTRE_X,
    CENTRE_Y,
    COS,
    EYE,
    FAR,
    FOCAL_X,
    FOCAL_Y,
    FORWARD,
    HEIGHT,
    LIGHT,
    NEAR,
    NORMAL_SCALE,
    OWN_EYE,
    PARALLEL,
    PLACE,
    PLACEMENT_SIZE,
    RIGHT,
    ROOM,
    ROW_STEP,
    SAMPLE_X,
    SCALE,
    SIN,
    SKY,
    TILES,
    TINT,
    TOP,
    UP,
    WIDTH,
    cut,
    draw_face,
    tile_size,
    turn_to,
)
from minihuman.worlds.first_person.render.texture import LANES, MOST_TAPS, SCANLINE_BUFFER, TAP
from minihuman.worlds.kernels import device_function, int64, kernel

DOORSTEP_M = 0.06  # a camera this close to an opening may see through all of it
VISITS_A_ROOM = 16


class Sight(NamedTuple):
    """Which rooms are in sight, and through which part of the picture: x0, y0, x1, y1 in whole pixels."""

    order: I32  # (rooms,) nearest first
    windows: F64  # (rooms, 4)
    visits: I32  # (rooms,)
    pending: I32  # (VISITS_A_ROOM * rooms,) rooms to visit
    pending_windows: F64  # (VISITS_A_ROOM * rooms, 4) by which each is visited


@device_function(nogil=True, force_inline=True)
def contains(rooms: RoomTable, room: int, x: float, z: float) -> bool:
    """Is the place inside the room or within a millionth of a metre of it?"""
    for e in range(rooms.first_edge[room], rooms.first_edge[room + 1]):
        if rooms.edge[e, 0] * x + rooms.edge[e, 1] * z + rooms.edge[e, 2] < -1e-6:
            return False
    return True


@device_function(nogil=True, force_inline=True, count=int64, whole=int64)
def through(rooms: RoomTable, opening: int, view: F64, corners: F64, window: F64, result: F64) -> bool:
    """The part of a window through which an opening is seen, into ``result``; False if none is."""
    hole = rooms.opening[opening]
    ax, ay, az = hole[1, 0] - hole[0, 0], hole[1, 1] - hole[0, 1], hole[1, 2] - hole[0, 2]
    bx, by, bz = hole[3, 0] - hole[0, 0], hole[3, 1] - hole[0, 1], hole[3, 2] - hole[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    away = nx * (view[EYE] - hole[0, 0]) + ny * (view[EYE + 1] - hole[0, 1]) + nz * (view[EYE + 2] - hole[0, 2])
    away /= np.sqrt(nx * nx + ny * ny + nz * nz)
    if away < -DOORSTEP_M:
        return False
    if away < DOORSTEP_M:
        result[0], result[1], result[2], result[3] = window[0], window[1], window[2], window[3]
        return True
    for i in range(4):
        wx, wy, wz = hole[i, 0] - view[EYE], hole[i, 1] - view[EYE + 1], hole[i, 2] - view[EYE + 2]
        corners[0, i, 0] = view[RIGHT] * wx + view[RIGHT + 1] * wy + view[RIGHT + 2] * wz
        corners[0, i, 1] = view[UP] * wx + view[UP + 1] * wy + view[UP + 2] * wz
        corners[0, i, 2] = view[FORWARD] * wx + view[FORWARD + 1] * wy + view[FORWARD + 2] * wz
    count = 4
    whole = 0
    count = cut(corners, whole, count, 0.0, 0.0, 1.0, -1e-6)
    if count < 3:
        return False
    x0 = y0 = 1e9
    x1 = y1 = -1e9
    for i in range(count):
        z = corners[1, i, 2]
        x = view[CENTRE_X] + view[FOCAL_X] * corners[1, i, 0] / z
        y = view[CENTRE_Y] - view[FOCAL_Y] * corners[1, i, 1] / z
        x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
    # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
    result[0] = max(window[0], np.floor(x0) - 1.0)
    result[1] = max(window[1], np.floor(y0) - 1.0)
    result[2] = min(window[2], np.ceil(x1) + 1.0)
    result[3] = min(window[3], np.ceil(y1) + 1.0)
    return bool(result[0] < result[2] and result[1] < result[3])


@device_function(nogil=True, force_inline=True)
def visit(rooms: RoomTable, view: F64, corners: F64, picture: F64, sight: Sight) -> tuple[int, bool]:
    """List the rooms to draw, nearest first, and the window of each.

    ``picture`` is the window of the whole picture. A window may be larger than needed, never smaller. From above, from
    outside every room, and where a room without a roof is in sight, all rooms are listed.

    Returns how many are listed, and whether all are.
    """
    order, windows, visits, pending = sight.order, sight.windows, sight.visits, sight.pending
    count = order.shape[0]
    seen = 0
    everything = view[PARALLEL] == 1.0
    windows[:, :2] = 1e9
    windows[:, 2:] = -1e9
    visits[:] = 0
    waiting = 0
    if not everything:
        for room in range(count):
            if contains(rooms, room, view[EYE], view[EYE + 2]):
                pending[waiting] = room
                for side in range(4):
                    sight.pending_windows[waiting, side] = picture[side]
                visits[room] = 1
                waiting += 1
        everything = waiting == 0
    done = 0
    while done < waiting and not everything:
        room, window = pending[done], sight.pending_windows[done]
        done += 1
        everything, known = not rooms.roofed[room], windows[room]
        if known[0] > known[2]:
            order[seen] = room
            seen += 1
        elif window[0] >= known[0] and window[1] >= known[1] and window[2] <= known[2] and window[3] <= known[3]:
            continue
        known[0], known[1] = min(known[0], window[0]), min(known[1], window[1])
        known[2], known[3] = max(known[2], window[2]), max(known[3], window[3])
        for opening in range(rooms.first_opening[room], rooms.first_opening[room + 1]):
            into = rooms.opening_into[opening]
            if visits[into] == VISITS_A_ROOM:
                continue
            beyond = sight.pending_windows[waiting]
            if not through(rooms, opening, view, corners, window, beyond):
                continue
            visits[into] += 1
            pending[waiting] = into
            if visits[into] == VISITS_A_ROOM:
                beyond[0], beyond[1], beyond[2], beyond[3] = picture[0], picture[1], picture[2], picture[3]
            waiting += 1
    if everything:
        for room in range(count):
            for side in range(4):
                windows[room, side] = picture[side]
            order[room] = room
        seen = count
    return seen, everything


# Where in the whole numbers stand: the colours of what is looked up along a row; which sizes of a texture that takes,
# under which light and at which places; the row's stretches; a row of the picture; the spans.
SIZES = SCANLINE_BUFFER + LANES
LIGHTS = SIZES + 5 * LANES
PLACES = LIGHTS + 2 * LANES
TAPS = PLACES + TAP * MOST_TAPS
FRAGMENT_GROUPS = TAPS + SCANLINE_BUFFER // LANES
MAX_FRAGMENT_GROUPS = 264
LINE = FRAGMENT_GROUPS + 5 * (2 * MAX_FRAGMENT_GROUPS + 4)
SPANS = LINE + 4096 + 2 * LANES


def packed_faces(faces: FaceTable) -> tuple[F64, I32]:
    """A table of faces as two arrays; see `faces_of`."""
    start, position, place, normal, colour, texture, plane = faces
    floats = [position, place, normal, colour, plane]
    sizes = np.array([len(position), len(texture)], np.int32)
    return np.concatenate([each.ravel() for each in floats]), np.concatenate([sizes, start, texture])


def packed_rooms(rooms: RoomTable) -> tuple[F64, I32]:
    """A table of rooms as two arrays; see `rooms_of`."""
    sizes = np.array([len(rooms.bounds), len(rooms.edge), len(rooms.opening)], np.int32)
    wholes = [sizes, rooms.first_face, rooms.first_edge, rooms.first_opening, rooms.opening_into]
    floats = np.concatenate([each.ravel() for each in (rooms.bounds, rooms.edge, rooms.opening, rooms.occluder)])
    return floats, np.concatenate([*wholes, rooms.roofed.astype(np.int32), rooms.first_occluder])


@device_function(nogil=True)
def faces_of(floats: F64, wholes: I32) -> FaceTable:
    """A table of faces that was packed."""
    corners, faces = int(wholes[0]), int(wholes[1])
    position, place, normal = 3 * corners, 5 * corners, 8 * corners
    colour, plane = normal + 3 * faces, normal + 7 * faces
    return FaceTable(
        wholes[2 : 3 + faces],
        floats[:position].reshape(corners, 3),
        floats[position:place].reshape(corners, 2),
        floats[place:normal].reshape(corners, 3),
        floats[normal:colour].reshape(faces, 3),
        wholes[3 + faces : 3 + 2 * faces],
        floats[colour:plane].reshape(faces, 4),
    )


@device_function(nogil=True)
def rooms_of(floats: F64, wholes: I32) -> RoomTable:
    """A table of rooms that was packed."""
    rooms, edges, openings = int(wholes[0]), int(wholes[1]), int(wholes[2])
    bounds, edge, opening = 4 * rooms, 4 * rooms + 3 * edges, 4 * rooms + 3 * edges + 12 * openings
    first_edge, first_opening, into = 4 + rooms, 5 + 2 * rooms, 6 + 3 * rooms
    roofed = into + openings
    return RoomTable(
        wholes[3:first_edge],
        floats[:bounds].reshape(rooms, 4),
        wholes[first_edge:first_opening],
        floats[bounds:edge].reshape(edges, 3),
        wholes[first_opening:into],
        floats[edge:opening].reshape(openings, 4, 3),
        wholes[into:roofed],
        wholes[roofed : roofed + rooms],
        wholes[:0],
        floats[:0].reshape(0, OCCLUDER_SIZE),
    )


@device_function(nogil=True)
def occluders_of(floats: F64, wholes: I32) -> tuple[I32, F64]:
    """What darkens each face of the rooms, at the end of their faces and tables; see `RoomTable`."""
    size, count = wholes.shape[0], int(wholes[wholes.shape[0] - 1])
    occluders = floats[floats.shape[0] - OCCLUDER_SIZE * count :].reshape(count, OCCLUDER_SIZE)
    return wholes[size - int(wholes[1]) - 1 :] if count > 0 else wholes[:0], occluders


@kernel("UniTuple(int64, 2)(int64, int64, int64, int64, int64)", only=True, hold_gil=True)
def size_of(height: int, spans: int, faces: int, corners: int, rooms: int) -> tuple[int, int]:
    """How many float64 and int32 a picture is drawn in, with so many spans of a row and corners of a face at most."""
    rows = 4 * height
    floats = 21 * faces + 11 * corners + 21 + TILES * TILES + 4 + PLACEMENT_SIZE + 4 * (1 + VISITS_A_ROOM) * rooms
    wholes = 3 * (rows * spans + 3 * spans + 8) + rows + 2 * (rows + 8) + 3 * faces
    return floats, SPANS + wholes + (2 + VISITS_A_ROOM) * rooms


@device_function(nogil=True)
def drawn_in(view: F64, floats: F64, wholes: I32) -> tuple[DrawBuffers, int, int]:
    """Where faces are drawn, and where in each of the arrays there is more."""
    rows, spans = 4 * int(view[HEIGHT]), int(view[ROOM])
    faces, corners = int(view[ROOM + 1]), int(view[ROOM + 2])
    merged = SPANS + 3 * rows * spans
    counts = merged + 3 * (3 * spans + 8)
    left = counts + rows
    right = left + rows + 8
    kind = right + rows + 8
    run = kind + 2 * faces
    planes = 21 * faces
    cut = planes + 9 * corners
    screen = cut + 2 * corners
    tiles = screen + 21 + TILES * TILES
    drawn = DrawBuffers(
        wholes[SPANS:merged].reshape(rows, spans, 3),
        wholes[counts:left],
        wholes[merged:counts].reshape(3 * spans + 8, 3),
        floats[:planes].reshape(faces, 21),
        wholes[kind:run].reshape(faces, 2),
        wholes[run : run + faces],
        wholes[left:right],
        wholes[right:kind],
        floats[planes:cut].reshape(3, corners, 3),
        floats[cut:screen].reshape(corners, 2),
        floats[screen : screen + 9].reshape(3, 3),
        floats[screen + 9 : screen + 21].reshape(4, 3),
        floats[screen + 21 : tiles].reshape(TILES, TILES),
    )
    return drawn, tiles, run + faces


@device_function(nogil=True)
def sight_in(floats: F64, wholes: I32, rooms: int) -> Sight:
    """Where rooms in sight are listed, at the start of what is left."""
    most = VISITS_A_ROOM * rooms
    return Sight(
        wholes[:rooms],
        floats[: 4 * rooms].reshape(rooms, 4),
        wholes[rooms : 2 * rooms],
        wholes[2 * rooms : 2 * rooms + most],
        floats[4 * rooms : 4 * rooms + 4 * most].reshape(most, 4),
    )


@device_function(nogil=True, beyond=int64, all_beyond=int64)
def narrow(things: F64, thing: int, placement: F64, view: F64, window: F64) -> bool:
    """Narrow a window to where a thing's box is; False if that is nowhere in it.

    A box that reaches behind the camera may be anywhere in front of it.
    """
    x0 = y0 = 1e9
    x1 = y1 = -1e9
    all_beyond, before = 31, 0
    # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
    left, top, right, bottom = window[0] - 1.0, window[1] - 1.0, window[2] + 1.0, window[3] + 1.0
    for corner in range(8):
        x = things[thing, THING_BOX] * (1.0 - 2.0 * (corner & 1))
        y = things[thing, THING_BOX + 1 + (corner >> 1 & 1)]
        z = things[thing, THING_BOX + 3] * (1.0 - 2.0 * (corner >> 2))
        wx = placement[PLACE] + (placement[COS] * x + placement[SIN] * z) - view[EYE]
        wy = placement[PLACE + 1] + y - view[EYE + 1]
        wz = placement[PLACE + 2] + (placement[COS] * z - placement[SIN] * x) - view[EYE + 2]
        ahead = view[FORWARD] * wx + view[FORWARD + 1] * wy + view[FORWARD + 2] * wz
        across = view[FOCAL_X] * (view[RIGHT] * wx + view[RIGHT + 1] * wy + view[RIGHT + 2] * wz)
        down = -view[FOCAL_Y] * (view[UP] * wx + view[UP + 1] * wy + view[UP + 2] * wz)
        across, down = across + view[CENTRE_X] * ahead, down + view[CENTRE_Y] * ahead
        beyond = 1 if across < left * ahead else 0
        beyond += 2 if across > right * ahead else 0
        beyond += 4 if down < top * ahead else 0
        beyond += 8 if down > bottom * ahead else 0
        beyond += 16 if ahead < view[NEAR] else 0
        all_beyond &= beyond
        if ahead >= view[NEAR]:
            before += 1
            x0, x1 = min(x0, across / ahead), max(x1, across / ahead)
            y0, y1 = min(y0, down / ahead), max(y1, down / ahead)
    if all_beyond != 0:
        return False
    if before == 8:
        window[0], window[1] = max(window[0], np.floor(x0) - 1.0), max(window[1], np.floor(y0) - 1.0)
        window[2], window[3] = min(window[2], np.ceil(x1) + 1.0), min(window[3], np.ceil(y1) + 1.0)
    return bool(window[0] < window[2] and window[1] < window[3])


@device_function(nogil=True, wide=int64, high=int64, reached=int64)
def survey(drawn: DrawBuffers, view: F64, window: F64) -> None:
    """Write down for each tile how near at least what covers it is, of its samples in the window."""
    tiles, planes, spans = drawn.tiles, drawn.planes, drawn.spans
    tiles[:] = np.inf
    wide, high = tile_size(view)
    left, right = int(window[0]), int(window[2])
    for row in range(4 * int(window[1]), 4 * int(window[3])):
        y, shifted = (ROW_STEP * row + 32.0) / 256.0, SAMPLE_X[row & 3] / 256.0
        line = tiles[row // high]
        reached = left
        for k in range(drawn.counts[row]):
            begin, end = max(int64(spans[row, k, BEGIN]), left), min(int64(spans[row, k, END]), right)
            if begin >= end:
                continue
            for column in range(reached // wide, (begin - 1) // wide + 1 if reached < begin else reached // wide):
                line[column] = -np.inf
            plane = planes[spans[row, k, FACE]]
            here = plane[1] * y + plane[2]
            for column in range(begin // wide, (end - 1) // wide + 1):
                first, last = max(begin, column * wide) + shifted, min(end, (column + 1) * wide) - 1 + shifted
                line[column] = min(line[column], min(plane[0] * first + here, plane[0] * last + here))
            reached = end
        if reached < right:
            for column in range(reached // wide, (right - 1) // wide + 1):
                line[column] = -np.inf


MANY = 48  # faces of a thing: it is worth to see first whether they can be seen
SAMPLES = 5  # the column of places that is written to


@device_function(nogil=True, force_inline=True)
def window_of(
    x: float, z: float, reach: float, rooms: RoomTable, sight: Sight, seen: int, everything: bool, out: F64
) -> bool:
    """The windows of all rooms that a thing stands in or reaches into, as one; False if none of them is in sight."""
    if everything:
        for k in range(4):
            out[k] = sight.windows[0, k]
        return True
    out[0] = out[1] = 1e9
    out[2] = out[3] = -1e9
    for i in range(seen):
        room = sight.order[i]
        bounds = rooms.bounds[room]
        if bounds[0] - reach <= x <= bounds[2] + reach and bounds[1] - reach <= z <= bounds[3] + reach:
            window = sight.windows[room]
            out[0], out[1] = min(out[0], window[0]), min(out[1], window[1])
            out[2], out[3] = max(out[2], window[2]), max(out[3], window[3])
    return bool(out[0] < out[2] and out[1] < out[3])


@device_function(nogil=True, force_inline=True)
def outside(x: float, y: float, z: float, reach: float, view: F64, window: F64) -> bool:
    """Is all within ``reach`` of a place sure to be outside a window or behind the camera?"""
    x, y, z = x - view[EYE], y - view[EYE + 1], z - view[EYE + 2]
    ahead = view[FORWARD] * x + view[FORWARD + 1] * y + view[FORWARD + 2] * z
    if ahead < -reach:
        return True
    right = (view[RIGHT] * x + view[RIGHT + 1] * y + view[RIGHT + 2] * z) * view[FOCAL_X]
    down = -(view[UP] * x + view[UP + 1] * y + view[UP + 2] * z) * view[FOCAL_Y]
    for side in range(4):
        # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
        low = side < 2
        across, focal = (right, view[FOCAL_X]) if side & 1 == 0 else (down, view[FOCAL_Y])
        middle = view[CENTRE_X] if side & 1 == 0 else view[CENTRE_Y]
        edge = window[side] - middle + (-1.0 if low else 1.0)
        beyond = edge * ahead - across if low else across - edge * ahead
        if beyond > reach * np.sqrt(focal * focal + edge * edge):
            return True
    return False


@device_function(nogil=True, force_inline=True)
def place_thing(things: F64, thing: int, places: F64, placement: F64) -> None:
    """Write down where a thing is and how it lies."""
    for k in range(3):
        placement[PLACE + k] = places[thing, k]
        placement[SCALE + k] = things[thing, THING_SCALE + k]
        placement[TINT + k] = things[thing, THING_TINT + k]
    placement[COS], placement[SIN] = places[thing, 3], places[thing, 4]
    placement[NORMAL_SCALE] = things[thing, THING_NORMAL_SCALE]


@kernel(
    "(float64[::1], int32[::1], float64[::1], int32[::1], float64[:, ::1], float64[:, ::1], float64[::1], "
    "float64[::1], int32[::1])",
    nogil=True,
    number=int64,
)
def cover(
    room_floats: F64,
    room_wholes: I32,
    library_floats: F64,
    library_wholes: I32,
    things: F64,
    places: F64,
    view: F64,
    floats: F64,
    wholes: I32,
) -> bool:
    """Find out which face covers each sample, and how many samples each thing got, behind walls and earlier things.

    ``places`` rows are x, y, z, cos yaw, sin yaw and how many samples the thing got. False where a row has no room for
    its spans.
    """
    faces, library = faces_of(room_floats, room_wholes), faces_of(library_floats, library_wholes)
    float_count, whole_count = 8 * int(room_wholes[0]) + 7 * int(room_wholes[1]), 3 + 2 * int(room_wholes[1])
    rooms = rooms_of(room_floats[float_count:], room_wholes[whole_count:])
    drawn, float_count, whole_count = drawn_in(view, floats, wholes)
    window, placement = (
        floats[float_count : float_count + 4],
        floats[float_count + 4 : float_count + 4 + PLACEMENT_SIZE],
    )
    count, thing_count = rooms.bounds.shape[0], places.shape[0]
    sight = sight_in(floats[float_count + 4 + PLACEMENT_SIZE :], wholes[whole_count:], count)
    light = view[LIGHT:SKY]
    top, bottom = int(view[TOP]), int(view[BOTTOM])
    drawn.counts[4 * top : 4 * bottom] = 0
    places[:, SAMPLES] = 0.0
    window[0], window[1], window[2], window[3] = 0.0, 0.0, view[WIDTH], view[HEIGHT]
    seen, everything = visit(rooms, view, drawn.corners, window, sight)
    placement[:] = 0.0
    placement[COS] = 1.0
    placement[SCALE:OWN_EYE] = 1.0
    number = 0
    for i in range(seen + thing_count):
        table, thing, many = faces, i - seen, False
        if thing < 0:
            room = sight.order[i]
            first, last = int64(rooms.first_face[room]), int64(rooms.first_face[room + 1])
            for k in range(4):
                window[k] = sight.windows[room, k]
        else:
            table = library
            first, last = int64(things[thing, FIRST]), int64(things[thing, LAST])
            x, y, z = places[thing, 0], places[thing, 1], places[thing, 2]
            if not np.isfinite(x):
                continue
            if not window_of(x, z, things[thing, AROUND], rooms, sight, seen, everything, window):
                continue
            if view[PARALLEL] == 0.0 and outside(x, y, z, things[thing, REACH], view, window):
                continue
            place_thing(things, thing, places, placement)
            many = view[PARALLEL] == 0.0 and last - first > MANY
            if many and not narrow(things, thing, placement, view, window):
                continue
        window[1], window[3] = max(window[1], top), min(window[3], bottom)
        if thing >= 0 or i == 0:
            turn_to(view, light, placement)
        if many:
            survey(drawn, view, window)
        for face in range(first, last):
            samples = draw_face(table, face, view, placement, light, window, drawn, number, many)
            if samples > 0:
                if thing >= 0:
                    places[thing, SAMPLES] += samples
                else:
                    drawn.kind[number, 1] += 2 * (face + 1)
                number += 1
            elif samples < 0:
                return False
    return True


@kernel("(float64[::1], float64[::1], int32[::1], float32[:, ::1])", nogil=True)
def distances(view: F64, floats: F64, wholes: I32, out: NDArray[np.float32]) -> None:
    """How far along the view each pixel's first sample is, metres; the far plane where there is nothing."""
    drawn, _, _ = drawn_in(view, floats, wholes)
    for y in range(out.shape[0]):
        row = 4 * y + 3  # the first sample in OpenGL's order, whose pictures are upside down
        py = (64.0 * row + 32.0) / 256.0
        out[y, :] = view[FAR]
        for k in range(drawn.counts[row]):
            span = drawn.spans[row, k]
            plane = drawn.planes[span[FACE]]
            for x in range(span[BEGIN], span[END]):
                near = plane[0] * (x + SAMPLE_X[3] / 256.0) + plane[1] * py + plane[2]
                out[y, x] = min(1.0 / max(near, 1e-9), view[FAR])
