"""What a picture is drawn in: tables cut out of two long arrays, for a kernel takes few arrays faster than many."""

import numpy as np

from minihuman.worlds.first_person.render.project import HEIGHT, PLACEMENT_SIZE, ROOM, TILES
from minihuman.worlds.first_person.render.tables import F64, I32, Drawn, Faces, Rooms
from minihuman.worlds.first_person.render.texture import LANES
from minihuman.worlds.first_person.render.visit import VISITS_A_ROOM, Sight
from minihuman.worlds.kernels import part

# Where in the whole numbers stand: the colours of what is looked up along a row; which sizes of a texture that takes,
# under which light and at which places; the row's stretches; a row of the picture; the spans.
STRIP = 512
SIZES = STRIP + LANES
LIGHTS = SIZES + 3 * LANES
PLACES = LIGHTS + 2 * LANES
STRETCHES = PLACES + 4 * STRIP
MOST_STRETCHES = 264
LINE = STRETCHES + 5 * (2 * MOST_STRETCHES + 4)
SPANS = LINE + 4096 + 2 * LANES


def packed_faces(faces: Faces) -> tuple[F64, I32]:
    """A table of faces as two arrays; see `faces_of`."""
    start, position, place, normal, colour, texture, plane = faces
    floats = [position, place, normal, colour, plane]
    sizes = np.array([len(position), len(texture)], np.int32)
    return np.concatenate([each.ravel() for each in floats]), np.concatenate([sizes, start, texture])


def packed_rooms(rooms: Rooms) -> tuple[F64, I32]:
    """A table of rooms as two arrays; see `rooms_of`."""
    sizes = np.array([len(rooms.bounds), len(rooms.edge), len(rooms.opening)], np.int32)
    wholes = [sizes, rooms.first_face, rooms.first_edge, rooms.first_opening, rooms.opening_into]
    floats = np.concatenate([each.ravel() for each in (rooms.bounds, rooms.edge, rooms.opening)])
    return floats, np.concatenate([*wholes, rooms.roofed.astype(np.int32)])


@part(lean=True)
def faces_of(floats: F64, wholes: I32) -> Faces:
    """A table of faces that was packed."""
    corners, faces = int(wholes[0]), int(wholes[1])
    position, place, normal = 3 * corners, 5 * corners, 8 * corners
    colour, plane = normal + 3 * faces, normal + 7 * faces
    return Faces(
        wholes[2 : 3 + faces],
        floats[:position].reshape(corners, 3),
        floats[position:place].reshape(corners, 2),
        floats[place:normal].reshape(corners, 3),
        floats[normal:colour].reshape(faces, 3),
        wholes[3 + faces : 3 + 2 * faces],
        floats[colour:plane].reshape(faces, 4),
    )


@part(lean=True)
def rooms_of(floats: F64, wholes: I32) -> Rooms:
    """A table of rooms that was packed."""
    rooms, edges, openings = int(wholes[0]), int(wholes[1]), int(wholes[2])
    bounds, edge, opening = 4 * rooms, 4 * rooms + 3 * edges, 4 * rooms + 3 * edges + 12 * openings
    first_edge, first_opening, into = 4 + rooms, 5 + 2 * rooms, 6 + 3 * rooms
    roofed = into + openings
    return Rooms(
        wholes[3:first_edge],
        floats[:bounds].reshape(rooms, 4),
        wholes[first_edge:first_opening],
        floats[bounds:edge].reshape(edges, 3),
        wholes[first_opening:into],
        floats[edge:opening].reshape(openings, 4, 3),
        wholes[into:roofed],
        wholes[roofed : roofed + rooms],
    )


def size_of(height: int, spans: int, faces: int, corners: int, rooms: int) -> tuple[int, int]:
    """How many float64 and int32 a picture is drawn in, with so many spans of a row and corners of a face at most."""
    rows = 4 * height
    floats = 21 * faces + 11 * corners + 21 + TILES * TILES + 4 + PLACEMENT_SIZE + 4 * (1 + VISITS_A_ROOM) * rooms
    wholes = 3 * (rows * spans + 3 * spans + 8) + rows + 2 * (rows + 8) + 3 * faces
    return floats, SPANS + wholes + (2 + VISITS_A_ROOM) * rooms


@part(lean=True)
def drawn_in(view: F64, floats: F64, wholes: I32) -> tuple[Drawn, int, int]:
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
    drawn = Drawn(
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


@part(lean=True)
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
