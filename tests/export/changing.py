"""A world that may change between playing and exporting, as a package does when it is brought up to date."""

from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

shade = 40  # of the walls; a new version of the package may paint them otherwise


class Changing(gymnasium.Env[NDArray[np.uint8], int]):
    """Ten steps before a wall; its observation is its picture, and always the same array."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}
    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(0, 255, (32, 40, 3), np.uint8)
    action_names = ("left", "right")

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self._picture = np.zeros((32, 40, 3), np.uint8)
        self._place = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._place = int(self.np_random.integers(10, 20))
        return self._drawn(), {}

    def step(self, action: int) -> Any:
        self._place += 2 * int(action) - 1
        return self._drawn(), 0.0, False, False, {}

    def render(self) -> Any:
        return self._picture.copy()

    def _drawn(self) -> NDArray[np.uint8]:
        self._picture[:] = shade
        self._picture[:, self._place % 40] = (200, 30, 30)
        return self._picture


gymnasium.register("Changing-v0", Changing, max_episode_steps=10)
