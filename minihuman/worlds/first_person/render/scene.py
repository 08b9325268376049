"""The scene that the renderer draws (rooms of flat surfaces, entities, light, camera, sky), and its tables.

Lengths are in metres, with x to the right, y up, and z towards the reader on a floor plan. Yaw is 0 along +x and grows
counter-clockwise as seen from above. The module knows no rules, randomness or pixels. A world builds its scene once per
episode and draws it as often as needed:

    scene = build_scene(rooms, looks, light=..., sky=...)
    scene = scene.at(places)                                       # the present places of the entities
    picture = render(scene, camera, width=80, height=60)           # drawing.py: uint8[60, 80, 3]
    depth = render_depth(scene, camera, width=80, height=60)       # drawing.py: float32[60, 80], metres
    plan = render_top(scene, width=80, height=60, agent=pose)      # drawing.py: uint8[60, 80, 3]
    seen = visible_things(scene, camera, width=80, height=60)      # drawing.py: indices of the looks
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import (
    CUBE,
    SHADOW_FACES,
    SHADOW_REACH,
    Library,
    join,
    pack,
)
from minihuman.worlds.first_person.render.draw_buffers import packed_faces, packed_rooms
from minihuman.worlds.first_person.render.kernel_tables import (
    F64,
    FIRST,
    I32,
    LAST,
    THING_SIZE,
    FaceTable,
    RoomTable,
    TextureTable,
)

Rgb = tuple[float, float, float]  # 0 to 1
Vector = tuple[float, float, float]  # x, y, z
# the distances of a camera's near and far plane
NEAR_M = 0.04
FAR_M = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A flat convex piece of floor, wall or ceiling, visible from the side where its corners run counter-clockwise.

    ``texture_m`` is each corner's position in metres right and up from the texture's origin: (x, z) on a floor,
    (distance along the wall, height) on a wall. The texture repeats at its own size.
    """

    corners: NDArray[np.float64]  # (n, 3)
    texture_m: NDArray[np.float64]  # (n, 2)
    texture: str  # with its variant: "brick_wall_1"

    def __post_init__(self) -> None:
        if self.corners.shape[0] < 3 or self.corners.shape[1:] != (3,):
            raise WorldError(f"the corners of a surface have the shape {self.corners.shape}; give 3 or more of x, y, z")
        if self.texture_m.shape != (len(self.corners), 2):
            raise WorldError(
                f"texture_m has the shape {self.texture_m.shape}; {len(self.corners)} corners need one place each"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """An opening in a room's wall, through which the room with the index ``into`` is visible.

    Its corners run in the same order as those of a surface in its place.
    """

    corners: NDArray[np.float64]  # (4, 3)
    into: int


@dataclass(frozen=True, slots=True, eq=False)
class SceneRoom:
    """One convex room with a counter-clockwise outline as seen from above; without a roof, its walls hide nothing."""

    outline: NDArray[np.float64]  # (n, 2) x, z
    surfaces: Sequence[Surface]
    openings: Sequence[Opening] = ()
    roofed: bool = True


@dataclass(frozen=True, slots=True)
class BoxLook:
    """A plain box, with its base at the entity's place."""

    size: Vector
    colour: Rgb


@dataclass(frozen=True, slots=True)
class MeshLook:
    """A mesh of the asset set, scaled to a height, with its base at the entity's place."""

    mesh: str  # "duckie", "key_red"
    height_m: float
    tint: Rgb = (1.0, 1.0, 1.0)  # multiplies its own colours


@dataclass(frozen=True, slots=True)
class FrameLook:
    """A frame with black edges that shows textures side by side; the middle of its back is at the entity's place.

    A picture has one texture, and a text one per letter; ``None`` is a blank.
    """

    textures: tuple[str | None, ...]
    width_m: float
    height_m: float
    depth_m: float = 0.05


@dataclass(frozen=True, slots=True)
class ShadowLook:
    """The shadow on the ground around an entity that stands there: half of the light, and a quarter at its rim."""

    radius_m: float


Look = BoxLook | MeshLook | FrameLook | ShadowLook


@dataclass(frozen=True, slots=True)
class Light:
    """A distant light, like the sun, and the ambient light.

    ``towards`` points from the world to the light, at any length. Miniworld intends a lamp at ``light_pos``, but passes
    OpenGL three numbers instead of four. The result is a light in the direction ``light_pos + (1, 1, 1)``, which a
    world passes here. A fifth of white is added to ``ambient``, as in OpenGL.
    """

    towards: Vector = (1.0, 3.5, 1.0)
    colour: Rgb = (0.7, 0.7, 0.7)
    ambient: Rgb = (0.45, 0.45, 0.45)


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera; positive pitch looks up, and ``fov_y_deg`` is the whole vertical field of view."""

    position: Vector
    yaw_rad: float
    pitch_rad: float = 0.0
    fov_y_deg: float = 60.0
    near_m: float = NEAR_M
    far_m: float = FAR_M

    def __post_init__(self) -> None:
        if not 0 < self.near_m < self.far_m:
            raise WorldError(f"near_m is {self.near_m} and far_m is {self.far_m}; they need 0 < near_m < far_m")
        if not 0 < self.fov_y_deg < 180:
            raise WorldError(f"fov_y_deg is {self.fov_y_deg}; it must be between 0 and 180")
        if not all(map(math.isfinite, (*self.position, self.yaw_rad, self.pitch_rad))):
            raise WorldError(
                f"the camera's position is {self.position} and its yaw {self.yaw_rad}; both must be finite"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that is visible at one moment, made by ``build_scene`` once per episode.

    Only places change from step to step: a row for each look with x, y, z and yaw_rad; NaN hides the entity.
    """

    layout: "SceneTables"  # rooms and looks as flat arrays
    places: NDArray[np.float64]  # (looks, 4)
    light: Light = Light()
    sky: Rgb = (0.25, 0.82, 1.0)
    display: bool = False  # whether to draw in the style of a participant's display, instead of Miniworld's

    def __post_init__(self) -> None:
        if self.places.shape != (self.layout.thing_count, 4):
            raise WorldError(
                f"places has the shape {self.places.shape}; {self.layout.thing_count} things need x, y, z, yaw each"
            )

    def at(self, places: NDArray[np.float64]) -> "Scene":
        """Return the scene with its entities at other places; all tables are shared."""
        return replace(self, places=places)


@dataclass(frozen=True, slots=True, eq=False)
class SceneTables:
    """A scene's tables, which do not change once they are made."""

    rooms: RoomTable
    packed_rooms: tuple[F64, I32]  # the rooms' faces, then the rooms
    packed_library: tuple[F64, I32]  # the things' faces
    things: F64  # (things, THING_SIZE)
    textures: TextureTable
    capacity: int  # the maximum number of faces in one picture
    most_corners: int  # the maximum number of corners of one face, clipped at the picture's edges

    @property
    def thing_count(self) -> int:
        """The number of entities."""
        return len(self.things)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The bounds x0, z0, x1, z1 of the whole floor plan in metres."""
        low = self.rooms.bounds.min(axis=0)
        high = self.rooms.bounds.max(axis=0)
        return float(low[0]), float(low[1]), float(high[2]), float(high[3])


def build_scene(
    rooms: Sequence[SceneRoom],
    looks: Sequence[Look] = (),
    *,
    library: Library,
    places: F64 | None = None,
    light: Light | None = None,
    sky: Rgb = (0.25, 0.82, 1.0),
) -> Scene:
    """Return a scene of rooms and entities; without places, the entities are hidden until ``Scene.at`` gives them.

    Raises:
        WorldError: if there are no rooms, an opening leads nowhere, or a texture or mesh is unknown.
    """
    if not rooms:
        raise WorldError("the scene has no rooms; give it one or more")
    return add_things(_pack_rooms(rooms, library), looks, library=library, places=places, light=light, sky=sky)


def add_things(
    tables: tuple[FaceTable, RoomTable],
    looks: Sequence[Look] = (),
    *,
    library: Library,
    places: F64 | None = None,
    light: Light | None = None,
    sky: Rgb = (0.25, 0.82, 1.0),
    display: bool = False,
) -> Scene:
    """Return a scene of rooms and entities; ``tables`` are the rooms' faces and the rooms.

    Without places, the entities are hidden until ``Scene.at`` gives them.
    """
    faces, room_table = tables
    thing_faces, things = _pack_things(looks, library)
    face_floats, face_wholes = packed_faces(faces)
    room_floats, room_wholes = packed_rooms(room_table)
    layout = SceneTables(
        room_table,
        (np.concatenate([face_floats, room_floats]), np.concatenate([face_wholes, room_wholes])),
        library.packed if thing_faces is library.faces else packed_faces(thing_faces),
        things,
        library.textures,
        capacity=len(faces.texture) + int(np.sum(things[:, LAST] - things[:, FIRST])) + 6 * len(looks) + 2,
        most_corners=_count_most_corners(faces, thing_faces, things) + 8,
    )
    if places is None:
        place_table = np.full((len(looks), 4), np.nan)
    else:
        place_table = places
    return Scene(layout, place_table, light if light is not None else Light(), sky, display)


def _count_most_corners(faces: FaceTable, thing_faces: FaceTable, things: F64) -> int:
    """Return the largest number of corners of a face in the rooms or of a thing, at least four."""
    counts = np.diff(thing_faces.start)
    counts_by_thing = [counts[first:last] for first, last in things[:, (FIRST, LAST)].astype(int).tolist()]
    return int(max(4, *(face_counts.max(initial=0) for face_counts in (np.diff(faces.start), *counts_by_thing))))


def _pack_rooms(rooms: Sequence[SceneRoom], library: Library) -> tuple[FaceTable, RoomTable]:
    """Return the tables of the rooms' faces and of the rooms; raise a WorldError if an opening leads nowhere."""
    polygons = []
    texture_places = []
    texture_rows = []
    first_face = [0]
    edges = []
    first_edge = [0]
    bounds = []
    opening_corners = []
    opening_into = []
    first_opening = [0]
    for room in rooms:
        for surface in room.surfaces:
            polygons.append(surface.corners)
            texture_places.append(surface.texture_m / np.array(library.texture_size_m(surface.texture)))
            texture_rows.append(library.texture_row(surface.texture))
        for opening in room.openings:
            if not 0 <= opening.into < len(rooms):
                raise WorldError(f"an opening leads into room {opening.into}; rooms are 0 to {len(rooms) - 1}")
            opening_corners.append(opening.corners)
            opening_into.append(opening.into)
        edges.append(_edge_lines(room.outline))
        bounds.append([*room.outline.min(axis=0), *room.outline.max(axis=0)])
        first_face.append(len(polygons))
        first_edge.append(first_edge[-1] + len(room.outline))
        first_opening.append(len(opening_corners))
    table = RoomTable(
        np.array(first_face, np.int32),
        np.array(bounds),
        np.array(first_edge, np.int32),
        np.concatenate(edges),
        np.array(first_opening, np.int32),
        np.array(opening_corners).reshape(-1, 4, 3),
        np.array(opening_into, np.int32),
        np.array([room.roofed for room in rooms]),
    )
    return pack(polygons, texture_places, texture_rows), table


def _edge_lines(outline: F64) -> F64:
    """Return the lines of an outline's edges, (edges, 3) a, b, c: a*x + b*z + c is the distance, above 0 inside."""
    following = np.roll(outline, -1, axis=0)
    along = following - outline
    along /= np.sqrt(np.sum(along * along, axis=1, keepdims=True))
    # the inside of a counter-clockwise outline (x right, z down the page) is on the left of its edges
    a = along[:, 1]
    b = -along[:, 0]
    return np.column_stack([a, b, -(a * outline[:, 0] + b * outline[:, 1])])


def _pack_things(looks: Sequence[Look], library: Library) -> tuple[FaceTable, F64]:
    """Return the faces of the library, followed by those of frames; and a row of `kernel_tables` for each entity."""
    rows = []
    frames = []
    for index, look in enumerate(looks):
        if isinstance(look, FrameLook):
            frames.append((index, _frame_faces(look, library)))
        rows.append(_thing_row(look, library))
    faces = library.faces
    things = np.array(rows, np.float64).reshape(-1, THING_SIZE)
    for index, frame in frames:
        things[index, FIRST] = len(faces.texture)
        faces = join(faces, frame)
        things[index, LAST] = len(faces.texture)
    return faces, things


def _thing_row(look: Look, library: Library) -> tuple[float, ...]:
    """Return an entity's row of the things' table; a frame's range of faces is 0 to 0 until they are added."""
    match look:
        case BoxLook(size, colour):
            around = float(np.hypot(size[0], size[2])) / 2
            reach = float(np.hypot(around, size[1]))
            box = size[0] / 2, 0.0, size[1], size[2] / 2
            return *library.mesh_faces(CUBE), *size, 1.0, *colour, around, reach, *box
        case MeshLook(mesh, height_m, tint):
            faces = library.mesh_faces(mesh)
            scale, normal_scale = library.mesh_scale(mesh, height_m)
            extents = (scale * extent for extent in (*library.mesh_reach(mesh), *library.mesh_box(mesh)))
            return *faces, scale, scale, scale, normal_scale, *tint, *extents
        case FrameLook():
            around = float(np.hypot(look.width_m / 2, look.depth_m))
            reach = float(np.hypot(around, look.height_m / 2))
            box = look.depth_m, -look.height_m / 2, look.height_m / 2, look.width_m / 2
            return 0, 0, *(1.0,) * 7, around, reach, *box
        case ShadowLook(radius_m):
            reach = radius_m * SHADOW_REACH
            return *SHADOW_FACES, radius_m, 1.0, radius_m, 1.0, 0.0, 0.0, 0.0, reach, reach, reach, 0.0, 0.0, reach


def _frame_faces(look: FrameLook, library: Library) -> FaceTable:
    """Return the faces of a frame that faces +x: one square per texture from left to right, and four black edges."""
    half_width = look.width_m / 2
    half_height = look.height_m / 2
    depth = look.depth_m
    whole_texture = np.array([[1.0, 1.0], [0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    polygons = []
    texture_rows = []
    step = look.width_m / len(look.textures)
    for index, name in enumerate(look.textures):
        left = half_width - index * step
        right = left - step
        y = half_height
        polygons.append(np.array([[depth, y, right], [depth, y, left], [depth, -y, left], [depth, -y, right]]))
        texture_rows.append(-1 if name is None else library.texture_row(name))
    y = half_height
    z = half_width
    edges = [
        [[0, y, -z], [depth, y, -z], [depth, -y, -z], [0, -y, -z]],
        [[depth, y, z], [0, y, z], [0, -y, z], [depth, -y, z]],
        [[depth, y, z], [depth, y, -z], [0, y, -z], [0, y, z]],
        [[depth, -y, -z], [depth, -y, z], [0, -y, z], [0, -y, -z]],
    ]
    polygons += [np.array(edge, np.float64) for edge in edges]
    texture_rows += [-1] * 4
    faces = pack(polygons, [whole_texture] * len(polygons), texture_rows)
    faces.colour[-4:] = 0.0  # black
    return faces
