"""Which face covers each sample: rooms in sight, then the things in them; and how far away that is."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.project import (
    CENTRE_X,
    CENTRE_Y,
    COS,
    EYE,
    FAR,
    FOCAL_X,
    FOCAL_Y,
    FORWARD,
    NORMAL_SCALE,
    OWN_EYE,
    PARALLEL,
    PLACE,
    PLACEMENT_SIZE,
    RIGHT,
    SCALE,
    SIN,
    TINT,
    UP,
    draw_face,
    turn_to,
)
from minihuman.worlds.first_person.render.raster import SAMPLE_X
from minihuman.worlds.first_person.render.tables import F64, I64, Drawn, Faces, Rooms, Things
from minihuman.worlds.first_person.render.visit import VISITS_A_ROOM, Sight, visit
from minihuman.worlds.kernels import int64, kernel, part


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
def place_thing(things: Things, thing: int, places: F64, placement: F64) -> None:
    """Write down where a thing is and how it lies."""
    for k in range(3):
        placement[PLACE + k] = places[thing, k]
        placement[SCALE + k] = things.scale[thing, k]
        placement[TINT + k] = things.tint[thing, k]
    placement[COS], placement[SIN] = places[thing, 3], places[thing, 4]
    placement[NORMAL_SCALE] = things.normal_scale[thing]


@kernel(lean=True, number=int64)
def cover(
    faces: Faces,
    rooms: Rooms,
    library: Faces,
    things: Things,
    places: F64,
    view: F64,
    light: F64,
    drawn: Drawn,
    claimed: I64,
    sight: Sight,
    window: F64,
    placement: F64,
) -> None:
    """What ``draw`` does, in arrays that it has made."""
    drawn.owner[:] = -1
    claimed[:] = 0
    window[0] = window[1] = 0.0
    window[2], window[3] = drawn.owner.shape[1], drawn.owner.shape[0] // 4
    seen, everything = visit(rooms, view, drawn.corners, window, sight)
    placement[:] = 0.0
    placement[COS] = 1.0
    placement[SCALE:OWN_EYE] = 1.0
    number = 0
    for i in range(seen + places.shape[0]):
        table, thing = faces, i - seen
        if thing < 0:
            room = sight.order[i]
            first, last = rooms.first_face[room], rooms.first_face[room + 1]
            for k in range(4):
                window[k] = sight.windows[room, k]
        else:
            table = library
            first, last = things.faces[thing, 0], things.faces[thing, 1]
            x, y, z = places[thing, 0], places[thing, 1], places[thing, 2]
            if not np.isfinite(x):
                continue
            if not window_of(x, z, things.reach[thing, 0], rooms, sight, seen, everything, window):
                continue
            if view[PARALLEL] == 0.0 and outside(x, y, z, things.reach[thing, 1], view, window):
                continue
            place_thing(things, thing, places, placement)
        if thing >= 0 or i == 0:
            turn_to(view, light, placement)
        for face in range(first, last):
            samples = draw_face(table, face, view, placement, light, window, drawn, number)
            if samples > 0:
                number += 1
                if thing >= 0:
                    claimed[thing] += samples


def draw(
    faces: Faces,
    rooms: Rooms,
    library: Faces,
    things: Things,
    places: F64,
    view: F64,
    light: F64,
    drawn: Drawn,
    claimed: I64,
) -> None:
    """Find out which face covers each sample, and how many samples each thing got.

    ``places`` rows are x, y, z, cos yaw, sin yaw. ``claimed`` takes how many samples each thing got when it was drawn,
    behind walls and the things before it.
    """
    count = rooms.first_face.shape[0] - 1
    most = VISITS_A_ROOM * count
    sight = Sight(
        np.empty(count, np.int32),
        np.empty((count, 4)),
        np.empty(count, np.int32),
        np.empty(most, np.int32),
        np.empty((most, 4)),
    )
    window, placement = np.empty(4), np.empty(PLACEMENT_SIZE)
    cover(faces, rooms, library, things, places, view, light, drawn, claimed, sight, window, placement)


@kernel(lean=True)
def distances(drawn: Drawn, view: F64, out: NDArray[np.float32]) -> None:
    """How far along the view each pixel's first sample is, metres; the far plane where there is nothing."""
    for y in range(out.shape[0]):
        row = 4 * y + 3  # the first sample in OpenGL's order, whose pictures are upside down
        py = (64.0 * row + 32.0) / 256.0
        for x in range(out.shape[1]):
            face = drawn.owner[row, x]
            far = view[FAR]
            if face >= 0:
                plane = drawn.planes[face]
                near = plane[0] * (x + SAMPLE_X[3] / 256.0) + plane[1] * py + plane[2]
                far = min(1.0 / max(near, 1e-9), far)
            out[y, x] = far
