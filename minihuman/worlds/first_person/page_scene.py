"""The data of a first-person world for a web page: its state in flat arrays, and its scene, reduced to what is seen."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette
from minihuman.worlds.first_person import rules
from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.render.assets import join, pack, size_table
from minihuman.worlds.first_person.render.draw_buffers import packed_faces
from minihuman.worlds.first_person.render.drawing import half_view, turn
from minihuman.worlds.first_person.render.kernel_tables import F64, FIRST, I32, LAST, FaceTable, TextureTable
from minihuman.worlds.first_person.render.scene import SceneTables
from minihuman.worlds.first_person.render.texture import MOST_SIZES
from minihuman.worlds.rng import RngState, read_rng_state

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv


class PageState(NamedTuple):
    """The arrays of `rules.step`, and the number of entities in the scene."""

    things: F64
    numbers: F64
    walls: F64
    rng_state: RngState
    rooms: F64
    edges: F64
    looks: int


class PageLook(NamedTuple):
    """The parts of a scene that no step changes: its entities, and the numbers of camera and shadows."""

    entities: Sequence[Entity]
    numbers: F64  # in the order of `_OF_LOOK`


_LEAST_TEXELS = 9  # of a texture's smallest size, one texel in its ring

# the indices, in the numbers of `rules.step`, of those that no step changes
_OF_LOOK = [rules.CAMERA_AHEAD, rules.COS_PITCH, rules.SIN_PITCH, rules.TAN_FOV, rules.SHADOWS]


class PageScene(NamedTuple):
    """Arrays named as the parameters of `cover` and `colour`, and the pixels of each texture, uint8[h, w, 3]."""

    tables: dict[str, NDArray[np.generic]]
    textures: tuple[NDArray[np.uint8], ...]


def copy_state(env: "FirstPersonEnv") -> tuple[F64, F64, RngState]:
    """Return copies of the arrays that a step changes: entities, numbers, and random stream (0 if no step draws)."""
    flat = env.flat_state()
    flat.write_counts(env)
    rng_state = np.zeros(6, np.uint64)
    numbers = flat.numbers.copy()
    if numbers[rules.DRAWS]:
        read_rng_state(env.np_random, rng_state)
    return flat.things.copy(), numbers, rng_state


def locate(env: "FirstPersonEnv", look: PageLook) -> tuple[F64, F64, RngState]:
    """Return the arrays that a step changes, as a page reads them that has the scene ``look`` of the episode.

    Each entity refers to its number in the scene, or to -1 if it is not there.
    """
    things, numbers, rng_state = copy_state(env)
    number_by_id = {id(thing): number for number, thing in enumerate(look.entities)}
    things[:, rules.LOOK] = [number_by_id.get(id(thing), -1) for thing in env.flat_state().listed]
    numbers[_OF_LOOK] = look.numbers
    return things, numbers, rng_state


def describe(
    env: "FirstPersonEnv", palette: Palette, size_px: tuple[int, int]
) -> tuple[PageState, PageScene, PageLook]:
    """Return an episode's state and scene as a page reads them; the page can draw pictures of any size."""
    entities, target = env.staged(palette, size_px)
    agent = env.agent
    floor = env.stage.floor
    count = target.layout.thing_count
    pitch = turn(agent.cam_pitch * (math.pi / 180), agent.trig)
    shadows = len(entities) if count > len(entities) else 0  # the number of the first shadow; 0 without shadows
    look = PageLook(entities, np.array([agent.cam_fwd_disp, *pitch, half_view(agent.cam_fov_y, agent.trig), shadows]))
    things, numbers, rng_state = locate(env, look)
    outlines = [
        (room.outline.min_x, room.outline.max_x, room.outline.min_z, room.outline.max_z) for room in floor.rooms
    ]
    rooms = np.column_stack((floor.room_weights, outlines, floor.first_edge[:-1], floor.first_edge[1:]))
    edges = np.ascontiguousarray(floor.edges[:, (0, 1, 5, 6)])  # the starts and the normals
    state = PageState(things, numbers, floor.walls, rng_state, rooms, edges, count)
    return state, cut_scene(target.layout, target.view.copy()), look


def cut_scene(layout: SceneTables, view: F64) -> PageScene:
    """Return a scene's tables with only the faces and textures that it shows, which are numbered anew.

    Args:
        layout: the tables of the scene
        view: the numbers of the view that do not change: light and sky
    """
    room_floats, room_wholes = (table.copy() for table in layout.packed_rooms)
    things = layout.things.copy()
    library = _unpack_faces(*layout.packed_library)
    faces = pack([], [])
    new_first: dict[tuple[int, int], int] = {}  # by the old range of faces, the number of the first one now
    for row in things:
        first = int(row[FIRST])
        last = int(row[LAST])
        if (first, last) not in new_first:
            new_first[first, last] = len(faces.texture)
            faces = join(faces, _cut_faces(library, first, last))
        row[FIRST] = new_first[first, last]
        row[LAST] = row[FIRST] + last - first
    count = int(room_wholes[1])  # of the rooms' faces
    room_textures = room_wholes[3 + count : 3 + 2 * count]  # a view, so that new numbers are written to the table
    texture_rows = [int(row) for row in np.unique(np.concatenate([room_textures, faces.texture])) if row >= 0]
    numbers = {row: number for number, row in enumerate(texture_rows)}
    for textures in (room_textures, faces.texture):
        textures[:] = [numbers.get(int(row), int(row)) for row in textures]
    pixels = tuple(_pixels(layout.textures, row) for row in texture_rows)
    begin = 0
    table = np.zeros((len(texture_rows), MOST_SIZES, 2), np.uint32)
    for number, texture in enumerate(pixels):
        table[number] = size_table(texture.shape[1], texture.shape[0], begin)
        begin = int(table[number, int(table[number, -1, 1]), 0]) + _LEAST_TEXELS
    floats, wholes = packed_faces(faces)
    limits = np.array([layout.capacity, layout.most_corners, len(layout.rooms.bounds), begin], np.int32)
    return PageScene(
        {
            "room_floats": room_floats,
            "room_wholes": room_wholes,
            "library_floats": floats,
            "library_wholes": wholes,
            "things": things,
            "table": table.ravel(),
            "view": view,
            "limits": limits,
        },
        pixels,
    )


def _unpack_faces(floats: F64, wholes: I32) -> FaceTable:
    """Return the face table that was packed into an array of floats and one of whole numbers.

    The whole numbers are the number of corners and that of faces, where the corners of each face begin and the last
    ones end, and each face's texture.
    """
    corners = int(wholes[0])
    faces = int(wholes[1])
    sizes = np.cumsum([3 * corners, 2 * corners, 3 * corners, 3 * faces, 4 * faces])
    position, place, normal, colour, plane = np.split(floats[: sizes[-1]], sizes[:-1])
    return FaceTable(
        wholes[2 : 3 + faces],
        position.reshape(-1, 3),
        place.reshape(-1, 2),
        normal.reshape(-1, 3),
        colour.reshape(-1, 3),
        wholes[3 + faces : 3 + 2 * faces],
        plane.reshape(-1, 4),
    )


def _cut_faces(faces: FaceTable, first: int, last: int) -> FaceTable:
    """Return the table of the faces from ``first`` up to ``last``, with corners numbered anew."""
    a = int(faces.start[first])
    b = int(faces.start[last])
    start, position, place, normal, colour, texture, plane = faces
    rows = slice(first, last)
    return FaceTable(
        start[first : last + 1] - a, position[a:b], place[a:b], normal[a:b], colour[rows], texture[rows], plane[rows]
    )


def _pixels(textures: TextureTable, row: int) -> NDArray[np.uint8]:
    """Return the pixels of a texture in its largest size, uint8[h, w, 3], with the first row on top."""
    begin, extents = (int(number) for number in textures.table[2 * MOST_SIZES * row :][:2])
    # ``extents`` has the width in its low 16 bits, and the height above them; a ring of one texel is around the pixels
    width = extents & 0xFFFF
    height = extents >> 16
    with_ring = textures.texels[begin : begin + (width + 2) * (height + 2)].reshape(height + 2, width + 2)
    inner = np.ascontiguousarray(with_ring[-2:0:-1, 1:-1])
    return np.ascontiguousarray(inner.view(np.uint8).reshape(height, width, 4)[..., :3])
