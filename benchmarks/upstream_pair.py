"""The pair of worlds on upstream minigrid and miniworld, for timing beside ours and as an oracle of the rules."""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from minigrid.core.grid import Grid
from minigrid.core.mission import MissionSpace
from minigrid.core.world_object import Ball, Box, Key
from minigrid.minigrid_env import MiniGridEnv
from miniworld import entity
from miniworld.miniworld import MiniWorldEnv
from miniworld.params import DEFAULT_PARAMS

COLOURS = ("blue", "green", "grey", "purple", "red", "yellow")
OBJECTS = ("ball", "box", "key")

Layout = list[tuple[str, str]]  # colour and kind of the objects at the middles of the walls


def draw(rng: np.random.Generator) -> tuple[Layout, int]:
    """Four objects of four colours, and which of them is the target."""
    colours = rng.permutation(COLOURS)[:4]
    kinds = rng.choice(OBJECTS, size=4)
    return [(str(colour), str(kind)) for colour, kind in zip(colours, kinds, strict=True)], int(rng.integers(4))


class UpstreamGrid(MiniGridEnv):
    places = ((5, 1), (1, 5), (9, 5), (5, 9))

    def __init__(self, layout: tuple[Layout, int] | None = None, **kwargs: Any) -> None:
        self.layout = layout
        mission_space = MissionSpace(lambda colour, kind: f"go to the {colour} {kind}", [list(COLOURS), list(OBJECTS)])
        super().__init__(mission_space, width=11, height=11, max_steps=484, see_through_walls=True, **kwargs)

    def _gen_grid(self, width: int, height: int) -> None:
        objects, target = self.layout or draw(self.np_random)
        self.grid = Grid(width, height)
        self.grid.wall_rect(0, 0, width, height)
        for place, (colour, kind) in zip(self.places, objects, strict=True):
            self.grid.set(*place, {"ball": Ball, "box": Box, "key": Key}[kind](colour))
        self.agent_pos, self.agent_dir = np.array((5, 5)), 0
        self.target = self.places[target]
        self.mission = "go to the {} {}".format(*objects[target])

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        seen, reward, terminated, truncated, info = super().step(action)
        if tuple(self.front_pos) == self.target:
            return seen, self._reward(), True, truncated, info
        return seen, float(reward), terminated or action == self.actions.toggle, truncated, info


class UpstreamFirstPerson(MiniWorldEnv):
    places = ((0.9, 4.5), (4.5, 8.1), (8.1, 4.5), (4.5, 0.9))

    def __init__(self, layout: tuple[Layout, int] | None = None, **kwargs: Any) -> None:
        self.layout = layout
        parameters = DEFAULT_PARAMS.no_random()
        parameters.set("forward_step", 0.9)
        parameters.set("turn_step", 90)
        super().__init__(params=parameters, max_episode_steps=100, **kwargs)
        self.action_space = spaces.Discrete(3)

    def _gen_world(self) -> None:
        objects, target = self.layout or draw(self.np_random)
        self.add_rect_room(min_x=0, max_x=9, min_z=0, max_z=9)
        placed = []
        for number, ((x, z), (colour, kind)) in enumerate(zip(self.places, objects, strict=True)):
            match kind:
                case "ball":
                    thing = entity.Ball(color=colour, size=0.5)
                case "box":
                    thing = entity.Box(color=colour, size=0.5)
                case _:
                    thing = entity.Key(color=colour)
            placed.append(self.place_entity(thing, pos=np.array((x, 0.5, z)), dir=number * math.pi / 2))
        self.target = placed[target]
        self.mission = "go to the {} {}".format(*objects[target])
        self.place_agent(pos=np.array((4.5, 0.5, 4.5)), dir=0.0)

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        seen, reward, terminated, truncated, info = super().step(action)
        x = self.agent.pos[0] + 0.8 * math.cos(self.agent.dir)
        z = self.agent.pos[2] - 0.8 * math.sin(self.agent.dir)
        if math.hypot(x - self.target.pos[0], z - self.target.pos[2]) <= 0.2:
            return seen, float(reward) + self._reward(), True, truncated, info
        return seen, float(reward), terminated, truncated, info


GRID_ID = "benchmark/MiniGrid-GoToObj-v0"
FIRST_PERSON_ID = "benchmark/MiniWorld-GoToObj-v0"


def register() -> None:
    """Register both with Gymnasium, once."""
    for world_id, entry in ((GRID_ID, UpstreamGrid), (FIRST_PERSON_ID, UpstreamFirstPerson)):
        if world_id not in gymnasium.registry:
            gymnasium.register(world_id, entry_point=entry)
