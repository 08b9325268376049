"""GoToObj on upstream's minigrid classes: for timing beside ours, and an oracle of the rules."""

from typing import Any

import numpy as np
from minigrid.core.grid import Grid
from minigrid.core.mission import MissionSpace
from minigrid.core.world_object import Ball, Box, Key
from minigrid.minigrid_env import MiniGridEnv

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.go_to_obj import KINDS, Arrangement, draw_arrangement

WORLD_ID = "benchmark/MiniGrid-GoToObj-v0"


class UpstreamGrid(MiniGridEnv):
    places = ((1, 5), (5, 9), (9, 5), (5, 1))  # in the order of WALLS

    def __init__(self, arrangement: Arrangement | None = None, **kwargs: Any) -> None:
        self.arrangement = arrangement
        mission_space = MissionSpace(lambda colour, kind: f"go to the {colour} {kind}", [list(COLOURS), list(KINDS)])
        super().__init__(mission_space, width=11, height=11, max_steps=484, see_through_walls=True, **kwargs)

    def _gen_grid(self, width: int, height: int) -> None:
        drawn = self.arrangement or draw_arrangement(self.np_random)
        self.grid = Grid(width, height)
        self.grid.wall_rect(0, 0, width, height)
        for place, (colour, kind) in zip(self.places, drawn.objects, strict=True):
            self.grid.set(*place, {"ball": Ball, "box": Box, "key": Key}[kind](colour))
        self.agent_pos, self.agent_dir = np.array((5, 5)), 0
        self.target = self.places[drawn.target]
        self.mission = drawn.mission

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        seen, reward, terminated, truncated, info = super().step(action)
        if tuple(self.front_pos) == self.target:
            return seen, self._reward(), True, truncated, info
        return seen, float(reward), terminated or action == self.actions.toggle, truncated, info
