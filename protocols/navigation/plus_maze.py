"""The plus maze: the same goal from one arm, then from the opposite one, which tells a place from a response.

Source: E. Tolman, B. Ritchie and D. Kalish, Journal of Experimental Psychology 36 (1946). At the end of an episode
`info` has 1 for `chose_place` if the arm was the goal's, and for `chose_response` if it was the one to the right.
Without a ``far`` arm it is a T-maze.
"""

import gymnasium

from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.pathfinding.planner import plan
from minihuman.worlds.first_person.rules import MOVES

HALF_WIDTH_M, LENGTH_M = 0.9, 5.0


class PlusMaze(FirstPersonEnv):
    """Arms to the west, the east and the ``start``, the goal in the east; in a ``probe`` either arm ends it."""

    def __init__(self, *, start="south", probe=False, far=True, max_steps=200, **options):
        self.start, self.probe, self.far = start, probe, far
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def build(self):
        w, far_end = HALF_WIDTH_M, HALF_WIDTH_M + LENGTH_M
        hub = self.add_rect_room(min_x=-w, max_x=w, min_z=-w, max_z=w)
        for low, high in ((-far_end, -w), (w, far_end)):
            self.connect_rooms(hub, self.add_rect_room(min_x=low, max_x=high, min_z=-w, max_z=w), min_z=-w, max_z=w)
            if self.far or (low > 0) == (self.start == "south"):
                self.connect_rooms(hub, self.add_rect_room(min_x=-w, max_x=w, min_z=low, max_z=high), min_x=-w, max_x=w)
        for colour, x in (("red", -far_end), ("blue", far_end)):  # to know the arms by
            self.place_entity(Box(colour, (0.3, 2.2, 0.3)), pos=(x * 0.97, 0.0, 0.7), dir=0.0)
        self.ends = [Box("grey", 0.4) for _ in range(2)]  # never placed, so they are not seen: west and east
        for end, x in zip(self.ends, (-far_end, far_end), strict=True):
            end.pos = (x * 0.85, 0.0, 0.0)
        side = 1 if self.start == "south" else -1
        self.place_agent(pos=(0.0, 0.0, side * LENGTH_M), dir=side * 1.5707963267948966)
        self.right = self.ends[1 if self.start == "south" else 0]
        self.chosen = {}

    def reward_and_done(self, action):
        entered = next((end for end in self.ends if self.near(end)), None)
        if entered is not None and not self.chosen:
            self.chosen = {"chose_place": entered is self.ends[1], "chose_response": entered is self.right}
        is_at_goal = entered is self.ends[1]
        return float(is_at_goal and not self.probe), is_at_goal or (self.probe and entered is not None)

    def shortest_path(self):
        return plan(self, self.ends[1]) or ()

    def info(self):
        return dict(self.chosen)


gymnasium.register("PlusMaze-v0", PlusMaze)
