"""Layout: rooms and looks turned into the kernels' tables, once an episode."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import CUBE, SHADOW_FACES, SHADOW_REACH, Library, join, pack
from minihuman.worlds.first_person.render.memory import packed_faces, packed_rooms
from minihuman.worlds.first_person.render.scene import (
    BoxLook,
    FrameLook,
    Light,
    Look,
    MeshLook,
    Rgb,
    Scene,
    SceneRoom,
    ShadowLook,
)
from minihuman.worlds.first_person.render.tables import F64, FIRST, I32, LAST, THING_SIZE, Faces, Rooms, Textures


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """A scene's tables; they are never written to after this."""

    rooms: Rooms
    packed_rooms: tuple[F64, I32]  # their faces, and the rooms
    packed_library: tuple[F64, I32]  # faces of things
    things: F64  # (things, THING_SIZE)
    textures: Textures
    capacity: int  # the most faces one picture can show
    most_corners: int  # of one face

    @property
    def thing_count(self) -> int:
        """How many things there are."""
        return len(self.things)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x0, z0, x1, z1 of the whole floor plan, metres."""
        low, high = self.rooms.bounds.min(axis=0), self.rooms.bounds.max(axis=0)
        return float(low[0]), float(low[1]), float(high[2]), float(high[3])


def lay_out(
    rooms: Sequence[SceneRoom],
    looks: Sequence[Look] = (),
    *,
    library: Library,
    places: F64 | None = None,
    light: Light | None = None,
    sky: Rgb = (0.25, 0.82, 1.0),
) -> Scene:
    """Make a scene; without places, its things are hidden until ``Scene.at`` says where they stand.

    Raises:
        WorldError: if there are no rooms, an opening leads nowhere, or a texture or mesh is unknown.
    """
    if not rooms:
        raise WorldError("a scene without rooms has nothing to show; give it one")
    return furnish(_rooms(rooms, library), looks, library=library, places=places, light=light, sky=sky)


def furnish(
    tables: tuple[Faces, Rooms],
    looks: Sequence[Look] = (),
    *,
    library: Library,
    places: F64 | None = None,
    light: Light | None = None,
    sky: Rgb = (0.25, 0.82, 1.0),
) -> Scene:
    """Make a scene of rooms that are tables already."""
    faces, room_table = tables
    table, things = _things(looks, library)
    floats, wholes = packed_faces(faces)
    more_floats, more_wholes = packed_rooms(room_table)
    layout = Layout(
        room_table,
        (np.concatenate([floats, more_floats]), np.concatenate([wholes, more_wholes])),
        library.packed if table is library.faces else packed_faces(table),
        things,
        library.textures,
        capacity=len(faces.texture) + int(np.sum(things[:, LAST] - things[:, FIRST])) + 6 * len(looks) + 2,
        most_corners=max(int(np.max(np.diff(faces.start))), 4) + 8,
    )
    where = np.full((len(looks), 4), np.nan) if places is None else places
    return Scene(layout, where, light if light is not None else Light(), sky)


def _rooms(rooms: Sequence[SceneRoom], library: Library) -> tuple[Faces, Rooms]:
    polygons, places, rows, first_face = [], [], [], [0]
    edges, first_edge, bounds = [], [0], []
    holes, into, first_opening = [], [], [0]
    for room in rooms:
        for surface in room.surfaces:
            polygons.append(surface.corners)
            places.append(surface.texture_m / np.array(library.texture_size_m(surface.texture)))
            rows.append(library.texture_row(surface.texture))
        for opening in room.openings:
            if not 0 <= opening.into < len(rooms):
                raise WorldError(f"an opening leads into room {opening.into}; there are {len(rooms)}, counted from 0")
            holes.append(opening.corners)
            into.append(opening.into)
        outline = room.outline
        following = np.roll(outline, -1, axis=0)
        along = following - outline
        along /= np.sqrt(np.sum(along * along, axis=1, keepdims=True))
        # the inside of a counter-clockwise outline (x right, z down the page) is on the left of its edges
        a, b = along[:, 1], -along[:, 0]
        edges.append(np.column_stack([a, b, -(a * outline[:, 0] + b * outline[:, 1])]))
        bounds.append([*outline.min(axis=0), *outline.max(axis=0)])
        first_face.append(len(polygons))
        first_edge.append(first_edge[-1] + len(outline))
        first_opening.append(len(holes))
    table = Rooms(
        np.array(first_face, np.int32),
        np.array(bounds),
        np.array(first_edge, np.int32),
        np.concatenate(edges),
        np.array(first_opening, np.int32),
        np.array(holes).reshape(-1, 4, 3),
        np.array(into, np.int32),
        np.array([room.roofed for room in rooms]),
    )
    return pack(polygons, places, rows), table


def _things(looks: Sequence[Look], library: Library) -> tuple[Faces, F64]:
    ranges, scales, normal_scales, tints, reaches, boxes = [], [], [], [], [], []
    frames: list[tuple[int, Faces]] = []
    for index, look in enumerate(looks):
        match look:
            case BoxLook(size, colour):
                ranges.append(library.mesh_faces(CUBE))
                scales.append(size)
                normal_scales.append(1.0)
                tints.append(colour)
                around = float(np.hypot(size[0], size[2])) / 2
                reaches.append((around, float(np.hypot(around, size[1]))))
                boxes.append((size[0] / 2, 0.0, size[1], size[2] / 2))
            case MeshLook(mesh, height_m, tint):
                ranges.append(library.mesh_faces(mesh))
                scale, normal_scale = library.mesh_scale(mesh, height_m)
                scales.append((scale,) * 3)
                normal_scales.append(normal_scale)
                tints.append(tint)
                around, reach = library.mesh_reach(mesh)
                reaches.append((around * scale, reach * scale))
                half_width, low, high, half_depth = library.mesh_box(mesh)
                boxes.append((half_width * scale, low * scale, high * scale, half_depth * scale))
            case FrameLook():
                frames.append((index, _frame(look, library)))
                ranges.append((0, 0))
                scales.append((1.0, 1.0, 1.0))
                normal_scales.append(1.0)
                tints.append((1.0, 1.0, 1.0))
                around = float(np.hypot(look.width_m / 2, look.depth_m))
                reaches.append((around, float(np.hypot(around, look.height_m / 2))))
                boxes.append((look.depth_m, -look.height_m / 2, look.height_m / 2, look.width_m / 2))
            case ShadowLook(radius_m):
                ranges.append(SHADOW_FACES)
                scales.append((radius_m, 1.0, radius_m))
                normal_scales.append(1.0)
                tints.append((0.0, 0.0, 0.0))
                reaches.append((radius_m * SHADOW_REACH,) * 2)
                boxes.append((radius_m * SHADOW_REACH, 0.0, 0.0, radius_m * SHADOW_REACH))
    table = library.faces
    for index, frame in frames:
        first = len(table.texture)
        table = join(table, frame)
        ranges[index] = first, len(table.texture)
    columns = [ranges, scales, np.reshape(normal_scales, (-1, 1)), tints, reaches, boxes]
    things = np.empty((len(looks), THING_SIZE))
    if looks:
        things[:] = np.concatenate([np.asarray(each, np.float64) for each in columns], axis=1)
    return table, things


def _frame(look: FrameLook, library: Library) -> Faces:
    """A frame's front, a square a texture from left to right, and its four black edges; it faces +x."""
    half_width, half_height, depth = look.width_m / 2, look.height_m / 2, look.depth_m
    unit = np.array([[1.0, 1.0], [0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    polygons, rows = [], []
    step = look.width_m / len(look.textures)
    for index, name in enumerate(look.textures):
        left = half_width - index * step
        right = left - step
        y = half_height
        polygons.append(np.array([[depth, y, right], [depth, y, left], [depth, -y, left], [depth, -y, right]]))
        rows.append(-1 if name is None else library.texture_row(name))
    y, z = half_height, half_width
    edges = [
        [[0, y, -z], [depth, y, -z], [depth, -y, -z], [0, -y, -z]],
        [[depth, y, z], [0, y, z], [0, -y, z], [depth, -y, z]],
        [[depth, y, z], [depth, y, -z], [0, y, -z], [0, y, z]],
        [[depth, -y, -z], [depth, -y, z], [0, -y, z], [0, -y, -z]],
    ]
    polygons += [np.array(edge, np.float64) for edge in edges]
    rows += [-1] * 4
    faces = pack(polygons, [unit] * len(polygons), rows)
    faces.colour[-4:] = 0.0
    return faces
