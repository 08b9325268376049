"""A third party's world, small enough for thousands of sessions: a corridor with the goal at its end."""

from enum import IntEnum
from typing import Any, ClassVar

import gymnasium
import numpy as np

LENGTH = 4


class CorridorEnv(gymnasium.Env[int, int]):
    """Walk to the last cell; ``dive`` ends it without a reward, ``crash`` raises; ``onset_every``: steps."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    class Actions(IntEnum):
        back = 0
        forward = 1
        stay = 2
        dive = 3
        crash = 4

    def __init__(self, render_mode: str | None = None, start: int = 0, onset_every: int = 0) -> None:
        self.render_mode = render_mode
        self.action_space = gymnasium.spaces.Discrete(5)
        self.observation_space = gymnasium.spaces.Discrete(LENGTH)
        self.start = start
        self.onset_every = onset_every
        self.steps = 0
        self.cell = start

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        super().reset(seed=seed)
        self.cell = self.start
        self.steps = 0
        return self.cell, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        if action == self.Actions.crash:
            raise RuntimeError("the corridor has collapsed")
        self.cell = min(LENGTH - 1, max(0, self.cell + {0: -1, 1: 1}.get(int(action), 0)))
        self.steps += 1
        info = {"onset": True} if self.onset_every and self.steps % self.onset_every == 0 else {}
        at_goal = self.cell == LENGTH - 1
        return self.cell, float(at_goal), at_goal or action == self.Actions.dive, False, info

    def render(self) -> Any:
        picture = np.zeros((8, 8 * LENGTH, 3), dtype=np.uint8)
        picture[:, 8 * self.cell : 8 * self.cell + 8] = 255
        return picture


class PictureLessEnv(CorridorEnv):
    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}


gymnasium.register("tests/Corridor-v0", entry_point=CorridorEnv)
gymnasium.register("tests/LimitedCorridor-v0", entry_point=CorridorEnv, max_episode_steps=2)
gymnasium.register("tests/PictureLess-v0", entry_point=PictureLessEnv)
