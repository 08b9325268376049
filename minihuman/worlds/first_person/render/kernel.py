"""Which face covers each sample: rooms in sight, then the things in them; and how far away that is."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.project import (
    COS,
    EYE,
    FAR,
    FORWARD,
    NORMAL_SCALE,
    PARALLEL,
    PLACE,
    PLACEMENT_SIZE,
    SCALE,
    SIN,
    TINT,
    draw_face,
)
from minihuman.worlds.first_person.render.raster import SAMPLE_X
from minihuman.worlds.first_person.render.tables import F64, I32, I64, Drawn, Faces, Rooms, Things
from minihuman.worlds.first_person.render.visit import visit


@njit(cache=True, nogil=True, error_model="numpy")
def draw_rooms(
    faces: Faces, rooms: Rooms, view: F64, light: F64, windows: F64, order: I32, drawn: Drawn
) -> tuple[int, int, bool]:
    """Draw every room in sight; how many face numbers are taken, and what ``visit`` says."""
    here = np.zeros(PLACEMENT_SIZE)
    here[COS] = 1.0
    here[SCALE:] = 1.0
    picture = np.array([0.0, 0.0, float(drawn.owner.shape[1]), float(drawn.owner.shape[0] // 4)])
    seen, everything = visit(rooms, view, drawn.corners, picture, windows, order)
    number = 0
    for i in range(seen):
        room = order[i]
        for face in range(rooms.first_face[room], rooms.first_face[room + 1]):
            if draw_face(faces, face, view, here, light, windows[room], drawn, number) > 0:
                number += 1
    return number, seen, everything


@njit(cache=True, nogil=True, error_model="numpy")
def window_of(
    x: float,
    z: float,
    reach: float,
    rooms: Rooms,
    windows: F64,
    order: I32,
    seen: int,
    everything: bool,
    out: F64,
) -> bool:
    """The windows of all rooms that a thing stands in or reaches into, as one; False if none of them is in sight."""
    if everything:
        out[:] = windows[order[0]]
        return True
    out[0] = out[1] = 1e9
    out[2] = out[3] = -1e9
    for i in range(seen):
        room = order[i]
        bounds = rooms.bounds[room]
        if bounds[0] - reach <= x <= bounds[2] + reach and bounds[1] - reach <= z <= bounds[3] + reach:
            window = windows[room]
            out[0], out[1] = min(out[0], window[0]), min(out[1], window[1])
            out[2], out[3] = max(out[2], window[2]), max(out[3], window[3])
    return bool(out[0] < out[2] and out[1] < out[3])


@njit(cache=True, nogil=True, error_model="numpy")
def draw_things(
    library: Faces,
    things: Things,
    places: F64,
    rooms: Rooms,
    view: F64,
    light: F64,
    windows: F64,
    order: I32,
    seen: int,
    everything: bool,
    drawn: Drawn,
    number: int,
    claimed: I64,
) -> None:
    """Draw every thing that may be in sight; ``places`` rows are x, y, z, cos yaw, sin yaw.

    ``claimed`` takes how many samples each got when it was drawn, behind walls and the things before it.
    """
    placement = np.empty(PLACEMENT_SIZE)
    window = np.empty(4)
    for thing in range(places.shape[0]):
        x, y, z = places[thing, 0], places[thing, 1], places[thing, 2]
        if not np.isfinite(x):
            continue
        ahead = (
            view[FORWARD] * (x - view[EYE])
            + view[FORWARD + 1] * (y - view[EYE + 1])
            + view[FORWARD + 2] * (z - view[EYE + 2])
        )
        if view[PARALLEL] == 0.0 and ahead < -things.reach[thing, 1]:
            continue
        if not window_of(x, z, things.reach[thing, 0], rooms, windows, order, seen, everything, window):
            continue
        placement[PLACE : PLACE + 3] = places[thing, :3]
        placement[COS] = places[thing, 3]
        placement[SIN] = places[thing, 4]
        placement[SCALE : SCALE + 3] = things.scale[thing]
        placement[NORMAL_SCALE] = things.normal_scale[thing]
        placement[TINT : TINT + 3] = things.tint[thing]
        for face in range(things.faces[thing, 0], things.faces[thing, 1]):
            samples = draw_face(library, face, view, placement, light, window, drawn, number)
            if samples > 0:
                number += 1
                claimed[thing] += samples


@njit(cache=True, nogil=True, error_model="numpy")
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
    """Find out which face covers each sample, and how many samples each thing got."""
    drawn.owner[:] = -1
    claimed[:] = 0
    count = rooms.first_face.shape[0] - 1
    windows = np.empty((count, 4))
    order = np.empty(count, np.int32)
    number, seen, everything = draw_rooms(faces, rooms, view, light, windows, order, drawn)
    draw_things(library, things, places, rooms, view, light, windows, order, seen, everything, drawn, number, claimed)


@njit(cache=True, nogil=True, error_model="numpy")
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
