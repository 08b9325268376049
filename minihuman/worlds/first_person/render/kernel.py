"""Which face covers each sample: rooms in sight, then the things in them; and how far away that is."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.behind import narrow, survey
from minihuman.worlds.first_person.render.memory import drawn_in, faces_of, rooms_of, sight_in
from minihuman.worlds.first_person.render.project import (
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
    draw_face,
    turn_to,
)
from minihuman.worlds.first_person.render.raster import SAMPLE_X
from minihuman.worlds.first_person.render.tables import (
    AROUND,
    BEGIN,
    END,
    F64,
    FACE,
    FIRST,
    I32,
    LAST,
    REACH,
    THING_NORMAL_SCALE,
    THING_SCALE,
    THING_TINT,
    Rooms,
)
from minihuman.worlds.first_person.render.visit import Sight, visit
from minihuman.worlds.kernels import int64, kernel, part

MANY = 48  # faces of a thing: it is worth to see first whether they can be seen
SAMPLES = 5  # the column of places that is written to


@part(lean=True, into_caller=True)
def window_of(
    x: float,
    z: float,
    reach: float,
    rooms: Rooms,
    sight: Sight,
    seen: int,
    everything: bool,
    out: F64,
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


@part(lean=True, into_caller=True)
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


@part(lean=True, into_caller=True)
def place_thing(things: F64, thing: int, places: F64, placement: F64) -> None:
    """Write down where a thing is and how it lies."""
    for k in range(3):
        placement[PLACE + k] = places[thing, k]
        placement[SCALE + k] = things[thing, THING_SCALE + k]
        placement[TINT + k] = things[thing, THING_TINT + k]
    placement[COS], placement[SIN] = places[thing, 3], places[thing, 4]
    placement[NORMAL_SCALE] = things[thing, THING_NORMAL_SCALE]


@kernel(lean=True, number=int64)
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
    window[0], window[1] = 0.0, 0.0
    window[2], window[3] = view[WIDTH], view[HEIGHT]
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
                number += 1
                if thing >= 0:
                    places[thing, SAMPLES] += samples
            elif samples < 0:
                return False
    return True


@kernel(lean=True)
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
