"""A third party's world whose picture the seed does not govern: it shows what no observation tells."""

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces


class HiddenEnv(gymnasium.Env[Any, Any]):
    """Shows a colour from a generator of its own."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(2)
        self.observation_space = spaces.Box(0, 99, (1,), np.int64)
        self.colour = 0
        self._unseeded = np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.colour = int(self._unseeded.integers(2**24))
        return np.array([0]), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.array([0]), 0.0, False, False, {}

    def render(self) -> Any:
        picture = np.zeros((8, 8, 3), np.uint8)
        picture[...] = self.colour >> 16, self.colour >> 8 & 255, self.colour & 255
        return picture


gymnasium.register("tests/Hidden-v0", entry_point=HiddenEnv)
