"""Worlds in wrappers of a lab's own: one that hides the picture, one that keeps counts, one that keeps a secret."""

from typing import Any

import gymnasium
import numpy as np

import minihuman  # noqa: F401
from minihuman.worlds.grid.wrappers import PositionBonus


class Blindfold(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Nothing is seen from the third step on."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.steps = 0

    def reset(self, **options: Any) -> Any:
        self.steps = 0
        return super().reset(**options)

    def step(self, action: Any) -> Any:
        self.steps += 1
        return super().step(action)

    def render(self) -> Any:
        picture = super().render()
        return np.zeros_like(picture) if self.steps > 2 else picture


class Secretive(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Keeps what nobody can compare."""

    def step(self, action: Any) -> Any:
        self.last = object()
        return super().step(action)


class Failing(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Does not close."""

    def close(self) -> None:
        raise RuntimeError("the lights stay on")


for name, wrapper in {"Blindfold": Blindfold, "Bonus": PositionBonus, "Secret": Secretive, "Failing": Failing}.items():
    gymnasium.register(
        f"tests/{name}-v0",
        entry_point=lambda wrapper=wrapper, **options: wrapper(
            gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0", disable_env_checker=True, **options)
        ),
    )
