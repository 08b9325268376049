"""The stage: rooms, the things in them and the agent. Building a world, placing things by chance, what touches what."""

import math

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.first_person.agent import Agent
from minihuman.worlds.first_person.building.floor import FloorPlan, finish
from minihuman.worlds.first_person.building.outline import check_convex
from minihuman.worlds.first_person.building.passages import Limits, passage
from minihuman.worlds.first_person.building.rooms import Room
from minihuman.worlds.first_person.chance import uniform, weighted
from minihuman.worlds.first_person.collision import touches_wall
from minihuman.worlds.first_person.entities import Entity, Length, Position
from minihuman.worlds.first_person.parameters import Parameters

_MOST_TRIES = 100_000  # a world that needs more to place one thing has no room for it

WALL = "wall"


class Stage:
    """One episode's world. Rooms come first; the floor plan closes when the first thing is placed.

    With ``randomised``, the parameters are drawn from their ranges; otherwise they keep their defaults.
    """

    def __init__(self, rng: np.random.Generator, parameters: Parameters, *, randomised: bool) -> None:
        self.rng = rng
        self.parameters = parameters
        self.randomised = randomised
        self.agent = Agent()
        self.entities: list[Entity] = []  # the agent among them, once it is placed
        self.reach = parameters.largest("forward_step")  # the longest step, metres
        self._rooms: list[Room] = []
        self._floor: FloorPlan | None = None

    @property
    def varying(self) -> np.random.Generator | None:
        """The stream that parameters are drawn from; None where nothing varies."""
        return self.rng if self.randomised else None

    @property
    def floor(self) -> FloorPlan:
        """The floor plan; asking for it closes it."""
        if self._floor is None:
            self._floor = finish(self._rooms, self.varying)
        return self._floor

    def add_room(self, room: Room) -> Room:
        """Add a room to the floor plan.

        Raises:
            WorldError: if its outline is not convex and counter-clockwise, or a thing was placed already.
        """
        check_convex(room.outline)
        self._check_open()
        room.number = len(self._rooms)
        self._rooms.append(room)
        return room

    def connect_rooms(self, a: Room, b: Room, *, limits: Limits, top: float | None) -> None:
        """Open the walls by which two rooms face each other, and add a passage where there is a gap between them."""
        self._check_open()
        between = passage(a, b, limits=limits, top=top, number=len(self._rooms))
        if between is not None:
            self._rooms.append(between)

    def place(
        self,
        entity: Entity,
        *,
        room: Room | None,
        dir: float | None,
        x: tuple[float | None, float | None],
        z: tuple[float | None, float | None],
    ) -> None:
        """Put a thing where it touches nothing, evenly by chance in a room, in a part of one, or anywhere.

        Raises:
            WorldError: if no free place is found.
        """
        floor = self.floor
        radius = float(entity.radius)
        for _ in range(_MOST_TRIES):
            chosen = (floor.rooms[weighted(self.rng, floor.room_weights)] if room is None else room).outline
            low_x = (chosen.min_x if x[0] is None else x[0]) - radius
            high_x = (chosen.max_x if x[1] is None else x[1]) + radius
            low_z = (chosen.min_z if z[0] is None else z[0]) - radius
            high_z = (chosen.max_z if z[1] is None else z[1]) + radius
            at_x = uniform(self.rng, low_x, high_x)
            self.rng.random()  # Miniworld draws a height too, between 0 and 0
            at_z = uniform(self.rng, low_z, high_z)
            if chosen.contains(at_x, at_z) and self.blocker(entity, at_x, at_z, entity.radius) is None:
                break
        else:
            raise WorldError(f"no free place for {entity.name} (radius {entity.radius:.2f} m); make the room larger")
        self.put(entity, (at_x, 0.0, at_z), dir)

    def put(self, entity: Entity, pos: Position, dir: float | None) -> None:
        """Put a thing at an exact place, whatever it touches; without a heading, one is drawn."""
        self._floor = self.floor  # the plan closes before the heading is drawn
        entity.dir = uniform(self.rng, -math.pi, math.pi) if dir is None else dir
        entity.pos = pos
        self.entities.append(entity)

    def blocker(self, entity: Entity, x: float, z: float, radius: Length) -> Entity | str | None:
        """What a thing of this radius would touch at this place: WALL, another thing, or nothing (None)."""
        if touches_wall(self.floor.walls, x, z, float(radius)):
            return WALL
        for other in self.entities:
            if other is entity:
                continue
            dx, dz = other.pos[0] - x, other.pos[2] - z
            if math.sqrt(dx * dx + dz * dz) < float(radius + other.radius):
                return other
        return None

    def near(self, a: Entity, b: Entity) -> bool:
        """Are two things within a step of touching?"""
        (ax, ay, az), (bx, by, bz) = a.pos, b.pos
        distance = math.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2)
        return distance < float(a.radius + b.radius + 1.1 * self.reach)

    def randomise(self) -> None:
        """Draw what varies from episode to episode: sky, light, then each thing in the order it was placed."""
        rng = self.varying
        self.sky_colour = self.parameters.triple("sky_color", rng)
        self.light_pos = self.parameters.triple("light_pos", rng)
        self.light_colour = self.parameters.triple("light_color", rng)
        self.light_ambient = self.parameters.triple("light_ambient", rng)
        for entity in self.entities:
            entity.randomise(self.parameters, rng)

    def _check_open(self) -> None:
        if self._floor is not None:
            raise WorldError("the floor plan is closed; add and connect all rooms before placing the first thing")
