"""Path integration: walk two sides of a triangle, marked by pillars, and then the way home with nothing to see.

Source: J. Loomis et al., Journal of Experimental Psychology: General 122 (1993). At the end of an episode `info` has
the signed error of the homeward heading in degrees (a circular measure), and the distances from home and walked home.
"""

import math

import gymnasium

from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.pathfinding.planner import plan
from minihuman.worlds.first_person.rules import MOVES

HIDDEN = 40.0  # metres below, where nothing is seen or met


class TriangleCompletion(FirstPersonEnv):
    """A field without marks; legs of ``first_m`` and ``second_m`` metres, with ``turn_deg`` to the left between."""

    def __init__(self, *, first_m=4.0, second_m=3.0, turn_deg=90.0, max_steps=400, **options):
        self.legs = first_m, second_m, math.radians(turn_deg)
        super().__init__(max_steps=max_steps, actions=(*MOVES, "done"), **options)

    def build(self):
        first_m, second_m, turn = self.legs
        self.add_rect_room(min_x=-9, max_x=9, min_z=-9, max_z=9, wall_height=0.1, floor="grass", ceiling=None)
        corner = first_m, 0.0
        end = first_m + second_m * math.cos(turn), -second_m * math.sin(turn)
        self.corners = [(*corner,), (*end,), (0.0, 0.0)]
        self.pillar = self.place_entity(Box("red", (0.4, 2.0, 0.4)), pos=(corner[0], 0.0, corner[1]), dir=0.0)
        self.place_agent(pos=(0.0, 0.0, 0.0), dir=0.0)
        self.reached, self.outcome = 0, {}

    def reward_and_done(self, action):
        if self.reached < 2 and self.near(self.pillar):
            self.reached += 1
            x, z = self.corners[self.reached]
            self.pillar.pos = (x, 0.0 if self.reached < 2 else -HIDDEN, z)
            self.turned_at = self.agent.pos[::2]
        if action != "done" or self.reached < 2:
            return 0.0, False
        (x0, z0), (x, z) = self.turned_at, self.agent.pos[::2]
        error = math.atan2(z0 - z, x - x0) - math.atan2(z0, -x0)
        walked, distance = math.dist((x, z), (x0, z0)), math.hypot(x, z)
        self.outcome = {"heading_error_deg": math.degrees(math.remainder(error, math.tau)), "home_error_m": distance}
        self.outcome |= {"walked_ratio": walked / math.hypot(x0, z0)}
        return float(distance < 1.0), True

    def shortest_path(self):
        home = Box("grey", 0.1)
        home.pos = (*self.corners[2][:1], 0.0, 0.0)
        return plan(self, self.pillar if self.reached < 2 else home) or (len(MOVES),)

    def info(self):
        return dict(self.outcome)


gymnasium.register("TriangleCompletion-v0", TriangleCompletion)
