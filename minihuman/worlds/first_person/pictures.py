"""Pictures of a first-person state: the agent's view, its depth, and the world from above.

The module turns the state into the scene that the renderer draws.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import rgb_of
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.first_person.entities import Box, ColouredMesh, Entity, ImageFrame, Mesh, Position, TextFrame
from minihuman.worlds.first_person.render.asset_files import asset_library, library_lock
from minihuman.worlds.first_person.render.assets import Library
from minihuman.worlds.first_person.render.drawing import RenderTarget, render_depth, render_top, turn, visible_things
from minihuman.worlds.first_person.render.kernel_tables import F64, I64, FaceTable, RoomTable
from minihuman.worlds.first_person.render.scene import (
    FAR_M,
    NEAR_M,
    BoxLook,
    Camera,
    FrameLook,
    Light,
    Look,
    MeshLook,
    Scene,
    ShadowLook,
    add_things,
)
from minihuman.worlds.first_person.render.shading import JOINT_M
from minihuman.worlds.first_person.rooms import FloorPlan, RoomPlan
from minihuman.worlds.first_person.state import WorldState
from minihuman.worlds.first_person.walls import CEILING, corners_of, room_faces, room_occluders
from minihuman.worlds.pose import Pose

GONE = (np.nan,) * 4
_SHADOW_SHARE = 0.7  # the radius of a shadow, as a share of its entity's
_SHADOW_SHARES: dict[type[Entity], float] = {Box: 1.1, ImageFrame: 0.0, TextFrame: 0.0}  # for kinds that differ


def build_light(stage: WorldState) -> Light:
    """Return the light of an episode, which shines from where Miniworld's does; see `Light`."""
    x, y, z = stage.light_pos
    return Light((x + 1, y + 1, z + 1), stage.light_colour, stage.light_ambient)


def entity_places(stage: WorldState, things: Sequence[Entity]) -> NDArray[np.float64]:
    """Return the present places of entities, (n, 4) x, y, z, yaw_rad; NaN for an entity that was removed."""
    present = set(map(id, stage.entities))
    rows = [(*thing.pos, thing.dir) if id(thing) in present else GONE for thing in things]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def shadow_places(stage: WorldState, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places of entities' shadows, below the entities at ``places``; both are (n, 4) x, y, z, yaw_rad.

    A row is NaN for an entity that is not on the ground.
    """
    heights = np.array([stage.shadow_height((x, y, z)) for x, y, z in places[:, :3].tolist()], np.float64)
    below = np.where(np.isnan(heights)[:, None], np.nan, places)
    below[:, 1] = heights
    return below


def build_shadow(thing: Entity) -> ShadowLook:
    """Return an entity's shadow; frames have none.

    A box's shadow surrounds its corners, and those of other entities are narrower than their radius.
    """
    share = _SHADOW_SHARES.get(type(thing), _SHADOW_SHARE)
    return ShadowLook(share * float(thing.radius))


def room_tables(floor: FloorPlan, library: Library, *, display: bool = False) -> tuple[FaceTable, RoomTable]:
    """Return the renderer's tables of a floor plan's rooms: floors, ceilings, pieces of wall, and openings.

    For a ``display``, they also have the occluders that darken the rooms' corners.
    """
    edges = floor.edges
    first = floor.first_edge
    heights = np.array([room.wall_height for room in floor.rooms])
    textures, sizes_m = _coverings(floor, library)
    faces, first_face = room_faces(first, edges, heights, floor.pieces, textures, sizes_m)
    shades: tuple[NDArray[Any], ...]
    if display:
        shades = room_occluders(first, edges, heights, floor.pieces, textures, sizes_m, JOINT_M)
    else:
        shades = ()
    doors = floor.portals[floor.portals[:, 5] >= 0]  # those that lead into a room
    x, z = edges[:, :2].T
    a, b = edges[:, 5:].T  # the normals, into the rooms
    bounds = [extreme.reduceat(corner, first[:-1]) for extreme in (np.minimum, np.maximum) for corner in (x, z)]
    return faces, RoomTable(
        first_face,
        np.column_stack(bounds),
        first.astype(np.int32),
        np.column_stack((a, b, -(a * x + b * z))),
        np.searchsorted(doors[:, 0], first).astype(np.int32),
        corners_of(edges, doors),
        doors[:, 5].astype(np.int32),
        textures[:, CEILING] >= 0,
        *shades,
    )


def _coverings(floor: FloorPlan, library: Library) -> tuple[I64, F64]:
    """Return the row of each room's textures, int64[rooms, 3], and the metres that each covers, float64[rooms, 3, 2].

    The textures are those of floor, wall and ceiling; the row of a missing ceiling is -1. The metres are right and up.
    """
    coverings = [_covering(room) for room in floor.rooms]
    rows: list[list[int]] = []
    sizes_m: list[list[tuple[float, float]]] = []
    number_by_covering: dict[tuple[str | None, ...], int] = {}
    for names in dict.fromkeys(coverings):  # rooms covered alike share a row
        number_by_covering[names] = len(rows)
        rows.append([-1 if name is None else library.texture_row(name) for name in names])
        sizes_m.append([(1.0, 1.0) if name is None else library.texture_size_m(name) for name in names])
    numbers = [number_by_covering[names] for names in coverings]
    return np.array(rows)[numbers], np.array(sizes_m)[numbers]


def _covering(room: RoomPlan) -> tuple[str | None, ...]:
    """Return the names of the textures of a room's floor, wall and ceiling; for the ceiling, None without one."""
    wall_number, floor_number, ceiling_number = room.pictures
    if room.ceiling is None:
        ceiling = None
    else:
        ceiling = name_texture(room.ceiling, ceiling_number)
    return name_texture(room.floor, floor_number), name_texture(room.wall, wall_number), ceiling


def name_texture(texture: str, number: int) -> str:
    """Return the name of one picture of a texture, numbered from 0."""
    return f"{texture}_{number + 1}"


def build_look(thing: Entity, palette: Palette, library: Library) -> Look:
    """Return the look of an entity; only built-in balls and keys exist in the colours of every palette.

    Raises:
        WorldError: if the entity is of a kind that cannot be drawn.
    """
    match thing:
        case Box():
            return BoxLook(thing.size, thing.rgb if palette == "classic" else rgb_of(thing.colour_name, palette))
        case ColouredMesh() if palette != "classic" and not library.brings(thing.mesh):
            return MeshLook(f"{thing.kind}_white", thing.height, rgb_of(thing.colour_name, palette))
        case Mesh():
            return MeshLook(thing.mesh, thing.height)
        case ImageFrame():
            return FrameLook((name_texture(thing.texture, 0),), thing.width, thing.height, thing.depth)
        case TextFrame():
            letters = tuple(
                None if texture is None else name_texture(texture, number)
                for texture, number in zip(thing.textures, thing.variants, strict=True)
            )
            return FrameLook(letters, thing.width, thing.height, thing.depth)
        case _:
            raise WorldError(f"{thing!r} is a {type(thing).__name__}, which cannot be drawn; use a box, mesh or frame")


_MAX_TARGETS = 8  # render targets in the cache, by palette and size; resizing a window passes through many sizes


RoomTables = Callable[..., tuple[FaceTable, RoomTable]]  # takes a plan, a library, and whether they are for a display


class WorldRenderer:
    """The renderer of one world, which keeps the scene between steps; a copy of a world starts without a scene."""

    def __init__(
        self,
        size_px: tuple[int, int],
        assets: str | None,
        *,
        shadows: bool = False,
        display: bool = False,
        tables: RoomTables = room_tables,
    ) -> None:
        self.tables = tables  # turns a plan into the tables of its rooms
        self.display = display  # whether pictures have the look of a display
        self.shadows = shadows and not display  # whether things cast shadows on the ground
        self.size_px = size_px  # width and height of an observation
        self.assets = assets  # a folder of textures and meshes in addition to our own; None: only our own
        self._floor: FloorPlan | None = None
        self._rooms: tuple[FaceTable, RoomTable]  # the tables of that floor
        self._staged: dict[Palette, tuple[WorldState, list[Entity], Scene]] = {}
        self._targets: dict[tuple[Palette, tuple[int, int]], _Observed] = {}  # for the agent's view

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(WorldRenderer, shadows=self.shadows, display=self.display, tables=self.tables), (
            self.size_px,
            self.assets,
        )

    def forget(self) -> None:
        """Discard the scene, so that the next picture shows the whole state as it then is."""
        self._staged.clear()
        self._targets.clear()

    def measure(self, entity: Entity) -> None:
        """Set the width of an entity whose mesh is in the world's folder.

        Raises:
            WorldError: if there is no such mesh.
        """
        if isinstance(entity, Mesh) and math.isnan(entity.radius):
            with library_lock:
                entity.measure(*asset_library(self.assets).mesh_extents(entity.mesh))

    def observation(self, stage: WorldState, out: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        """Return the agent's view in the size of an observation, uint8[H, W, 3], drawn into ``out`` if given."""
        return self.aim_target(stage).draw(out)

    def aim_target(
        self, stage: WorldState, palette: Palette = "classic", size_px: tuple[int, int] | None = None
    ) -> RenderTarget:
        """Return the render target of the agent's view with all entities in place, by default in observation size."""
        key = palette, size_px or self.size_px
        observed = self._targets.get(key)
        if observed is None or observed.stage is not stage or observed.entities != stage.entities:
            build_camera(stage)  # raises an error if the camera is invalid
            target = RenderTarget(self.scene(stage, palette), *key[1], trig=stage.agent.trig)
            if len(self._targets) == _MAX_TARGETS:
                self._targets.clear()
            observed = _Observed(stage, self._staged[palette][1], target, shadows=self.shadows)
            self._targets[key] = observed
        return observed.aim_target()

    def draw(self, stage: WorldState, *, view: View, size_px: tuple[int, int], palette: Palette) -> NDArray[np.uint8]:
        """Return the agent's view, or the world from above with the agent in it, as uint8[H, W, 3].

        Raises:
            WorldError: if a side of ``size_px`` (width, height) is below 1 or too long.
        """
        if min(size_px) < 1:
            raise WorldError(f"a picture cannot be {size_px[0]} x {size_px[1]} pixels; each side must be 1 or more")
        if view == "partial":
            return self.aim_target(stage, palette, (size_px[0], size_px[1])).draw()
        return render_top(self.scene(stage, palette), *size_px, agent=Pose(*stage.agent.pos, stage.agent.dir))

    def draw_part(
        self,
        stage: WorldState,
        tables: Callable[[Library], tuple[FaceTable, RoomTable]],
        things: Sequence[Entity],
        size_px: tuple[int, int],
        palette: Palette,
        *,
        shows_agent: bool,
    ) -> NDArray[np.uint8]:
        """Return a part of the world from above, as uint8[H, W, 3] of the size ``size_px`` (width, height).

        It shows the rooms whose tables the function ``tables`` returns for a library, the entities ``things``, and the
        agent if ``shows_agent``.
        """
        library = asset_library(self.assets)
        with library_lock:
            scene = add_things(
                tables(library),
                [build_look(thing, palette, library) for thing in things],
                library=library,
                places=entity_places(stage, things),
                light=build_light(stage),
                sky=stage.sky_colour,
                display=self.display,
            )
        agent = Pose(*stage.agent.pos, stage.agent.dir) if shows_agent else None
        return render_top(scene, *size_px, agent=agent)

    def depth(self, stage: WorldState, *, size_px: tuple[int, int]) -> NDArray[np.float32]:
        """Return the depth of the agent's view in metres along its axis, float32[H, W]."""
        return render_depth(self.scene(stage), build_camera(stage), *size_px)

    def staged(
        self, stage: WorldState, palette: Palette, size_px: tuple[int, int]
    ) -> tuple[Sequence[Entity], RenderTarget]:
        """Return the entities of the scene, including removed ones, and the render target of the agent's view."""
        target = self.aim_target(stage, palette, size_px)
        return self._staged[palette][1], target

    def visible(self, stage: WorldState) -> list[Entity]:
        """Return the entities in the agent's view, in the order in which they were placed."""
        scene = self.scene(stage)
        things = self._staged["classic"][1]
        numbers = visible_things(scene, build_camera(stage), *self.size_px)
        # numbers from len(things) are those of shadows
        visible_ids = {id(things[number]) for number in numbers if number < len(things)}
        return [entity for entity in stage.entities if id(entity) in visible_ids]

    def scene(self, stage: WorldState, palette: Palette = "classic") -> Scene:
        """Return the scene, built anew for a new state or a new entity, and otherwise with its entities moved."""
        if self._floor is not stage.floor:
            with library_lock:
                rooms = self.tables(stage.floor, asset_library(self.assets), display=self.display)
            self._floor = stage.floor
            self._rooms = rooms
            self._staged = {}
        staged = self._staged.get(palette)
        things = [entity for entity in stage.entities if entity is not stage.agent]
        if staged is not None and staged[0] is stage and set(map(id, things)) <= set(map(id, staged[1])):
            things = staged[1]
            scene = staged[2].at(self._places(stage, staged[1]))
        else:
            looks = [build_look(thing, palette, asset_library(self.assets)) for thing in things]
            looks += map(build_shadow, things) if self.shadows else ()
            with library_lock:
                scene = add_things(
                    self._rooms,
                    looks,
                    library=asset_library(self.assets),
                    places=self._places(stage, things),
                    light=build_light(stage),
                    sky=stage.sky_colour,
                    display=self.display,
                )
        self._staged[palette] = stage, things, scene
        return scene

    def _places(self, stage: WorldState, things: Sequence[Entity]) -> NDArray[np.float64]:
        """Return the places of entities, followed by those of their shadows if shadows are drawn."""
        table = entity_places(stage, things)
        if self.shadows:
            return np.concatenate([table, shadow_places(stage, table)])
        return table


class _Observed:
    """The render target of a state whose set of entities is constant, with their places when it was last aimed."""

    def __init__(self, stage: WorldState, things: Sequence[Entity], target: RenderTarget, *, shadows: bool) -> None:
        self.stage = stage
        self.entities = list(stage.entities)
        self._target = target
        self._shadows = len(things) if shadows else 0  # the number of the first shadow; 0 without shadows
        self._things = [(number, thing) for number, thing in enumerate(things) if thing in self.entities]
        self._places = [(thing.pos, thing.dir) for _, thing in self._things]

    def aim_target(self) -> RenderTarget:
        """Move the target's entities to their present places, aim its camera, and return it."""
        for nth, (number, thing) in enumerate(self._things):
            pos, yaw_rad = self._places[nth]
            if thing.pos is not pos or thing.dir != yaw_rad:
                self._places[nth] = thing.pos, thing.dir
                self._target.move(number, thing.pos, thing.dir)
                if self._shadows:
                    x, y, z, yaw = shadow_places(self.stage, np.array([(*thing.pos, thing.dir)]))[0].tolist()
                    self._target.move(number + self._shadows, (x, y, z), yaw)
        agent = self.stage.agent
        x, y, z = agent.pos
        yaw_rad = agent.dir
        ahead = agent.cam_fwd_disp
        cos_yaw, sin_yaw = turn(yaw_rad, agent.trig)
        eye = x + ahead * cos_yaw, y + agent.cam_height, z - ahead * sin_yaw
        pitch_rad = agent.cam_pitch * (math.pi / 180)
        self._target.aim(eye, yaw_rad, pitch_rad, agent.cam_fov_y, NEAR_M, FAR_M)
        return self._target


def build_camera(stage: WorldState, pos: Position | None = None, yaw_rad: float | None = None) -> Camera:
    """Return the agent's camera, as if the agent had another position or heading if these are given."""
    agent = stage.agent
    x, y, z = agent.pos if pos is None else pos
    yaw = agent.dir if yaw_rad is None else yaw_rad
    position = (x + agent.cam_fwd_disp * math.cos(yaw), y + agent.cam_height, z - agent.cam_fwd_disp * math.sin(yaw))
    return Camera(position, yaw, agent.cam_pitch * (math.pi / 180), agent.cam_fov_y)
