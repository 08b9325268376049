"""A world that ends by no rule of its own: with a limit of steps, and without one."""

from typing import Any, ClassVar

import gymnasium
import numpy as np


class Endless(gymnasium.Env[dict[str, Any], int]):
    """Ends by no rule of its own; actions are counted from 1."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}
    action_space = gymnasium.spaces.Discrete(3, start=1)
    observation_space = gymnasium.spaces.Dict({"image": gymnasium.spaces.Box(0, 255, (7, 7, 3), np.uint8)})
    action_names = ("left", "stay", "right")

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._place = int(self.np_random.integers(3))
        return self._seen(), {}

    def step(self, action: int) -> Any:
        assert self.action_space.contains(action)
        self._place = (self._place + int(action) - 2) % 7
        return self._seen(), float(self._place == 3), False, False, {}

    def render(self) -> Any:
        return np.full((64, 64, 3), 30 * self._place, np.uint8)

    def _seen(self) -> dict[str, Any]:
        image = np.zeros((7, 7, 3), np.uint8)
        image[self._place] = 1
        return {"image": image}


gymnasium.register("Endless-v0", Endless, max_episode_steps=20)
gymnasium.register("Unlimited-v0", Endless)
