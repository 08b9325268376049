"""BuildingEnv: a first-person world with heights, as a Gymnasium environment.

A subclass adds rooms at heights, stairs, ramps, balconies and holes in `build`. Flat worlds share neither its state nor
its rules: it is stepped in Python, and only the reward is judged by their kernels.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import UNKNOWN_BOUNDS, Palette, PathLengthBounds, View
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.heights.actions import act
from minihuman.worlds.first_person.heights.flights import FlightLooks, build_ramp, build_stairs
from minihuman.worlds.first_person.heights.floors import building_map, check_reach, draw_floor
from minihuman.worlds.first_person.heights.planes import Plane
from minihuman.worlds.first_person.heights.planner import least_steps, plan
from minihuman.worlds.first_person.heights.sectors import Flight, Sector
from minihuman.worlds.first_person.heights.sliding import approach_velocity, limit_length, slide, turn_body, walk
from minihuman.worlds.first_person.heights.state import BuildingState
from minihuman.worlds.first_person.heights.surfaces import building_tables
from minihuman.worlds.first_person.motion import Command
from minihuman.worlds.first_person.motion_kernels import RADIANS
from minihuman.worlds.first_person.rooms import (
    WALL_HEIGHT,
    OpeningLimits,
    Point,
    Room,
    RoomOutline,
    outline_of,
    rectangle,
)
from minihuman.worlds.first_person.rules import ACTIONS, GOAL
from minihuman.worlds.first_person.state import MOTION_PARAMETERS
from minihuman.worlds.pose import Map


class BuildingEnv(FirstPersonEnv):
    """The base class of first-person worlds with heights.

    A body stands on the floor under its middle. It climbs steps of at most ``step_height`` metres, up and down, and an
    edge that is deeper stops it, unless ``fall_height`` lets it fall so far.
    """

    step_height: ClassVar[float] = 0.3
    fall_height: ClassVar[float] = 0.0
    room_tables = staticmethod(building_tables)

    @property
    def is_compiled(self) -> bool:
        """Return False: no kernel steps a body over heights, so a server draws the world for a page."""
        return False

    @property
    def stage(self) -> BuildingState:
        """Return the state of the episode.

        Raises:
            WorldError: before the first reset.
        """
        stage = super().stage
        assert isinstance(stage, BuildingState)
        return stage

    @property
    def floor_levels(self) -> tuple[float, ...]:
        """Return the heights of the floors in metres, from below."""
        return self.stage.floor.levels

    @property
    def agent_floor(self) -> int:
        """Return the number of the floor on which the agent is, from 0."""
        return self.stage.floor.floor_at(self.agent.pos[1])

    def add_rect_room(self, *, min_x: float, max_x: float, min_z: float, max_z: float, **looks: Any) -> Sector:
        """Add a rectangular room; ``looks`` are the other arguments of ``add_room``."""
        return self.add_room(rectangle(min_x, max_x, min_z, max_z), **looks)

    def add_room(  # type: ignore[override]  # a height in place of a wall's
        self,
        outline: RoomOutline | Sequence[Point],
        *,
        floor_y: float = 0.0,
        height: float = WALL_HEIGHT,
        floor: str = "floor_tiles_bw",
        wall: str = "concrete",
        ceiling: str | None = "concrete_tiles",
        must_be_reached: bool = True,
    ) -> Sector:
        """Add a convex room with a level floor at a height, with corners (x, z), counter-clockwise as seen from above.

        Args:
            outline: the corners in metres.
            floor_y: the height of its floor.
            height: from its floor to its ceiling.
            floor: the name of a texture.
            wall: the name of a texture.
            ceiling: the name of a texture; None for a room that is open to the sky.
            must_be_reached: whether it is an error if no path leads there from the agent.

        Raises:
            WorldError: if the outline does not close, is not convex, or is clockwise, or the height is not above 0.
        """
        _check_height("floor_y", floor_y)
        level = float(floor_y) + 0.0
        sector = Sector(
            _shape_of(outline),
            *(float(height), floor, wall, ceiling),
            floor_plane=Plane(level),
            ceiling_plane=Plane(level + float(height)),
            levels=(level, level),
            must_be_reached=must_be_reached,
        )
        self.stage.add_room(sector)
        return sector

    def add_stairs(
        self,
        *,
        min_x: float,
        max_x: float,
        min_z: float,
        max_z: float,
        up: str,
        floor_y: float,
        top_y: float,
        steps: int | None = None,
        **looks: Any,
    ) -> Flight:
        """Add stairs in a rectangle, from the height ``floor_y`` up to ``top_y``.

        Args:
            min_x: the rectangle's least x.
            max_x: the rectangle's greatest x.
            min_z: the rectangle's least z.
            max_z: the rectangle's greatest z.
            up: the direction in which they rise: "east" (along x), "west", "south" (along z) or "north".
            floor_y: the height at their foot.
            top_y: the height at their head.
            steps: the number of steps up; None for the fewest steps that are at most 0.18 m high.
            looks: ``height`` up to the ceiling, and the textures ``floor``, ``wall`` and ``ceiling``.

        Raises:
            WorldError: if the stairs do not rise, or a step is higher than ``step_height``.
        """
        sides = (min_x, max_x, min_z, max_z)
        heights = (floor_y, top_y)
        return self._add_flight(
            build_stairs(sides, up, heights, steps=steps, step_height=self.step_height, looks=FlightLooks(**looks))
        )

    def add_ramp(
        self,
        *,
        min_x: float,
        max_x: float,
        min_z: float,
        max_z: float,
        up: str,
        floor_y: float,
        top_y: float,
        **looks: Any,
    ) -> Flight:
        """Add a ramp in a rectangle; the arguments are those of ``add_stairs``.

        Raises:
            WorldError: if the ramp does not rise, or is steeper than 45 degrees.
        """
        ramp = build_ramp((min_x, max_x, min_z, max_z), up, (floor_y, top_y), looks=FlightLooks(**looks))
        return self._add_flight((ramp,))

    def _add_flight(self, sectors: tuple[Sector, ...]) -> Flight:
        """Add sectors to the plan, each connected to the next one above it."""
        for sector in sectors:
            self.stage.add_room(sector)
        for below, above in pairwise(sectors):
            self.stage.connect_sectors(below, above, OpeningLimits(), min_y=None, max_y=None)
        return Flight(sectors[0], sectors[-1], sectors)

    def connect_rooms(  # type: ignore[override]  # also stairs, and openings between heights
        self,
        a: Sector | Flight,
        b: Sector | Flight,
        *,
        min_x: float | None = None,
        max_x: float | None = None,
        min_z: float | None = None,
        max_z: float | None = None,
        min_y: float | None = None,
        max_y: float | None = None,
    ) -> None:
        """Make an opening between two rooms, or a room and the near end of stairs or a ramp.

        Args:
            a: a room, stairs or a ramp.
            b: another room, other stairs or another ramp.
            min_x: where the opening begins; without limits, it is as wide as the two walls face each other.
            max_x: where it ends.
            min_z: where it begins, in a wall along z.
            max_z: where it ends, in a wall along z.
            min_y: its lowest height in the world, as of a window's sill; None for the higher of the floors.
            max_y: its greatest height in the world; None for the lower of the ceilings.

        Raises:
            WorldError: if the rooms do not face each other, or the opening does not fit their walls or heights.
        """
        first, second = _sectors_of(a, b)
        self.stage.connect_sectors(first, second, OpeningLimits(min_x, max_x, min_z, max_z), min_y=min_y, max_y=max_y)

    def add_hole(self, upper: Sector, lower: Sector, *, min_x: float, max_x: float, min_z: float, max_z: float) -> None:
        """Cut a rectangular hole into the floor of a room, and into the ceiling of the one right below it.

        Raises:
            WorldError: if it does not lie within both rooms, or they do not meet there.
        """
        self.stage.open_hole(upper, lower, (float(min_x), float(min_z), float(max_x), float(max_z)))

    def begin(self, *, seed: int | None = None) -> None:
        """Begin an episode without computing an observation.

        Raises:
            WorldError: if a room cannot be reached from the agent's; the message names it.
        """
        super().begin(seed=seed)
        check_reach(self.stage)

    def shortest_path(self) -> Sequence[int] | None:
        """Return the actions of a path to the goal of ``near_goal``; () if none is found, None with another rule."""
        rule = self.termination_rule()
        if rule.kind != GOAL:
            return None
        return plan(self, rule.things[0]) or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return bounds on the number of steps to the goal of ``near_goal``; unknown with another termination rule."""
        rule = self.termination_rule()
        if rule.kind != GOAL:
            return UNKNOWN_BOUNDS
        path = self.shortest_path()
        return PathLengthBounds(least_steps(self, rule.things[0]), len(path) if path else None)

    def map(self) -> Map:
        """Return the plan of all floors: the walls that stop a body, and all entities but the agent."""
        return building_map(self.stage)

    def picture(
        self,
        *,
        view: View = "partial",
        size_px: tuple[int, int] = (640, 480),
        palette: Palette = "classic",
        floor: int | None = None,
    ) -> NDArray[np.uint8]:
        """Return the agent's view, or one floor from above, uint8[H, W, 3] of exactly ``size_px`` (width, height).

        Args:
            view: "partial" for the agent's view, "full" for a floor from above.
            size_px: width and height.
            palette: the colours.
            floor: the number of the floor, from 0; None for the agent's.

        Raises:
            WorldError: if there is no such floor.
        """
        if view == "partial":
            return super().picture(view=view, size_px=size_px, palette=palette)
        number = self.agent_floor if floor is None else floor
        return draw_floor(self._pictures, self.stage, number, size_px, palette)

    def _new_state(self) -> BuildingState:
        return BuildingState(
            self.np_random,
            self.parameters,
            randomised=self.domain_rand,
            step_height=self.step_height,
            fall_height=self.fall_height,
        )

    def _is_free(self, number: int) -> bool:
        """Return True: no kernel does an action over heights, so `_act_freely` does all of them."""
        return True

    def _act_freely(self, action: Any, name: str) -> str:
        """Do an action with heights; return the action name from which its reward is computed."""
        if self._continuous is not None or name not in self.kernel_actions:
            return super()._act_freely(action, name)
        act(self.stage, ACTIONS.index(self.motions.get(name, name)))
        return name

    def _move_body(self, dx: float, dz: float, dyaw: float) -> bool:
        has_turned = turn_body(self.stage, dyaw)
        return slide(self.stage, dx, dz) or has_turned

    def _move_by_command(self, command: Command) -> None:
        stage = self.stage
        ahead_m, drift_m, turn_deg = (stage.parameters.number(kind, stage.varying) for kind in MOTION_PARAMETERS)
        turn_body(stage, command.turn * (turn_deg * RADIANS))
        ahead, right = limit_length(command.ahead, command.right)
        if self.acceleration:
            ahead, right = approach_velocity(self.velocity, (ahead, right), self.acceleration)
            vars(self)["velocity"] = (ahead, right)
        walk(stage, ahead * ahead_m, right * ahead_m + ahead * drift_m)

    def _use_hands(self, name: str) -> None:
        act(self.stage, ACTIONS.index(self.motions.get(name, name)))


def _shape_of(outline: RoomOutline | Sequence[Point]) -> RoomOutline:
    """Return an outline unchanged, or the outline of a sequence of corners (x, z)."""
    if isinstance(outline, RoomOutline):
        return outline
    return outline_of(tuple((float(x), float(z)) for x, z in outline))


def _sectors_of(a: Sector | Flight, b: Sector | Flight) -> tuple[Sector, Sector]:
    """Return the two sectors to connect: of stairs and ramps, the end whose height is nearer to that of the other."""
    first = a.nearest_end(_level_of(b)) if isinstance(a, Flight) else a
    second = b.nearest_end(_level_of(first)) if isinstance(b, Flight) else b
    return first, second


def _level_of(room: Room | Flight) -> float:
    """Return the height of a room's floor, or of the foot of stairs or a ramp."""
    if isinstance(room, Flight):
        return room.bottom.levels[0]
    assert isinstance(room, Sector)
    return room.levels[0]


def _check_height(name: str, height: float) -> None:
    if not math.isfinite(height):
        raise WorldError(f"{name} is {height!r}; give a height in metres")
