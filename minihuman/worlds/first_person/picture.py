"""The pictures of a stage: what the agent sees, how far away it is, the world from above. Drawing changes no state."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.first_person.building.floor import FloorPlan
from minihuman.worlds.first_person.entities import Entity, Mesh, Position
from minihuman.worlds.first_person.library import library, library_lock
from minihuman.worlds.first_person.render.draw import Easel, render_depth, render_top, visible_things
from minihuman.worlds.first_person.render.layout import furnish
from minihuman.worlds.first_person.render.scene import FAR_M, NEAR_M, Camera, Scene
from minihuman.worlds.first_person.render.tables import Faces, Rooms
from minihuman.worlds.first_person.scenery import light, look, places, room_tables, shaded, shadow
from minihuman.worlds.first_person.stage import Stage
from minihuman.worlds.pose import Pose

_MOST_EASELS = 8  # palettes and sizes; a window that is drawn larger passes many sizes


class Pictures:
    """Draws one world. It keeps the scene between steps; a copy of a world starts with nothing kept."""

    def __init__(self, size_px: tuple[int, int], assets: str | None, *, shadows: bool = False) -> None:
        self.shadows = shadows  # whether things have them, on the ground
        self.size_px = size_px  # of an observation: width, height
        self.assets = assets  # folder of textures and meshes beside our own; None: only those
        self._floor: FloorPlan | None = None
        self._rooms: tuple[Faces, Rooms]  # the floor's
        self._staged: dict[Palette, tuple[Stage, list[Entity], Scene]] = {}
        self._easels: dict[tuple[Palette, tuple[int, int]], _Observed] = {}  # where what the agent sees is drawn

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(Pictures, shadows=self.shadows), (self.size_px, self.assets)

    def measure(self, entity: Entity) -> None:
        """Say how wide a thing is whose mesh is the folder's.

        Raises:
            WorldError: if there is no such mesh.
        """
        if isinstance(entity, Mesh) and math.isnan(entity.radius):
            with library_lock:
                entity.measure(*library(self.assets).mesh_extents(entity.mesh))

    def observation(self, stage: Stage, out: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        """What the agent sees, in the size of an observation; drawn into ``out`` if there is one."""
        return self.aimed(stage).draw(out)

    def aimed(self, stage: Stage, palette: Palette = "classic", size_px: tuple[int, int] | None = None) -> Easel:
        """Where what the agent sees is drawn next, all in its place; in the size of an observation if none is given."""
        key = palette, size_px or self.size_px
        observed = self._easels.get(key)
        if observed is None or observed.stage is not stage or observed.entities != stage.entities:
            camera(stage)  # or it says what is wrong with it
            easel = Easel(self.scene(stage, palette), *key[1])
            if len(self._easels) == _MOST_EASELS:
                self._easels.clear()
            observed = _Observed(stage, self._staged[palette][1], easel, shadows=self.shadows)
            self._easels[key] = observed
        return observed.aimed()

    def draw(
        self,
        stage: Stage,
        *,
        view: View,
        size_px: tuple[int, int],
        palette: Palette,
    ) -> NDArray[np.uint8]:
        """What the agent sees, or the world from above with the agent in it."""
        if min(size_px) < 1:
            raise WorldError(f"a picture of {size_px[0]} x {size_px[1]} pixels shows nothing; both are 1 or more")
        if view == "partial":
            return self.aimed(stage, palette, (size_px[0], size_px[1])).draw()
        return render_top(self.scene(stage, palette), *size_px, agent=Pose(*stage.agent.pos, stage.agent.dir))

    def depth(self, stage: Stage, *, size_px: tuple[int, int]) -> NDArray[np.float32]:
        """How far away what the agent sees is, metres along its view."""
        return render_depth(self.scene(stage), camera(stage), *size_px)

    def visible(self, stage: Stage) -> list[Entity]:
        """The things in the agent's view, in the order they were placed."""
        scene = self.scene(stage)
        things = self._staged["classic"][1]
        numbers = visible_things(scene, camera(stage), *self.size_px)
        seen = {id(things[number]) for number in numbers if number < len(things)}  # after them come their shadows
        return [entity for entity in stage.entities if id(entity) in seen]

    def scene(self, stage: Stage, palette: Palette = "classic") -> Scene:
        """The scene now: laid out anew for a new stage or a new thing, otherwise with its things moved."""
        if self._floor is not stage.floor:
            with library_lock:
                rooms = room_tables(stage.floor, library(self.assets))
            self._floor, self._rooms, self._staged = stage.floor, rooms, {}
        kept = self._staged.get(palette)
        things = [entity for entity in stage.entities if entity is not stage.agent]
        if kept is not None and kept[0] is stage and set(map(id, things)) <= set(map(id, kept[1])):
            things, scene = kept[1], kept[2].at(self._places(stage, kept[1]))
        else:
            looks = [look(thing, palette, library(self.assets)) for thing in things]
            looks += map(shadow, things) if self.shadows else ()
            with library_lock:
                scene = furnish(
                    self._rooms,
                    looks,
                    library=library(self.assets),
                    places=self._places(stage, things),
                    light=light(stage),
                    sky=stage.sky_colour,
                )
        self._staged[palette] = stage, things, scene
        return scene

    def _places(self, stage: Stage, things: Sequence[Entity]) -> NDArray[np.float64]:
        where = places(stage, things)
        return np.concatenate([where, shaded(where)]) if self.shadows else where


class _Observed:
    """The observations of a stage on which the same things are; it knows where each was at the last one."""

    def __init__(self, stage: Stage, things: Sequence[Entity], easel: Easel, *, shadows: bool) -> None:
        self.stage = stage
        self.entities = list(stage.entities)
        self._easel = easel
        self._shadows = len(things) if shadows else 0  # where they begin
        self._things = [(number, thing) for number, thing in enumerate(things) if thing in self.entities]
        self._at = [(thing.pos, thing.dir) for _, thing in self._things]

    def aimed(self) -> Easel:
        for nth, (number, thing) in enumerate(self._things):
            pos, yaw_rad = self._at[nth]
            if thing.pos is not pos or thing.dir != yaw_rad:
                self._at[nth] = thing.pos, thing.dir
                self._easel.move(number, thing.pos, thing.dir)
                if self._shadows:
                    x, y, z, yaw = shaded(np.array([(*thing.pos, thing.dir)]))[0].tolist()
                    self._easel.move(number + self._shadows, (x, y, z), yaw)
        agent = self.stage.agent
        x, y, z = agent.pos
        yaw_rad, ahead = agent.dir, agent.cam_fwd_disp
        eye = x + ahead * math.cos(yaw_rad), y + agent.cam_height, z - ahead * math.sin(yaw_rad)
        pitch_rad = agent.cam_pitch * (math.pi / 180)
        self._easel.aim(eye, yaw_rad, pitch_rad, agent.cam_fov_y, NEAR_M, FAR_M)
        return self._easel


def camera(stage: Stage, pos: Position | None = None, yaw_rad: float | None = None) -> Camera:
    """The agent's eye, where the agent stands or as if it stood elsewhere."""
    agent = stage.agent
    x, y, z = agent.pos if pos is None else pos
    yaw = agent.dir if yaw_rad is None else yaw_rad
    position = (
        x + agent.cam_fwd_disp * math.cos(yaw),
        y + agent.cam_height,
        z - agent.cam_fwd_disp * math.sin(yaw),
    )
    return Camera(position, yaw, agent.cam_pitch * (math.pi / 180), agent.cam_fov_y)
