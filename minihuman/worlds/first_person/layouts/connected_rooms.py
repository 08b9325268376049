"""Worlds of adjoining rooms: FourRooms, ThreeRooms, Hallway, WallGap, Sidewalk."""

import math
from typing import Any

from minihuman.worlds.first_person.entities import Ball, Box, ImageFrame, Key, Mesh
from minihuman.worlds.first_person.env import FirstPersonEnv, TerminationRule, near_goal
from minihuman.worlds.first_person.layouts.one_room import GoalEnv
from minihuman.worlds.first_person.parameters import uniform
from minihuman.worlds.first_person.rooms import Room
from minihuman.worlds.first_person.rules import MOVES
from minihuman.worlds.options import MAX_METRES, check_number


class FourRooms(GoalEnv):
    """Four rooms in a square, with a passage between each two adjoining ones, and a red box in one of them."""

    def build(self) -> None:
        """Build the rooms, the box and the agent."""
        south_west = self.add_rect_room(min_x=-7, max_x=-1, min_z=1, max_z=7)
        south_east = self.add_rect_room(min_x=1, max_x=7, min_z=1, max_z=7)
        north_east = self.add_rect_room(min_x=1, max_x=7, min_z=-7, max_z=-1)
        north_west = self.add_rect_room(min_x=-7, max_x=-1, min_z=-7, max_z=-1)
        self.connect_rooms(south_west, south_east, min_z=3, max_z=5, max_y=2.2)
        self.connect_rooms(south_east, north_east, min_x=3, max_x=5, max_y=2.2)
        self.connect_rooms(north_east, north_west, min_z=-5, max_z=-3, max_y=2.2)
        self.connect_rooms(north_west, south_west, min_x=-5, max_x=-3, max_y=2.2)
        self.box = self.place_entity(Box("red"))
        self.place_agent()


class ThreeRooms(FirstPersonEnv):
    """One large room, two small ones and five things to look at, without rewards."""

    def __init__(self, *, max_steps: int | None = 400, **options: Any) -> None:
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def build(self) -> None:
        """Build the rooms, the things and the agent."""
        large = self.add_rect_room(min_x=-7, max_x=7, min_z=0.5, max_z=7)
        left = self.add_rect_room(min_x=-7, max_x=-1, min_z=-7, max_z=-0.5)
        right = self.add_rect_room(min_x=1, max_x=7, min_z=-7, max_z=-0.5)
        self.connect_rooms(large, left, min_x=-5.25, max_x=-2.75)
        self.connect_rooms(large, right, min_x=2.75, max_x=5.25)
        self.place_entity(Box("red"))
        self.place_entity(Box("green", 0.6))
        self.hang(ImageFrame((0.0, 1.35, 7.0), math.pi / 2, "logo_mila", 1.8, aspect=510 / 1024))
        self.place_entity(Mesh("duckie", 0.25, static=False))
        self.place_entity(Key("blue"))
        self.place_entity(Ball("green"))
        self.place_agent()


class Hallway(GoalEnv):
    """A hallway of ``length`` metres with a red box at its far end."""

    def __init__(self, *, length: float = 12, **options: Any) -> None:
        self.length = check_number("length", length, 2, MAX_METRES)
        super().__init__(**options)

    def build(self) -> None:
        """Build the hallway; the agent starts facing roughly towards the box."""
        room = self.add_rect_room(min_x=-1, max_x=-1 + self.length, min_z=-2, max_z=2)
        self.box = self.place_entity(Box("red"), min_x=room.max_x - 2)
        self.place_agent(dir=uniform(self.np_random, -math.pi / 4, math.pi / 4), max_x=room.max_x - 2)


class WallGap(GoalEnv):
    """Two open yards with a gap in the wall between them; the red box is in the yard where the agent is not."""

    def __init__(self, *, max_steps: int | None = 300, **options: Any) -> None:
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Build the yards, and a building far behind them."""
        yard = {"wall": "brick_wall", "floor": "asphalt", "ceiling": None}
        start = self.add_rect_room(min_x=-7, max_x=7, min_z=0.5, max_z=8, **yard)
        far = self.add_rect_room(min_x=-7, max_x=7, min_z=-8, max_z=-0.5, **yard)
        self.connect_rooms(start, far, min_x=-1.5, max_x=1.5)
        self.box = self.place_entity(Box("red"), room=far)
        self.place_entity(Mesh("building", 30), pos=(30, 0, 30), dir=-math.pi)
        self.place_agent(room=start)


class Sidewalk(GoalEnv):
    """A sidewalk along a street, with a red box at its end; entering the street ends the episode without a reward."""

    def __init__(self, *, max_steps: int | None = 150, **options: Any) -> None:
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Build the street, with cones along it and a building far behind it."""
        sidewalk = self.add_rect_room(
            min_x=-3, max_x=0, min_z=0, max_z=12, wall="brick_wall", floor="concrete_tiles", ceiling=None
        )
        self.street = self.add_rect_room(min_x=0, max_x=6, min_z=-80, max_z=80, floor="asphalt", ceiling=None)
        self.connect_rooms(sidewalk, self.street, min_z=0, max_z=12)
        self.place_entity(Mesh("building", 30), pos=(30, 0, 30), dir=-math.pi)
        for number in range(1, 6):
            self.place_entity(Mesh("cone", 0.75), pos=(1, 0, 2 * number))
        self.box = self.place_entity(Box("red"), room=sidewalk, min_z=10, max_z=12)
        self.place_agent(room=sidewalk, min_z=0, max_z=1.5)

    def termination_rule(self) -> TerminationRule:
        """Return the rule that ends an episode near the box or in the street."""
        return near_goal(self.box, forbidden=self.street)

    def off_limits(self) -> tuple[Room, ...]:
        """Return the street, which planned paths avoid."""
        return (self.street,)
