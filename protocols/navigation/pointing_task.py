"""Pointing: look at the fountain, walk around a corner, and turn to where it must be.

Source: J. Rieser, Journal of Experimental Psychology: Learning, Memory, and Cognition 15 (1989). At the end of an
episode `info` has the signed error of the direction in degrees, a circular measure.
"""

import math

import gymnasium

from minihuman.worlds.first_person.entities import Ball
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.rules import MOVES


class PointingTask(FirstPersonEnv):
    """Two rooms at a right angle; the fountain is in the first, and the person stands ``stand_m`` into the second."""

    def __init__(self, *, stand_m=3.0, facing_deg=90.0, max_steps=120, **options):
        self.stand_m, self.facing = stand_m, math.radians(facing_deg)
        super().__init__(max_steps=max_steps, actions=(*MOVES[:2], "done"), **options)

    def build(self):
        first = self.add_rect_room(min_x=0, max_x=6, min_z=0, max_z=6)
        second = self.add_rect_room(min_x=6, max_x=9, min_z=4, max_z=12)
        self.connect_rooms(first, second, min_z=4.2, max_z=5.8)
        self.fountain = self.place_entity(Ball("blue", 1.2), pos=(2.0, 0.0, 1.5), dir=0.0)
        self.place_agent(pos=(7.5, 0.0, 5.0 + self.stand_m), dir=self.facing)
        self.error = {}

    def off(self):
        """The angle from the agent's heading to the fountain, in radians to the left."""
        x, _, z = self.agent.pos
        goal_x, _, goal_z = self.fountain.pos
        return math.remainder(math.atan2(z - goal_z, goal_x - x) - self.agent.dir, math.tau)

    def reward_and_done(self, action):
        if action != "done":
            return 0.0, False
        self.error = {"pointing_error_deg": -math.degrees(self.off())}
        return float(abs(self.off()) < math.radians(20)), True

    def shortest_path(self):
        turn = math.radians(self.parameters["turn_step"].default)
        turns = round(self.off() / turn)
        return [0 if turns > 0 else 1] * abs(turns) + [2]

    def info(self):
        return dict(self.error)


gymnasium.register("PointingTask-v0", PointingTask)
