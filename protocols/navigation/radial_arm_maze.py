"""The radial arm maze: eight arms, food at the end of some, and a memory for where one has been.

Source: D. Olton and R. Samuelson, Journal of Experimental Psychology: Animal Behavior Processes 2 (1976). At the end of
an episode `info` has the entries into an arm that was visited before (errors of working memory), and the first entries
into an arm without food (errors of reference memory).
"""

import math

import gymnasium

from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.pathfinding.planner import plan
from minihuman.worlds.first_person.rules import MOVES

ARMS, HUB_M, LENGTH_M, HALF_WIDTH_M = 8, 3.0, 5.0, 0.9


class RadialArmMaze(FirstPersonEnv):
    """A hub with eight arms, of which ``baited`` are the numbers with food; an episode ends with the last of it."""

    def __init__(self, *, baited=(0, 2, 3, 6), max_steps=600, **options):
        self.baited = tuple(baited)
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def at(self, arm, along, across=0.0):
        """The point at metres along and across an arm."""
        cos, sin = math.cos(math.tau * arm / ARMS), math.sin(math.tau * arm / ARMS)
        return along * cos - across * sin, -along * sin - across * cos

    def build(self):
        hub = self.add_room([self.at(arm, HUB_M, HUB_M * math.tan(math.pi / ARMS)) for arm in range(ARMS)])
        for arm in range(ARMS):
            corners = [(HUB_M, -HALF_WIDTH_M), (HUB_M + LENGTH_M, -HALF_WIDTH_M), (HUB_M + LENGTH_M, HALF_WIDTH_M)]
            room = self.add_room([self.at(arm, *corner) for corner in (*corners, (HUB_M, HALF_WIDTH_M))])
            ends = [self.at(arm, HUB_M, across) for across in (-HALF_WIDTH_M, HALF_WIDTH_M)]
            xs, zs = zip(*ends, strict=True)
            if max(xs) - min(xs) > max(zs) - min(zs):
                self.connect_rooms(room, hub, min_x=min(xs), max_x=max(xs))
            else:
                self.connect_rooms(room, hub, min_z=min(zs), max_z=max(zs))
        for arm, colour in ((1, "red"), (4, "blue"), (6, "yellow")):  # to know the arms by: no symmetry
            x, z = self.at(arm, HUB_M + LENGTH_M - 0.3)
            self.place_entity(Box(colour, (0.4, 2.2, 0.4)), pos=(x, 0.0, z), dir=0.0)
        self.place_agent(pos=(0.0, 0.0, 0.0))
        self.ends = [Box("grey", 0.4) for _ in range(ARMS)]  # never placed, so they are not seen
        for arm, end in enumerate(self.ends):
            x, z = self.at(arm, HUB_M + LENGTH_M - 1.2)
            end.pos = (x, 0.0, z)
        self.inside, self.visited, self.working_errors, self.reference_errors = -1, [], 0, 0

    def reward_and_done(self, action):
        x, _, z = self.agent.pos
        arm = next((arm for arm, end in enumerate(self.ends) if self.near(end)), self.inside)
        is_new = arm not in (-1, self.inside)
        self.inside = -1 if math.hypot(x, z) < HUB_M else arm
        if not is_new:
            return 0.0, False
        seen_before, has_food = arm in self.visited, arm in self.baited
        self.working_errors += seen_before
        self.reference_errors += not has_food and not seen_before
        self.visited = [*self.visited, arm]
        return float(has_food and not seen_before), set(self.baited) <= set(self.visited)

    def shortest_path(self):
        left = [arm for arm in self.baited if arm not in self.visited]
        return plan(self, self.ends[left[0]]) or () if left else ()

    def info(self):
        return {"working_errors": self.working_errors, "reference_errors": self.reference_errors}


gymnasium.register("RadialArmMaze-v0", RadialArmMaze)
