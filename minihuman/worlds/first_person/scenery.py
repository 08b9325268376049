"""From a stage to the scene the renderer draws: rooms once an episode, the places of things whenever they moved."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.first_person.building.floor import FloorPlan, RoomPlan
from minihuman.worlds.first_person.building.masonry import CEILING, corners_of, room_faces
from minihuman.worlds.first_person.colours import rgb
from minihuman.worlds.first_person.entities import Box, ColouredMesh, Entity, ImageFrame, Mesh, TextFrame
from minihuman.worlds.first_person.render.assets import Library
from minihuman.worlds.first_person.render.scene import (
    BoxLook,
    FrameLook,
    Light,
    Look,
    MeshLook,
    ShadowLook,
)
from minihuman.worlds.first_person.render.tables import F64, I64, Faces, Rooms
from minihuman.worlds.first_person.stage import Stage

GONE = (np.nan,) * 4


def light(stage: Stage) -> Light:
    """The light of an episode."""
    x, y, z = stage.light_pos
    return Light((x + 1, y + 1, z + 1), stage.light_colour, stage.light_ambient)


def places(stage: Stage, things: Sequence[Entity]) -> NDArray[np.float64]:
    """Where the things are now, (n, 4) x, y, z, yaw_rad; not a number for one that left the stage."""
    present = set(map(id, stage.entities))
    rows = [(*thing.pos, thing.dir) if id(thing) in present else GONE for thing in things]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def shaded(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the shadows of things are: below them; not a number where a thing is not on the ground."""
    return np.where(places[:, 1:2] == 0.0, places, np.nan)


def shadow(thing: Entity) -> ShadowLook:
    """The shadow of a thing: of a box round its corners, of others narrower than what collides; of frames none."""
    part = {Box: 1.1, ImageFrame: 0.0, TextFrame: 0.0}.get(type(thing), 0.7)
    return ShadowLook(part * float(thing.radius))


def room_tables(floor: FloorPlan, library: Library) -> tuple[Faces, Rooms]:
    """The rooms of a floor plan as the renderer's tables: floor, ceiling and pieces of wall, and the openings."""
    edges, first = floor.edges, floor.first_edge
    heights = np.array([room.wall_height for room in floor.rooms])
    textures, sizes_m = _coverings(floor, library)
    faces, first_face = room_faces(first, edges, heights, floor.pieces, textures, sizes_m)
    doors = floor.portals[floor.portals[:, 5] >= 0]
    (x, z), (a, b) = edges[:, :2].T, edges[:, 5:].T
    bounds = [extent.reduceat(at, first[:-1]) for extent in (np.minimum, np.maximum) for at in (x, z)]
    return faces, Rooms(
        first_face,
        np.column_stack(bounds),
        first.astype(np.int32),
        np.column_stack((a, b, -(a * x + b * z))),
        np.searchsorted(doors[:, 0], first).astype(np.int32),
        corners_of(edges, doors),
        doors[:, 5].astype(np.int32),
        textures[:, CEILING] >= 0,
    )


def _coverings(floor: FloorPlan, library: Library) -> tuple[I64, F64]:
    """Of each room's floor, wall and ceiling the row of the texture, and how many metres it covers, right and up."""
    numbers: dict[tuple[str | None, ...], int] = {}  # rooms covered alike share one
    which = [numbers.setdefault(_covering(room), len(numbers)) for room in floor.rooms]
    rows = [[-1 if name is None else library.texture_row(name) for name in names] for names in numbers]
    sizes_m = [[(1.0, 1.0) if name is None else library.texture_size_m(name) for name in names] for names in numbers]
    return np.array(rows)[which], np.array(sizes_m)[which]


def _covering(room: RoomPlan) -> tuple[str | None, ...]:
    """The textures of floor, wall and ceiling, None for no ceiling."""
    wall, floor, ceiling = room.pictures
    above = None if room.ceiling is None else variant(room.ceiling, ceiling)
    return variant(room.floor, floor), variant(room.wall, wall), above


def variant(texture: str, number: int) -> str:
    """The name of one picture of a texture, counted from 0."""
    return f"{texture}_{number + 1}"


def look(thing: Entity, palette: Palette, library: Library) -> Look:
    """What a thing looks like; only our own balls and keys come in the colours of every palette.

    Raises:
        WorldError: if it is of a kind that cannot be drawn.
    """
    match thing:
        case Box():
            return BoxLook(thing.size, thing.rgb if palette == "classic" else rgb(thing.colour_name, palette))
        case ColouredMesh() if palette != "classic" and not library.brings(thing.mesh):
            return MeshLook(f"{thing.kind}_white", thing.height, rgb(thing.colour_name, palette))
        case Mesh():
            return MeshLook(thing.mesh, thing.height)
        case ImageFrame():
            return FrameLook((variant(thing.texture, 0),), thing.width, thing.height, thing.depth)
        case TextFrame():
            letters = tuple(
                None if texture is None else variant(texture, number)
                for texture, number in zip(thing.textures, thing.variants, strict=True)
            )
            return FrameLook(letters, thing.width, thing.height, thing.depth)
        case _:
            raise WorldError(f"{thing!r} is a {type(thing).__name__}, which cannot be drawn; use a box, mesh or frame")
