"""Which rooms can be seen, and in which part of the picture: from the camera's room through opening after opening."""

from typing import NamedTuple

import numpy as np

from minihuman.worlds.first_person.render.project import (
    CENTRE_X,
    CENTRE_Y,
    EYE,
    FOCAL_X,
    FOCAL_Y,
    FORWARD,
    PARALLEL,
    RIGHT,
    UP,
    cut,
)
from minihuman.worlds.first_person.render.tables import F64, I32, Rooms
from minihuman.worlds.kernels import int64, part

DOORSTEP_M = 0.06  # a camera this close to an opening may see through all of it
VISITS_A_ROOM = 16


class Sight(NamedTuple):
    """Which rooms are in sight, and through which part of the picture: x0, y0, x1, y1 in whole pixels."""

    order: I32  # (rooms,) nearest first
    windows: F64  # (rooms, 4)
    visits: I32  # (rooms,)
    pending: I32  # (VISITS_A_ROOM * rooms,) rooms to visit
    pending_windows: F64  # (VISITS_A_ROOM * rooms, 4) by which each is visited


@part(lean=True, into_caller=True)
def contains(rooms: Rooms, room: int, x: float, z: float) -> bool:
    """Is the place inside the room or within a millionth of a metre of it?"""
    for e in range(rooms.first_edge[room], rooms.first_edge[room + 1]):
        if rooms.edge[e, 0] * x + rooms.edge[e, 1] * z + rooms.edge[e, 2] < -1e-6:
            return False
    return True


@part(lean=True, into_caller=True, count=int64, whole=int64)
def through(rooms: Rooms, opening: int, view: F64, corners: F64, window: F64, result: F64) -> bool:
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
        for side in range(4):
            result[side] = window[side]
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


@part(lean=True, into_caller=True)
def visit(rooms: Rooms, view: F64, corners: F64, picture: F64, sight: Sight) -> tuple[int, bool]:
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
        room = pending[done]
        window = sight.pending_windows[done]
        done += 1
        everything = not rooms.roofed[room]
        known = windows[room]
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
                for side in range(4):
                    beyond[side] = picture[side]
            waiting += 1
    if everything:
        for room in range(count):
            for side in range(4):
                windows[room, side] = picture[side]
            order[room] = room
        seen = count
    return seen, everything
