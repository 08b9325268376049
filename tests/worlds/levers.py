"""Levers: a world whose actions are any space that its option names, for what keys do to one. It pictures its state."""

import threading
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

SPACES = {
    "box": spaces.Box(np.float32([-1.0, 0.0]), np.float32([1.0, 2.0]), dtype=np.float32),
    "arm": spaces.Box(-1.0, 1.0, (6,), np.float32),
    "buttons": spaces.MultiBinary(3),
    "choices": spaces.MultiDiscrete([3, 2]),
    "chords": spaces.Discrete(5, start=1),
    "board": spaces.Dict({"act": spaces.Discrete(3), "place": spaces.Box(0, 63, (2,), np.int64)}),
    "pair": spaces.Tuple((spaces.Box(-1.0, 1.0, (2,), np.float32), spaces.Discrete(2, start=4))),
}


class Levers(gymnasium.Env):
    """The observation is the sum of all that was done; ``locked`` keeps it from being copied, ``chance`` drifts it."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(
        self, render_mode: str | None = None, *, kind: str = "box", locked: bool = False, chance: bool = False
    ) -> None:
        self.render_mode, self.kind = render_mode, kind
        self.action_space = SPACES[kind]
        self.observation_space = spaces.Box(-np.inf, np.inf, (6,), np.float64)
        self._lock = threading.Lock() if locked else None
        self._chance = np.random.default_rng() if chance else None

    def get_keys_to_action(self) -> dict[tuple[str, ...], int]:
        """Two of the five actions are what two of the others are together."""
        return {(): 1, ("w",): 2, ("a",): 3, ("d",): 4, ("w", "a"): 5} if self.kind == "chords" else {}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self._sum = np.zeros(6)
        return self._sum.copy(), {}

    def step(self, action: Any):
        assert self.action_space.contains(action)
        done = spaces.flatten(self.action_space, action) if self.kind in ("board", "pair") else action
        done = np.ravel(np.asarray(done, np.float64))[:6]
        self._sum[: len(done)] += done
        if self._chance is not None:
            self._sum += self._chance.normal()
        return self._sum.copy(), 0.0, False, False, {}

    def render(self):
        picture = np.full((48, 64, 3), 40, np.uint8)
        for lever, value in enumerate(self._sum):
            picture[int(24 + np.clip(value, -20, 20)) - 2 :][:4, 4 + 10 * lever : 12 + 10 * lever] = (240, 176, 72)
        return picture


gymnasium.register("tests/Levers-v0", entry_point=Levers)
