"""Sidewalk: walk to the box without stepping into the street."""

import math
from typing import Any

from minihuman.worlds.first_person.building.rooms import Room
from minihuman.worlds.first_person.entities import Box, Mesh
from minihuman.worlds.first_person.layouts.goal import GoalEnv


class Sidewalk(GoalEnv):
    """A sidewalk along a street, with a red box at its end; the street ends the episode for nothing."""

    def __init__(self, *, max_steps: int | None = 150, **options: Any) -> None:
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Lay the street out, with cones along it and a building far behind it."""
        sidewalk = self.add_rect_room(
            min_x=-3, max_x=0, min_z=0, max_z=12, wall="brick_wall", floor="concrete_tiles", ceiling=None
        )
        self.street = self.add_rect_room(min_x=0, max_x=6, min_z=-80, max_z=80, floor="asphalt", ceiling=None)
        self.connect_rooms(sidewalk, self.street, min_z=0, max_z=12)
        self.place_entity(Mesh("building", 30), pos=(30, 0, 30), dir=-math.pi)
        for place in range(1, 6):
            self.place_entity(Mesh("cone", 0.75), pos=(1, 0, 2 * place))
        self.box = self.place_entity(Box("red"), room=sidewalk, min_z=10, max_z=12)
        self.place_agent(room=sidewalk, min_z=0, max_z=1.5)

    def judge(self, action: str) -> tuple[float, bool]:
        """1 down to 0.8 near the box; either it or the street ends the episode."""
        reward, arrived = super().judge(action)
        x, _, z = self.agent.pos
        return reward, arrived or self.street.contains(x, z)

    way, bounds = GoalEnv.way, GoalEnv.bounds  # which keep out of the street

    def off_limits(self) -> tuple[Room, ...]:
        """The street."""
        return (self.street,)
