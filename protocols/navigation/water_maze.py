"""The water maze in first person: a round pool, marks on its rim, and a platform that cannot be seen.

Source: R. Morris, Journal of Neuroscience Methods 11 (1984). At the end of an episode `info` has the share of steps in
the platform's quadrant and, by M. Gallagher, R. Burwell and M. Burchinal, Behavioral Neuroscience 107 (1993), the mean
distance to the platform (for a probe), and the sum of distances beyond that of a straight way (for learning).
"""

import math

import gymnasium

from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.pathfinding.planner import plan
from minihuman.worlds.first_person.rules import MOVES

BEARINGS_RAD = {"east": 0.0, "north": math.pi / 2, "west": math.pi, "south": -math.pi / 2}
PILLARS = (("red", 0.35), ("yellow", 1.8), ("blue", 3.4), ("green", 5.2))  # where they stand, in radians: no symmetry


class WaterMaze(FirstPersonEnv):
    """A pool of ``radius`` metres, with a platform in its north-east, or without one in a ``probe``."""

    def __init__(self, *, radius=6.0, start="south", probe=False, max_steps=600, **options):
        self.radius, self.start, self.probe = radius, start, probe
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def at(self, bearing_rad, share=1.0):
        """The point on a bearing, at a share of the way from the middle to the rim."""
        return share * self.radius * math.cos(bearing_rad), 0.0, -share * self.radius * math.sin(bearing_rad)

    def build(self):
        rim = [self.at(math.tau * side / 32)[::2] for side in range(32)]
        self.add_room(rim, wall_height=1.2, floor="water", wall="concrete", ceiling=None)
        for colour, bearing in PILLARS:
            self.place_entity(Box(colour, (0.6, 3.0, 0.6)), pos=self.at(bearing, 0.95), dir=bearing)
        self.platform = Box("grey", 0.4)  # never placed, so it is not seen
        self.platform.pos = self.at(math.pi / 4, 0.5)
        side = BEARINGS_RAD[self.start]
        self.place_agent(pos=self.at(side, 0.8), dir=side + math.pi)  # looks at the middle
        self.n, self.in_quadrant, self.distances_m, self.begins_m = 0, 0, 0.0, self.distance_m()

    def distance_m(self):
        return math.dist(self.agent.pos[::2], self.platform.pos[::2])

    def reward_and_done(self, action):
        x, _, z = self.agent.pos
        self.n, self.in_quadrant = self.n + 1, self.in_quadrant + (x > 0 and z < 0)
        self.distances_m += self.distance_m()
        return (1.0, True) if not self.probe and self.near(self.platform) else (0.0, False)

    def shortest_path(self):
        return plan(self, self.platform) or ()

    def info(self):
        straight = self.begins_m**2 / 2 / self.stage.reach  # the sum of distances of who swims there at once
        return {
            "quadrant_share": self.in_quadrant / max(self.n, 1),
            "proximity_m": self.distances_m / max(self.n, 1),
            "search_error": self.distances_m - straight,
        }


gymnasium.register("WaterMaze-v0", WaterMaze)
