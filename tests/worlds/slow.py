"""A counter whose every step takes longer than the period that it is played at. It pictures its state."""

import time
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces


class SlowCounter(gymnasium.Env):
    """Action 0 leaves it as it is, 1 counts up, 2 counts down."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}
    action_space = spaces.Discrete(3)
    observation_space = spaces.Discrete(64)

    def __init__(self, render_mode: str | None = None, *, step_s: float = 0.05) -> None:
        self.render_mode, self.step_s, self.value = render_mode, step_s, 32

    def get_action_meanings(self) -> list[str]:
        return ["rest", "up", "down"]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.value = 32
        return self.value, {}

    def step(self, action: Any):
        time.sleep(self.step_s)
        self.value = (self.value + (0, 1, -1)[action]) % 64
        return self.value, 0.0, False, False, {}

    def render(self):
        picture = np.full((48, 64, 3), 40, np.uint8)
        picture[8:40, self.value] = (240, 176, 72)
        return picture


gymnasium.register("tests/SlowCounter-v0", entry_point=SlowCounter)
