"""Buildings that tests walk through."""

import gymnasium

from minihuman.worlds.first_person.entities import Ball, Box
from minihuman.worlds.first_person.env import near_goal
from minihuman.worlds.first_person.heights.env import BuildingEnv
from minihuman.worlds.first_person.rules import MOVES

STOREY_M = 3.0
ROOM_WALLS = ("brick_wall", "wood_planks", "stucco")


class ThirtyRooms(BuildingEnv):
    """Three floors of a corridor, eight offices and a landing, joined by stairs with a landing half of the way up."""

    def __init__(self, *, max_steps: int = 1500, **options):
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def build(self) -> None:
        floors = [self._add_floor(number) for number in range(3)]
        for number in range(2):
            self._add_staircase(number, floors[number][0], floors[number + 1][0])
        lowest = floors[0][1]
        highest = floors[2][1]
        for office, colour in zip(lowest, ("blue", "green", "purple", "yellow"), strict=False):
            self.place_entity(Ball(colour), room=office)
        self.goal = self.place_entity(Box("red"), room=highest[int(self.np_random.integers(8))])
        self.place_agent(room=lowest[int(self.np_random.integers(8))])

    def termination_rule(self):
        return near_goal(self.goal)

    def _add_floor(self, number: int):
        """Add one floor; return its landing and its offices."""
        y = STOREY_M * number
        wall = ROOM_WALLS[number]
        corridor = self.add_rect_room(min_x=0, max_x=20, min_z=5, max_z=8, floor_y=y, floor="wood", wall=wall)
        landing = self.add_rect_room(min_x=20, max_x=24, min_z=5, max_z=8, floor_y=y, wall=wall)
        self.connect_rooms(corridor, landing, min_z=5.5, max_z=7.5, max_y=y + 2.2)
        offices = []
        for column in range(4):
            for low, high in ((0, 5), (8, 13)):
                x = 5 * column
                office = self.add_rect_room(min_x=x, max_x=x + 5, min_z=low, max_z=high, floor_y=y)
                self.connect_rooms(office, corridor, min_x=x + 2, max_x=x + 3.2, max_y=y + 2.1)
                offices.append(office)
        return landing, offices

    def _add_staircase(self, number: int, lower, upper) -> None:
        y = STOREY_M * number
        half_y = y + STOREY_M / 2
        up = self.add_stairs(min_x=20, max_x=22, min_z=0, max_z=5, up="north", floor_y=y, top_y=half_y)
        half = self.add_rect_room(min_x=20, max_x=24, min_z=-2, max_z=0, floor_y=half_y)
        on = self.add_stairs(min_x=22, max_x=24, min_z=0, max_z=5, up="south", floor_y=half_y, top_y=y + STOREY_M)
        for below, above in ((lower, up), (up, half), (half, on), (on, upper)):
            self.connect_rooms(below, above)


gymnasium.register("tests/ThirtyRooms-v0", ThirtyRooms)
