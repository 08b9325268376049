"""A plain environment of a counter and a place, and the register of environments that are odd in one respect."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

PLACES, END = 5, 12


class Plain(gymnasium.Env):
    """Walks between five places; after twelve steps it terminates. Nothing is odd here."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(3)
        self.observation_space = spaces.Box(0, 50, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.count = 0
        self.place = int(self.np_random.integers(PLACES))
        return self.observe(), self.info()

    def step(self, action: Any) -> Any:
        self.move(action)
        return self.observe(), self.reward(), self.count >= END, False, self.info()

    def move(self, action: Any) -> None:
        self.count += 1
        self.place = (self.place + int(np.ravel(action)[0])) % PLACES

    def observe(self) -> Any:
        return np.array([self.place, self.count], np.float32)

    def reward(self) -> Any:
        return float(self.place == 0)

    def info(self) -> Any:
        return {}

    def render(self) -> Any:
        picture = np.full((40, 48, 3), 30, np.uint8)
        picture[8:16, 8 * self.place : 8 * self.place + 8] = (240, 176, 72)
        picture[24:32, : 4 * self.count] = 200
        return picture


@dataclass(frozen=True, slots=True)
class OddEnvironment:
    """One odd environment.

    Attributes:
        refused: what `check` says of it, a regular expression; "" where it plays.
        noticed: what `check` says of one that plays.
        unexportable: what exporters may say of it, a regular expression; "" where all of them work.
    """

    name: str
    refused: str = ""
    noticed: str = ""
    unexportable: str = ""

    @property
    def id(self) -> str:
        """Its id, as a protocol names it."""
        return f"tests.worlds.odd.table:odd/{self.name}-v0"


ODD: dict[str, OddEnvironment] = {}


def odd(refused: str = "", *, noticed: str = "", unexportable: str = "", **registered: Any) -> Callable[[Any], Any]:
    """Register a class or a function that makes an environment, and what is to be said of it."""

    def register(entry_point: Any) -> Any:
        name = entry_point.__name__
        assert name not in ODD, name
        ODD[name] = OddEnvironment(name, refused, noticed, unexportable)
        gymnasium.register(f"odd/{name}-v0", entry_point=entry_point, **registered)
        return entry_point

    return register
