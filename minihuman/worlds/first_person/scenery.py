"""From a stage to the scene the renderer draws: rooms once an episode, the places of things whenever they moved."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.first_person.colours import rgb
from minihuman.worlds.first_person.entities import Box, Entity, ImageFrame, Mesh, TextFrame
from minihuman.worlds.first_person.floor import Covering, FloorPlan
from minihuman.worlds.first_person.render.scene import (
    BoxLook,
    FrameLook,
    Light,
    Look,
    MeshLook,
    Opening,
    SceneRoom,
    Surface,
)
from minihuman.worlds.first_person.rooms import Portal, Room, WallPiece
from minihuman.worlds.first_person.stage import Stage


def light(stage: Stage) -> Light:
    """The light of an episode."""
    x, y, z = stage.light_pos
    return Light((x + 1, y + 1, z + 1), stage.light_colour, stage.light_ambient)


def places(stage: Stage, things: Sequence[Entity]) -> NDArray[np.float64]:
    """Where the things are now, (n, 4) x, y, z, yaw_rad; not a number for one that left the stage."""
    present = set(map(id, stage.entities))
    gone = (np.nan,) * 4
    rows = [(*thing.pos, thing.dir) if id(thing) in present else gone for thing in things]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def scene_rooms(floor: FloorPlan) -> tuple[SceneRoom, ...]:
    """The rooms of a floor plan as flat surfaces, and the openings between them."""
    return tuple(
        SceneRoom(
            outline=np.array(room.outline),
            surfaces=_surfaces(room, pieces, _textures(room, covering)),
            openings=tuple(
                Opening(_upright(room, edge, portal), portal.into)
                for edge, portals in enumerate(room.portals)
                for portal in portals
                if portal.into is not None
            ),
            roofed=room.ceiling is not None,
        )
        for room, covering, pieces in zip(floor.rooms, floor.coverings, floor.pieces, strict=True)
    )


def _textures(room: Room, covering: Covering) -> tuple[str, str, str | None]:
    """The textures of floor, wall and ceiling, with the picture of each that was drawn; None for no ceiling."""
    ceiling = None if room.ceiling is None else variant(room.ceiling, covering.ceiling)
    return variant(room.floor, covering.floor), variant(room.wall, covering.wall), ceiling


def variant(texture: str, number: int) -> str:
    """The name of one picture of a texture, counted from 0."""
    return f"{texture}_{number + 1}"


def _surfaces(room: Room, pieces: Sequence[WallPiece], textures: tuple[str, str, str | None]) -> tuple[Surface, ...]:
    floor, wall, ceiling = textures
    ground = np.array(room.outline)
    level = np.zeros(len(ground))
    surfaces = [Surface(np.column_stack((ground[:, 0], level, ground[:, 1])), ground, floor)]
    if ceiling is not None:
        above = ground[::-1]
        surfaces.append(Surface(np.column_stack((above[:, 0], level + room.wall_height, above[:, 1])), above, ceiling))
    for piece in pieces:
        across = (
            (piece.start, piece.bottom),
            (piece.start, piece.top),
            (piece.end, piece.top),
            (piece.end, piece.bottom),
        )
        surfaces.append(Surface(_upright(room, piece.edge, piece), np.array(across), wall))
    return tuple(surfaces)


def _upright(room: Room, edge: int, part: WallPiece | Portal) -> NDArray[np.float64]:
    """The corners of a part of a wall, counter-clockwise as seen from inside the room."""
    (x0, z0), (x1, z1) = room.edges[edge].at(part.start), room.edges[edge].at(part.end)
    return np.array(((x0, part.bottom, z0), (x0, part.top, z0), (x1, part.top, z1), (x1, part.bottom, z1)))


def look(thing: Entity, palette: Palette) -> Look:
    """What a thing looks like.

    Raises:
        WorldError: if it is of a kind that cannot be drawn.
    """
    match thing:
        case Box():
            return BoxLook(thing.size, thing.rgb if palette == "classic" else rgb(thing.colour_name, palette))
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
