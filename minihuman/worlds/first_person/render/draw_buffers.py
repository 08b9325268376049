"""The buffers in which a picture is drawn, and the tables of its faces and rooms, packed into two long arrays.

A kernel takes few arrays, so these functions cut its tables and buffers out of one array of float64 and one of int32.
"""

from typing import NamedTuple

import numpy as np

from minihuman.worlds.first_person.render.kernel_tables import (
    F64,
    I32,
    OCCLUDER_SIZE,
    DrawBuffers,
    FaceTable,
    RoomTable,
)
from minihuman.worlds.first_person.render.rasterisation import HEIGHT, PLACEMENT_SIZE, ROOM, TILES
from minihuman.worlds.first_person.render.texture import LANES, MOST_TAPS, SCANLINE_BUFFER, TAP
from minihuman.worlds.kernels import device_function, kernel

VISITS_A_ROOM = 16  # the most windows through which a room is visited


class Sight(NamedTuple):
    """The rooms in sight, and the window of the picture through which each is seen: x0, y0, x1, y1 in whole pixels."""

    order: I32  # (rooms,) nearest first
    windows: F64  # (rooms, 4) by room
    visits: I32  # (rooms,) the number of visits of each room
    pending: I32  # (VISITS_A_ROOM * rooms,) rooms to visit
    pending_windows: F64  # (VISITS_A_ROOM * rooms, 4) the windows through which they are visited


# Where each part of the whole numbers begins, after the colours that are looked up along a row: the texture sizes of
# the lookups, their light, texel positions and numbers of taps; the row's fragment groups; a row of the picture; spans.
SIZES = SCANLINE_BUFFER + LANES
LIGHTS = SIZES + 5 * LANES
PLACES = LIGHTS + 2 * LANES
TAPS = PLACES + TAP * MOST_TAPS
FRAGMENT_GROUPS = TAPS + SCANLINE_BUFFER // LANES
MAX_FRAGMENT_GROUPS = 264
LINE = FRAGMENT_GROUPS + 5 * (2 * MAX_FRAGMENT_GROUPS + 4)
SPANS = LINE + 4096 + 2 * LANES


def packed_faces(faces: FaceTable) -> tuple[F64, I32]:
    """Return a table of faces packed into two arrays, which `faces_of` unpacks."""
    start, position, place, normal, colour, texture, plane = faces
    floats = [position, place, normal, colour, plane]
    sizes = np.array([len(position), len(texture)], np.int32)
    return np.concatenate([table.ravel() for table in floats]), np.concatenate([sizes, start, texture])


def packed_rooms(rooms: RoomTable) -> tuple[F64, I32]:
    """Return a table of rooms packed into two arrays, which `rooms_of` unpacks."""
    sizes = np.array([len(rooms.bounds), len(rooms.edge), len(rooms.opening)], np.int32)
    wholes = [sizes, rooms.first_face, rooms.first_edge, rooms.first_opening, rooms.opening_into]
    floats = np.concatenate([table.ravel() for table in (rooms.bounds, rooms.edge, rooms.opening, rooms.occluder)])
    return floats, np.concatenate([*wholes, rooms.roofed.astype(np.int32), rooms.first_occluder])


@device_function(nogil=True)
def faces_of(floats: F64, wholes: I32) -> FaceTable:
    """Return the table of faces in two packed arrays."""
    corners = int(wholes[0])
    faces = int(wholes[1])
    position = 3 * corners
    place = 5 * corners
    normal = 8 * corners
    colour = normal + 3 * faces
    plane = normal + 7 * faces
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
    """Return the table of rooms in two packed arrays, without the occluders, which `occluders_of` returns."""
    rooms = int(wholes[0])
    edges = int(wholes[1])
    openings = int(wholes[2])
    bounds = 4 * rooms
    edge = 4 * rooms + 3 * edges
    opening = 4 * rooms + 3 * edges + 12 * openings
    first_edge = 4 + rooms
    first_opening = 5 + 2 * rooms
    into = 6 + 3 * rooms
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
    """Return ``first_occluder`` and ``occluder`` of a `RoomTable`, which end the arrays; empty if there are none.

    ``floats`` and ``wholes`` are the packed faces of the rooms, followed by the packed rooms.
    """
    size = wholes.shape[0]
    count = int(wholes[wholes.shape[0] - 1])
    occluders = floats[floats.shape[0] - OCCLUDER_SIZE * count :].reshape(count, OCCLUDER_SIZE)
    return wholes[size - int(wholes[1]) - 1 :] if count > 0 else wholes[:0], occluders


@kernel("UniTuple(int64, 2)(int64, int64, int64, int64, int64)", only=True, hold_gil=True)
def size_of(height: int, spans: int, faces: int, corners: int, rooms: int) -> tuple[int, int]:
    """Return how many numbers of float64 and int32 a picture needs for its `DrawBuffers`, `Sight` and scanlines.

    ``height`` is in pixels; ``spans`` is the maximum per row of samples, and ``corners`` is the maximum per face.
    """
    rows = 4 * height
    floats = 21 * faces + 11 * corners + 21 + TILES * TILES + 4 + PLACEMENT_SIZE + 4 * (1 + VISITS_A_ROOM) * rooms
    wholes = 3 * (rows * spans + 3 * spans + 8) + rows + 2 * (rows + 8) + 3 * faces
    return floats, SPANS + wholes + (2 + VISITS_A_ROOM) * rooms


@device_function(nogil=True)
def drawn_in(view: F64, floats: F64, wholes: I32) -> tuple[DrawBuffers, int, int]:
    """Return the buffers in which faces are drawn, and the index at which the unused memory of each array begins."""
    rows = 4 * int(view[HEIGHT])
    spans = int(view[ROOM])
    faces = int(view[ROOM + 1])
    corners = int(view[ROOM + 2])
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
    buffers = DrawBuffers(
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
    return buffers, tiles, run + faces


@device_function(nogil=True)
def sight_in(floats: F64, wholes: I32, rooms: int) -> Sight:
    """Return the lists of rooms in sight, at the start of the unused memory."""
    most = VISITS_A_ROOM * rooms
    return Sight(
        wholes[:rooms],
        floats[: 4 * rooms].reshape(rooms, 4),
        wholes[rooms : 2 * rooms],
        wholes[2 * rooms : 2 * rooms + most],
        floats[4 * rooms : 4 * rooms + 4 * most].reshape(most, 4),
    )
