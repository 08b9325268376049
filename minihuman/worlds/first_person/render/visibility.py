"""Visibility: the rooms and entities in sight, what hides what, the face that covers each sample, and its distance.

Rooms are visited from the camera's room through openings. What is certainly hidden is left out, according to the least
nearness of the picture so far in each tile.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.draw_buffers import (
    VISITS_A_ROOM,
    Sight,
    drawn_in,
    faces_of,
    rooms_of,
    sight_in,
)
from minihuman.worlds.first_person.render.kernel_tables import (
    AROUND,
    BEGIN,
    END,
    F64,
    FACE,
    FIRST,
    I32,
    LAST,
    REACH,
    THING_BOX,
    THING_NORMAL_SCALE,
    THING_SCALE,
    THING_TINT,
    DrawBuffers,
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
    SCALE,
    SIN,
    SKY,
    TINT,
    TOP,
    UP,
    WIDTH,
    cut,
    draw_face,
    tile_size,
    turn_to,
)
from minihuman.worlds.first_person.render.spans import ROW_STEP, SAMPLE_X
from minihuman.worlds.kernels import device_function, int64, kernel

DOORSTEP_M = 0.06  # a camera this close to an opening sees through it in the whole window


@device_function(nogil=True, force_inline=True)
def contains(rooms: RoomTable, room: int, x: float, z: float) -> bool:
    """Return whether the point (x, z) is inside a room, or within a millionth of a metre of it."""
    for e in range(rooms.first_edge[room], rooms.first_edge[room + 1]):
        if rooms.edge[e, 0] * x + rooms.edge[e, 1] * z + rooms.edge[e, 2] < -1e-6:
            return False
    return True


@device_function(nogil=True, force_inline=True, count=int64, source=int64)
def through(rooms: RoomTable, opening: int, view: F64, corners: F64, window: F64, result: F64) -> bool:
    """Write to ``result`` the part of a window (x0, y0, x1, y1) in which an opening is seen; return False if none."""
    hole = rooms.opening[opening]
    ax = hole[1, 0] - hole[0, 0]
    ay = hole[1, 1] - hole[0, 1]
    az = hole[1, 2] - hole[0, 2]
    bx = hole[3, 0] - hole[0, 0]
    by = hole[3, 1] - hole[0, 1]
    bz = hole[3, 2] - hole[0, 2]
    nx = ay * bz - az * by
    ny = az * bx - ax * bz
    nz = ax * by - ay * bx
    away = nx * (view[EYE] - hole[0, 0]) + ny * (view[EYE + 1] - hole[0, 1]) + nz * (view[EYE + 2] - hole[0, 2])
    away /= np.sqrt(nx * nx + ny * ny + nz * nz)
    if away < -DOORSTEP_M:
        return False
    if away < DOORSTEP_M:
        result[0], result[1], result[2], result[3] = window[0], window[1], window[2], window[3]
        return True
    for i in range(4):
        wx = hole[i, 0] - view[EYE]
        wy = hole[i, 1] - view[EYE + 1]
        wz = hole[i, 2] - view[EYE + 2]
        corners[0, i, 0] = view[RIGHT] * wx + view[RIGHT + 1] * wy + view[RIGHT + 2] * wz
        corners[0, i, 1] = view[UP] * wx + view[UP + 1] * wy + view[UP + 2] * wz
        corners[0, i, 2] = view[FORWARD] * wx + view[FORWARD + 1] * wy + view[FORWARD + 2] * wz
    count = 4
    source = 0
    count = cut(corners, source, count, 0.0, 0.0, 1.0, -1e-6)
    if count < 3:
        return False
    x0 = y0 = 1e9
    x1 = y1 = -1e9
    for i in range(count):
        z = corners[1, i, 2]
        x = view[CENTRE_X] + view[FOCAL_X] * corners[1, i, 0] / z
        y = view[CENTRE_Y] - view[FOCAL_Y] * corners[1, i, 1] / z
        x0 = min(x0, x)
        x1 = max(x1, x)
        y0 = min(y0, y)
        y1 = max(y1, y)
    # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
    result[0] = max(window[0], np.floor(x0) - 1.0)
    result[1] = max(window[1], np.floor(y0) - 1.0)
    result[2] = min(window[2], np.ceil(x1) + 1.0)
    result[3] = min(window[3], np.ceil(y1) + 1.0)
    return bool(result[0] < result[2] and result[1] < result[3])


@device_function(nogil=True, force_inline=True)
def visit(rooms: RoomTable, view: F64, corners: F64, picture: F64, sight: Sight) -> tuple[int, bool]:
    """List the rooms to draw, nearest first, and the window of each.

    ``picture`` is the window of the whole picture. A window can be larger than needed, but never smaller. From above,
    from outside every room, and if a room without a roof is in sight, all rooms are listed.

    Returns the number of listed rooms, and whether all rooms are listed.
    """
    order = sight.order
    windows = sight.windows
    visits = sight.visits
    pending = sight.pending
    count = order.shape[0]
    listed = 0
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
    head = 0
    while head < waiting and not everything:
        room = pending[head]
        window = sight.pending_windows[head]
        head += 1
        everything = not rooms.roofed[room]
        known = windows[room]
        if known[0] > known[2]:
            order[listed] = room
            listed += 1
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
        listed = count
    return listed, everything


@device_function(nogil=True, beyond=int64, all_beyond=int64)
def narrow(things: F64, thing: int, placement: F64, view: F64, window: F64) -> bool:
    """Narrow a window to the bounding box of an entity; return False if the box is outside the window.

    A box that extends behind the camera can appear anywhere in front of it.
    """
    x0 = y0 = 1e9
    x1 = y1 = -1e9
    all_beyond = 31  # the bits of ``beyond`` that all corners have
    before = 0
    # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
    left = window[0] - 1.0
    top = window[1] - 1.0
    right = window[2] + 1.0
    bottom = window[3] + 1.0
    for corner in range(8):  # its bits choose the side along x, y and z
        x = things[thing, THING_BOX] * (1.0 - 2.0 * (corner & 1))
        y = things[thing, THING_BOX + 1 + (corner >> 1 & 1)]
        z = things[thing, THING_BOX + 3] * (1.0 - 2.0 * (corner >> 2))
        wx = placement[PLACE] + (placement[COS] * x + placement[SIN] * z) - view[EYE]
        wy = placement[PLACE + 1] + y - view[EYE + 1]
        wz = placement[PLACE + 2] + (placement[COS] * z - placement[SIN] * x) - view[EYE + 2]
        ahead = view[FORWARD] * wx + view[FORWARD + 1] * wy + view[FORWARD + 2] * wz
        across = view[FOCAL_X] * (view[RIGHT] * wx + view[RIGHT + 1] * wy + view[RIGHT + 2] * wz)
        down = -view[FOCAL_Y] * (view[UP] * wx + view[UP + 1] * wy + view[UP + 2] * wz)
        across = across + view[CENTRE_X] * ahead
        down = down + view[CENTRE_Y] * ahead
        beyond = 1 if across < left * ahead else 0  # a bit for each limit that the corner is beyond
        beyond += 2 if across > right * ahead else 0
        beyond += 4 if down < top * ahead else 0
        beyond += 8 if down > bottom * ahead else 0
        beyond += 16 if ahead < view[NEAR] else 0
        all_beyond &= beyond
        if ahead >= view[NEAR]:
            before += 1
            x0 = min(x0, across / ahead)
            x1 = max(x1, across / ahead)
            y0 = min(y0, down / ahead)
            y1 = max(y1, down / ahead)
    if all_beyond != 0:
        return False
    if before == 8:
        window[0], window[1] = max(window[0], np.floor(x0) - 1.0), max(window[1], np.floor(y0) - 1.0)
        window[2], window[3] = min(window[2], np.ceil(x1) + 1.0), min(window[3], np.ceil(y1) + 1.0)
    return bool(window[0] < window[2] and window[1] < window[3])


@device_function(nogil=True, wide=int64, high=int64, reached=int64)
def survey(buffers: DrawBuffers, view: F64, window: F64) -> None:
    """Write for each tile the least nearness of the faces at its samples in the window; -inf where there is sky."""
    tiles = buffers.tiles
    planes = buffers.planes
    spans = buffers.spans
    tiles[:] = np.inf
    wide, high = tile_size(view)
    left = int(window[0])
    right = int(window[2])
    for row in range(4 * int(window[1]), 4 * int(window[3])):
        y = (ROW_STEP * row + 32.0) / 256.0
        shifted = SAMPLE_X[row & 3] / 256.0
        line = tiles[row // high]
        reached = left
        for k in range(buffers.counts[row]):
            begin = max(int64(spans[row, k, BEGIN]), left)
            end = min(int64(spans[row, k, END]), right)
            if begin >= end:
                continue
            for column in range(reached // wide, (begin - 1) // wide + 1 if reached < begin else reached // wide):
                line[column] = -np.inf
            plane = planes[spans[row, k, FACE]]
            intercept = plane[1] * y + plane[2]
            for column in range(begin // wide, (end - 1) // wide + 1):
                first = max(begin, column * wide) + shifted
                last = min(end, (column + 1) * wide) - 1 + shifted
                line[column] = min(line[column], min(plane[0] * first + intercept, plane[0] * last + intercept))
            reached = end
        if reached < right:
            for column in range(reached // wide, (right - 1) // wide + 1):
                line[column] = -np.inf


MANY = 48  # a thing with more faces is first tested as a whole, and its faces against the picture so far
SAMPLES = 5  # the column of ``places`` to which `cover` writes the number of an entity's samples


@device_function(nogil=True, force_inline=True)
def window_of(
    x: float, z: float, reach: float, rooms: RoomTable, sight: Sight, listed: int, everything: bool, out: F64
) -> bool:
    """Write to ``out`` the joint window of the rooms within ``reach`` of (x, z); return False if none is in sight."""
    if everything:
        for k in range(4):
            out[k] = sight.windows[0, k]
        return True
    out[0] = out[1] = 1e9
    out[2] = out[3] = -1e9
    for i in range(listed):
        room = sight.order[i]
        bounds = rooms.bounds[room]
        if bounds[0] - reach <= x <= bounds[2] + reach and bounds[1] - reach <= z <= bounds[3] + reach:
            window = sight.windows[room]
            out[0], out[1] = min(out[0], window[0]), min(out[1], window[1])
            out[2], out[3] = max(out[2], window[2]), max(out[3], window[3])
    return bool(out[0] < out[2] and out[1] < out[3])


@device_function(nogil=True, force_inline=True)
def outside(x: float, y: float, z: float, reach: float, view: F64, window: F64) -> bool:
    """Return whether everything within ``reach`` of a place is certainly outside a window or behind the camera."""
    x = x - view[EYE]
    y = y - view[EYE + 1]
    z = z - view[EYE + 2]
    ahead = view[FORWARD] * x + view[FORWARD + 1] * y + view[FORWARD + 2] * z
    if ahead < -reach:
        return True
    right = (view[RIGHT] * x + view[RIGHT + 1] * y + view[RIGHT + 2] * z) * view[FOCAL_X]
    down = -(view[UP] * x + view[UP + 1] * y + view[UP + 2] * z) * view[FOCAL_Y]
    for side in range(4):  # left, top, right, bottom
        # a pixel more on each side, for corners are moved by up to 1/512 pixel when they are drawn
        low = side < 2
        across, focal = (right, view[FOCAL_X]) if side & 1 == 0 else (down, view[FOCAL_Y])
        if side & 1 == 0:
            middle = view[CENTRE_X]
        else:
            middle = view[CENTRE_Y]
        edge = window[side] - middle + (-1.0 if low else 1.0)
        if low:
            beyond = edge * ahead - across
        else:
            beyond = across - edge * ahead
        if beyond > reach * np.sqrt(focal * focal + edge * edge):
            return True
    return False


@device_function(nogil=True, force_inline=True)
def place_thing(things: F64, thing: int, places: F64, placement: F64) -> None:
    """Write an entity's position, orientation, scale and tint into ``placement``."""
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
    """Compute which face covers each sample, and how many samples each entity got behind walls and earlier ones.

    The rows of ``places`` are x, y, z, cos yaw, sin yaw and the number of the entity's samples. The result is False if
    a row has no room for its spans.
    """
    faces = faces_of(room_floats, room_wholes)
    library = faces_of(library_floats, library_wholes)
    float_count = 8 * int(room_wholes[0]) + 7 * int(room_wholes[1])  # of the rooms' faces, which come before the rooms
    whole_count = 3 + 2 * int(room_wholes[1])
    rooms = rooms_of(room_floats[float_count:], room_wholes[whole_count:])
    buffers, float_count, whole_count = drawn_in(view, floats, wholes)
    window = floats[float_count : float_count + 4]
    placement = floats[float_count + 4 : float_count + 4 + PLACEMENT_SIZE]
    count = rooms.bounds.shape[0]
    thing_count = places.shape[0]
    sight = sight_in(floats[float_count + 4 + PLACEMENT_SIZE :], wholes[whole_count:], count)
    light = view[LIGHT:SKY]
    top = int(view[TOP])
    bottom = int(view[BOTTOM])
    buffers.counts[4 * top : 4 * bottom] = 0
    places[:, SAMPLES] = 0.0
    window[0], window[1], window[2], window[3] = 0.0, 0.0, view[WIDTH], view[HEIGHT]
    listed, everything = visit(rooms, view, buffers.corners, window, sight)
    placement[:] = 0.0
    placement[COS] = 1.0
    placement[SCALE:OWN_EYE] = 1.0
    number = 0
    for i in range(listed + thing_count):
        table = faces
        thing = i - listed
        many = False
        if thing < 0:
            room = sight.order[i]
            first = int64(rooms.first_face[room])
            last = int64(rooms.first_face[room + 1])
            for k in range(4):
                window[k] = sight.windows[room, k]
        else:
            table = library
            first = int64(things[thing, FIRST])
            last = int64(things[thing, LAST])
            x = places[thing, 0]
            y = places[thing, 1]
            z = places[thing, 2]
            if not np.isfinite(x):
                continue
            if not window_of(x, z, things[thing, AROUND], rooms, sight, listed, everything, window):
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
            survey(buffers, view, window)
        for face in range(first, last):
            samples = draw_face(table, face, view, placement, light, window, buffers, number, many)
            if samples > 0:
                if thing >= 0:
                    places[thing, SAMPLES] += samples
                else:
                    buffers.kind[number, 1] += 2 * (face + 1)
                number += 1
            elif samples < 0:
                return False
    return True


@kernel("(float64[::1], float64[::1], int32[::1], float32[:, ::1])", nogil=True)
def distances(view: F64, floats: F64, wholes: I32, out: NDArray[np.float32]) -> None:
    """Write the depth of each pixel's first sample along the view in metres; the far plane where there is nothing."""
    buffers, _, _ = drawn_in(view, floats, wholes)
    for y in range(out.shape[0]):
        row = 4 * y + 3  # the first sample in OpenGL's order, whose pictures are upside down
        py = (64.0 * row + 32.0) / 256.0
        out[y, :] = view[FAR]
        for k in range(buffers.counts[row]):
            span = buffers.spans[row, k]
            plane = buffers.planes[span[FACE]]
            for x in range(span[BEGIN], span[END]):
                near = plane[0] * (x + SAMPLE_X[3] / 256.0) + plane[1] * py + plane[2]
                out[y, x] = min(1.0 / max(near, 1e-9), view[FAR])
