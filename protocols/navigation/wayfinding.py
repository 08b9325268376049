"""Wayfinding in a building of two floors: from the entrance over the stairs to the archive.

Source: C. Hölscher et al., Up the down staircase, Journal of Environmental Psychology 26 (2006): people look for rooms
on other floors of a building. At each step `info` has the floor, from 0.
"""

import gymnasium

from minihuman.worlds.first_person.entities import Box, Key
from minihuman.worlds.first_person.env import near_goal
from minihuman.worlds.first_person.heights.env import BuildingEnv
from minihuman.worlds.first_person.rules import MOVES


class TwoFloors(BuildingEnv):
    """A hall and a gallery above each other, with stairs in the hall's east, and an archive behind the gallery."""

    def __init__(self, *, max_steps=600, **options):
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def build(self):
        hall = self.add_rect_room(min_x=0, max_x=8, min_z=0, max_z=6, floor="wood", wall="brick_wall")
        office = self.add_rect_room(min_x=0, max_x=8, min_z=6.2, max_z=10)
        stairs = self.add_stairs(min_x=8, max_x=13, min_z=1, max_z=3, up="east", floor_y=0, top_y=3)
        landing = self.add_rect_room(min_x=13, max_x=16, min_z=0, max_z=6, floor_y=3, floor="wood")
        gallery = self.add_rect_room(min_x=0, max_x=13, min_z=3.2, max_z=6, floor_y=3, wall="brick_wall")
        archive = self.add_rect_room(min_x=0, max_x=8, min_z=6.2, max_z=10, floor_y=3, wall="wood_planks")
        self.connect_rooms(hall, office, min_x=1, max_x=2.5, max_y=2.2)
        self.connect_rooms(hall, stairs)
        self.connect_rooms(stairs, landing)
        self.connect_rooms(landing, gallery, min_z=4, max_z=5.5, max_y=5.2)
        self.connect_rooms(gallery, archive, min_x=1, max_x=2.5, max_y=5.2)
        self.place_entity(Key("blue"), room=office)
        self.goal = self.place_entity(Box("red"), room=archive)
        self.place_agent(room=hall, max_x=4)

    def termination_rule(self):
        return near_goal(self.goal)

    def info(self):
        return {"floor": self.agent_floor}


gymnasium.register("TwoFloors-v0", TwoFloors)
