"""The state of an episode in a building: where bodies stand, what stops them, and the heights that follow from that."""

import math

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Entity, Length, Position
from minihuman.worlds.first_person.heights.footing import (
    Footing,
    Walker,
    can_float_at,
    find_solids,
    has_headroom,
    push_from_walls,
    room_below,
    trace_move,
)
from minihuman.worlds.first_person.heights.plan import SectorPlan, finish_sector_plan
from minihuman.worlds.first_person.heights.sectors import Sector, connect_sectors, open_hole
from minihuman.worlds.first_person.parameters import Parameters, uniform, weighted
from minihuman.worlds.first_person.rooms import OpeningLimits, Room, check_convex
from minihuman.worlds.first_person.state import WALL, WorldState

_MOST_TRIES = 100_000


class BuildingState(WorldState):
    """The state of one episode in a building.

    An entity's height is that of the floor under it; `pos` holds it, and a step derives it anew.

    Args:
        rng: the random stream of the episode.
        parameters: step length, turn, camera and light.
        randomised: whether parameters are drawn from their ranges.
        step_height: the highest step that a body climbs, metres.
        fall_height: the deepest edge over which a body goes, metres.
    """

    has_heights = True

    def __init__(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        *,
        randomised: bool,
        step_height: float,
        fall_height: float,
    ) -> None:
        super().__init__(rng, parameters, randomised=randomised)
        self.step_height = step_height
        self.fall_height = fall_height
        self._plan: SectorPlan | None = None
        self._standing: tuple[Position, int] | None = None  # the agent's last position, and the sector that carries it

    @property
    def floor(self) -> SectorPlan:  # type: ignore[override]  # has what the flat plan's callers read
        """Return the plan, which is finished when it is first read."""
        return self.close_floor_plan()

    def close_floor_plan(self) -> SectorPlan:  # type: ignore[override]
        """Finish the plan, so that no more rooms can be added, unless it is finished already; return it.

        Raises:
            WorldError: if there is no room, or two rooms overlap.
        """
        if self._plan is None:
            self._plan = finish_sector_plan([room for room in self._rooms if isinstance(room, Sector)], self.varying)
        return self._plan

    def add_room(self, room: Room) -> Room:
        """Add a room to the plan as its next sector, number it, and return it.

        Raises:
            WorldError: if its outline is not convex and counter-clockwise, or an entity has been placed already.
        """
        check_convex(room.outline)
        self._check_open()
        room.number = len(self._rooms)
        self._rooms.append(room)
        return room

    def connect_sectors(
        self, a: Sector, b: Sector, limits: OpeningLimits, *, min_y: float | None, max_y: float | None
    ) -> None:
        """Open the walls with which two sectors face each other, and add a passage if there is a gap between them.

        The arguments are those of `sectors.connect_sectors`.

        Raises:
            WorldError: if the walls or heights do not permit the opening, or the plan is finished already.
        """
        self._check_open()
        gap_room = connect_sectors(a, b, limits, min_y=min_y, max_y=max_y, number=len(self._rooms))
        if gap_room is not None:
            self._rooms.append(gap_room)

    def open_hole(self, upper: Sector, lower: Sector, hole: tuple[float, float, float, float]) -> None:
        """Cut a hole (min_x, min_z, max_x, max_z) into the floor of one sector and the ceiling of the one below.

        Raises:
            WorldError: if the hole does not fit the two, or the plan is finished already.
        """
        self._check_open()
        open_hole(upper, lower, hole)

    def place(
        self,
        entity: Entity,
        *,
        room: Room | None,
        dir: float | None,
        x: tuple[float | None, float | None],
        z: tuple[float | None, float | None],
    ) -> None:
        """Place an entity where it touches nothing, at a uniformly random position.

        Without a room, one is drawn by floor area. The ranges ``x`` and ``z`` limit the position; an end that is None
        is that of the room. The heading ``dir`` is in radians; None for a random one.

        Raises:
            WorldError: if no free position is found.
        """
        plan = self.floor
        radius = float(entity.radius)
        for _ in range(_MOST_TRIES):
            number = weighted(self.rng, plan.room_weights) if room is None else room.number
            outline = plan.rooms[number].outline
            at_x = uniform(
                self.rng,
                (outline.min_x if x[0] is None else x[0]) - radius,
                (outline.max_x if x[1] is None else x[1]) + radius,
            )
            at_z = uniform(
                self.rng,
                (outline.min_z if z[0] is None else z[0]) - radius,
                (outline.max_z if z[1] is None else z[1]) + radius,
            )
            if outline.contains(at_x, at_z) and self._stands_free(entity, number, at_x, at_z):
                break
        else:
            raise WorldError(f"no free place for {entity.name} (radius {entity.radius:.2f} m); make the room larger")
        super().put(entity, (at_x, plan.rooms[number].floor_plane.at(at_x, at_z), at_z), dir)

    def put(self, entity: Entity, pos: Position, dir: float | None) -> None:
        """Place an entity at an exact position, whatever it touches; the agent stands on the floor at or below it.

        Raises:
            WorldError: if there is no floor below the agent.
        """
        if entity is self.agent:
            x, y, z = pos
            room = room_below(self.floor, x, z, y)
            if room is None:
                raise WorldError(
                    f"there is no floor at or below (x {x:g}, y {y:g}, z {z:g}); place the agent in a room"
                )
            pos = (x, self.floor.rooms[room].floor_plane.at(x, z), z)
        super().put(entity, pos, dir)

    @property
    def agent_room(self) -> int:
        """Return the number of the sector in which the agent stands.

        Raises:
            WorldError: if there is no floor below it.
        """
        pos = self.agent.pos
        if self._standing is not None and self._standing[0] is pos:
            return self._standing[1]
        room = room_below(self.floor, pos[0], pos[2], pos[1])
        if room is None:
            raise WorldError(f"there is no floor at or below the agent's position {pos}; place it in a room")
        self._standing = (pos, room)
        return room

    def body_of(self, entity: Entity, radius: Length | None = None) -> Walker:
        """Return an entity's radius, or ``radius`` if given, its height, and the heights of steps that it takes."""
        return Walker(
            float(entity.radius if radius is None else radius), float(entity.height), self.step_height, self.fall_height
        )

    def blocker(self, entity: Entity, x: float, z: float, radius: Length) -> Entity | str | None:
        """Return what an entity of a radius would touch if it went to (x, z): WALL, another entity, or None."""
        arrival = self._arrive(entity, x, z, radius)
        if arrival is None:
            return WALL
        floor = self.floor.rooms[arrival.room].floor_plane.at(x, z)
        return self._touched(entity, x, floor, z, radius)

    def find_place(self, entity: Entity, x: float, z: float) -> Position | None:
        """Return the position of an entity that goes to (x, z), with y on the floor there; None if it cannot go."""
        arrival = self._arrive(entity, x, z, entity.radius)
        if arrival is None:
            return None
        if arrival.fell:
            landed = push_from_walls(self.floor, arrival.room, x, z, self.body_of(entity))
            if landed is None:
                return None
            x, z = landed
        pos = (x, self.floor.rooms[arrival.room].floor_plane.at(x, z), z)
        if self._touched(entity, *pos, entity.radius) is not None:
            return None
        return pos

    def solid_walls(self, entity: Entity, x: float, z: float) -> NDArray[np.float64]:
        """Return the walls, float64[n, 4] with x0, z0, x1, z1, that stop an entity which moves to (x, z)."""
        body = self.body_of(entity)
        room = self._room_of(entity)
        arrival = trace_move(self.floor, room, (entity.pos[0], entity.pos[2]), (x, z), body)
        rows = list(find_solids(self.floor, room if arrival is None else arrival.room, x, z, body))
        return np.array(rows, np.float64).reshape(-1, 4)

    def is_beside(self, entity: Entity, other: Entity) -> bool:
        """Return whether two entities overlap in height, so that they stop each other where they meet."""
        return other is not entity and self._at_common_height(entity.pos[1], entity.pos[1] + entity.height, other)

    def load_fits(self, load: Entity, x: float, y: float, z: float) -> bool:
        """Return whether what the agent carries overlaps nothing at a position."""
        if not can_float_at(self.floor, x, z, y, y + load.height, float(load.radius)):
            return False
        return self._touched(load, x, y, z, load.radius) is None

    def shadow_height(self, pos: Position) -> float:
        """Return the height at which the shadow of a thing at a position lies; NaN if it is not on the floor."""
        return pos[1] if pos[1] == self.floor_below(pos) else math.nan

    def floor_below(self, pos: Position) -> float | None:
        """Return the height of the floor at or below a position; None if there is none."""
        room = room_below(self.floor, pos[0], pos[2], pos[1])
        if room is None:
            return None
        return self.floor.rooms[room].floor_plane.at(pos[0], pos[2])

    def _room_of(self, entity: Entity) -> int:
        """Return the number of the sector in which an entity stands; raise a WorldError if no floor is below it."""
        if entity is self.agent:
            return self.agent_room
        room = room_below(self.floor, entity.pos[0], entity.pos[2], entity.pos[1])
        if room is None:
            raise WorldError(f"there is no floor at or below {entity!r}; place it in a room")
        return room

    def _arrive(self, entity: Entity, x: float, z: float, radius: Length) -> Footing | None:
        """Return where an entity stands after going to a place; None if a wall, an edge or a low ceiling stops it."""
        plan = self.floor
        body = self.body_of(entity, radius)
        arrival = trace_move(plan, self._room_of(entity), (entity.pos[0], entity.pos[2]), (x, z), body)
        if arrival is None or not has_headroom(plan, arrival.room, x, z, body.height):
            return None
        if arrival.fell:  # it is pushed from the walls where it lands
            return arrival
        if next(find_solids(plan, arrival.room, x, z, body), None) is not None:
            return None
        return arrival

    def _stands_free(self, entity: Entity, room: int, x: float, z: float) -> bool:
        """Return whether an entity that stands at a place of a sector would touch nothing."""
        plan = self.floor
        sector = plan.rooms[room]
        body = self.body_of(entity)._replace(fall=0.0)
        if not has_headroom(plan, room, x, z, body.height) or any(hole.contains(x, z) for hole in sector.floor_holes):
            return False
        if next(find_solids(plan, room, x, z, body), None) is not None:
            return False
        return self._touched(entity, x, sector.floor_plane.at(x, z), z, entity.radius) is None

    def _touched(self, entity: Entity, x: float, y: float, z: float, radius: Length) -> Entity | None:
        """Return the first other entity that an entity would overlap at (x, y, z); None if it would overlap none."""
        for obstacle in self.entities:
            if obstacle is entity or not self._at_common_height(y, y + entity.height, obstacle):
                continue
            dx = obstacle.pos[0] - x
            dz = obstacle.pos[2] - z
            if math.sqrt(dx * dx + dz * dz) < float(radius + obstacle.radius):
                return obstacle
        return None

    def _at_common_height(self, bottom: float, top: float, entity: Entity) -> bool:
        """Return whether a part of an entity lies between the heights ``bottom`` and ``top``, in metres."""
        return entity.pos[1] < top and bottom < entity.pos[1] + entity.height
