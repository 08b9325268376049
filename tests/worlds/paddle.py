"""A world of pixels only, as the arcade's are: no pose, no map, no mission; a ball to be met with a paddle."""

from typing import Any, ClassVar

import gymnasium
import numpy as np

_SIDE = 24


class Paddle(gymnasium.Env):
    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 30}

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.action_space = gymnasium.spaces.Discrete(3)
        self.observation_space = gymnasium.spaces.Box(0, 255, (_SIDE, _SIDE, 3), np.uint8)

    def get_action_meanings(self) -> list[str]:
        return ["NOOP", "LEFT", "RIGHT"]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self._paddle, self._ball, self._height = _SIDE // 2, int(self.np_random.integers(2, _SIDE - 2)), 0
        return self._seen(), {}

    def step(self, action: int):
        self._paddle = int(np.clip(self._paddle + (0, -2, 2)[int(action)], 2, _SIDE - 3))
        self._height += 1
        landed = self._height >= _SIDE - 1
        met = landed and abs(self._paddle - self._ball) <= 2
        return self._seen(), float(met), landed, False, {}

    def render(self):
        return self._seen()

    def _seen(self):
        picture = np.zeros((_SIDE, _SIDE, 3), np.uint8)
        picture[-1, self._paddle - 2 : self._paddle + 3] = (90, 200, 250)
        picture[min(self._height, _SIDE - 1), self._ball] = (250, 220, 90)
        return picture


class Arcade(Paddle):
    """A world that cannot be copied, as an emulator's: what runs inside refuses."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.machine = Machine()


class Machine:
    def __deepcopy__(self, memo: dict[int, Any]) -> "Machine":
        raise TypeError("cannot pickle 'Machine' object")


gymnasium.register("tests/Arcade-v0", entry_point=Arcade, max_episode_steps=200)
gymnasium.register("tests/Paddle-v0", entry_point=Paddle, max_episode_steps=200)
