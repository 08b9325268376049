"""GoToObj on upstream's miniworld classes, for timing beside ours. Importing it needs a display (Xvfb will do)."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces
from miniworld import entity
from miniworld.miniworld import MiniWorldEnv
from miniworld.params import DEFAULT_PARAMS

from minihuman.worlds.go_to_obj import draw_arrangement

WORLD_ID = "benchmark/MiniWorld-GoToObj-v0"


class UpstreamFirstPerson(MiniWorldEnv):
    places = ((0.9, 4.5), (4.5, 8.1), (8.1, 4.5), (4.5, 0.9))  # in the order of WALLS

    def __init__(self, **kwargs: Any) -> None:
        parameters = DEFAULT_PARAMS.no_random()
        parameters.set("forward_step", 0.9)
        parameters.set("turn_step", 90)
        super().__init__(params=parameters, max_episode_steps=100, **kwargs)
        self.action_space = spaces.Discrete(3)

    def _gen_world(self) -> None:
        drawn = draw_arrangement(self.np_random)
        self.add_rect_room(min_x=0, max_x=9, min_z=0, max_z=9)
        placed = []
        for number, ((x, z), (colour, kind)) in enumerate(zip(self.places, drawn.objects, strict=True)):
            match kind:
                case "ball":
                    thing = entity.Ball(color=colour, size=0.5)
                case "box":
                    thing = entity.Box(color=colour, size=0.5)
                case _:
                    thing = entity.Key(color=colour)
            placed.append(self.place_entity(thing, pos=np.array((x, 0.5, z)), dir=number * math.pi / 2))
        self.target = placed[drawn.target]
        self.mission = drawn.mission
        self.place_agent(pos=np.array((4.5, 0.5, 4.5)), dir=0.0)

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        seen, reward, terminated, truncated, info = super().step(action)
        x = self.agent.pos[0] + 0.8 * math.cos(self.agent.dir)
        z = self.agent.pos[2] - 0.8 * math.sin(self.agent.dir)
        if math.hypot(x - self.target.pos[0], z - self.target.pos[2]) <= 0.2:
            return seen, float(reward) + self._reward(), True, truncated, info
        return seen, float(reward), terminated, truncated, info
