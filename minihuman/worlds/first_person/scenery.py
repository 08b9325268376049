"""From a stage to the scene the renderer draws: rooms once an episode, the places of things whenever they moved."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.first_person.colours import rgb
from minihuman.worlds.first_person.entities import Box, Entity, ImageFrame, Mesh, Position, TextFrame
from minihuman.worlds.first_person.floor import Covering, FloorPlan
from minihuman.worlds.first_person.render.assets import Library
from minihuman.worlds.first_person.render.scene import (
    BoxLook,
    FrameLook,
    Light,
    Look,
    MeshLook,
)
from minihuman.worlds.first_person.render.tables import Faces, Rooms
from minihuman.worlds.first_person.rooms import Edge, Point, Portal, Room, WallPiece
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


def room_tables(floor: FloorPlan, library: Library) -> tuple[Faces, Rooms]:
    """The rooms of a floor plan as the renderer's tables: floor, ceiling and pieces of wall, and the openings."""
    faces, first_face, first_edge, first_opening = _Faces(), [0], [0], [0]
    openings: list[list[Position]] = []
    into: list[int] = []
    for room, covering, pieces in zip(floor.rooms, floor.coverings, floor.pieces, strict=True):
        ground, wall, above = _textures(room, covering)
        faces.level(room.outline, 0.0, (0.0, 1.0, 0.0), library.texture_row(ground), library.texture_size_m(ground))
        if above is not None:
            row, size_m = library.texture_row(above), library.texture_size_m(above)
            faces.level(room.outline[::-1], room.wall_height, (0.0, -1.0, 0.0), row, size_m)
        row, size_m = library.texture_row(wall), library.texture_size_m(wall)
        for piece in pieces:
            faces.upright(room.edges[piece.edge], piece, row, size_m)
        for edge, portals in zip(room.edges, room.portals, strict=True):
            for portal in portals:
                if portal.into is not None:
                    openings.append(_corners(edge, portal))
                    into.append(portal.into)
        first_face.append(len(faces.textures))
        first_edge.append(first_edge[-1] + len(room.edges))
        first_opening.append(len(into))
    rooms = Rooms(
        np.array(first_face, np.int32),
        np.array([(room.min_x, room.min_z, room.max_x, room.max_z) for room in floor.rooms]),
        np.array(first_edge, np.int32),
        np.array([_half_plane(edge) for room in floor.rooms for edge in room.edges]),
        np.array(first_opening, np.int32),
        np.array(openings, dtype=np.float64).reshape(-1, 4, 3),
        np.array(into, np.int32),
        np.array([room.ceiling is not None for room in floor.rooms]),
    )
    return faces.table(), rooms


class _Faces:
    """A table of faces in the making."""

    def __init__(self) -> None:
        self.starts = [0]
        self.corners: list[Position] = []
        self.places: list[Point] = []
        self.normals: list[Position] = []
        self.textures: list[int] = []

    def level(
        self, outline: tuple[Point, ...], y: float, normal: Position, texture: int, size_m: tuple[float, float]
    ) -> None:
        """A floor or a ceiling."""
        across, up = size_m
        self.corners += [(x, y, z) for x, z in outline]
        self.places += [(x / across, z / up) for x, z in outline]
        self._end(normal, texture)

    def upright(self, edge: Edge, piece: WallPiece, texture: int, size_m: tuple[float, float]) -> None:
        """A piece of wall."""
        across, up = size_m
        start, end, bottom, top = piece.start / across, piece.end / across, piece.bottom / up, piece.top / up
        self.corners += _corners(edge, piece)
        self.places += [(start, bottom), (start, top), (end, top), (end, bottom)]
        self._end((edge.normal[0], 0.0, edge.normal[1]), texture)

    def table(self) -> Faces:
        """The faces, all white."""
        start = np.array(self.starts, np.int32)
        position, normal = np.array(self.corners), np.array(self.normals)
        return Faces(
            start,
            position,
            np.array(self.places),
            np.repeat(normal, np.diff(start), axis=0),
            np.ones((len(normal), 3)),
            np.array(self.textures, np.int32),
            np.column_stack((normal, -np.sum(normal * position[start[:-1]], axis=1))),
        )

    def _end(self, normal: Position, texture: int) -> None:
        self.starts.append(len(self.corners))
        self.normals.append(normal)
        self.textures.append(texture)


def _corners(edge: Edge, part: WallPiece | Portal) -> list[Position]:
    """The corners of a part of a wall, counter-clockwise as seen from inside the room."""
    (x0, z0), (x1, z1) = edge.at(part.start), edge.at(part.end)
    return [(x0, part.bottom, z0), (x0, part.top, z0), (x1, part.top, z1), (x1, part.bottom, z1)]


def _half_plane(edge: Edge) -> Position:
    """a, b, c of a * x + b * z + c, above 0 on the room's side of the edge."""
    (x, z), (a, b) = edge.start, edge.normal
    return a, b, -(a * x + b * z)


def _textures(room: Room, covering: Covering) -> tuple[str, str, str | None]:
    """The textures of floor, wall and ceiling, with the picture of each that was drawn; None for no ceiling."""
    ceiling = None if room.ceiling is None else variant(room.ceiling, covering.ceiling)
    return variant(room.floor, covering.floor), variant(room.wall, covering.wall), ceiling


def variant(texture: str, number: int) -> str:
    """The name of one picture of a texture, counted from 0."""
    return f"{texture}_{number + 1}"


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
