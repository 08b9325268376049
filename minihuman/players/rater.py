"""A simulated rater: says which of two stretches is better, with known noise and known lapses."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from minihuman.errors import PlayerError


@dataclass(frozen=True, slots=True)
class Judging:
    """What sets one rater apart: the chance of "right" is 1 / (1 + exp(-beta (right - left))), lapses apart."""

    beta: float = 3.0  # how sharply it tells returns apart (Bradley and Terry, 1952)
    lapse: float = 0.05  # chance that it presses either key without looking
    equal_within: float = 0.0  # returns that differ by no more are called equal

    def __post_init__(self) -> None:
        """Refuse what no rater can be.

        Raises:
            PlayerError: if a parameter is out of range.
        """
        if not 0 <= self.lapse <= 1:
            raise PlayerError(f"lapse is {self.lapse}; a chance is 0 to 1")
        for name in ("beta", "equal_within"):
            if not 0 <= getattr(self, name) < math.inf:
                raise PlayerError(f"{name} is {getattr(self, name)}; use 0 or more")


class Rater:
    """Compares returns, one pair after the other."""

    def __init__(self, judging: Judging, rng: np.random.Generator) -> None:
        self._judging = judging
        self._rng = rng

    def answer(self, left: float, right: float) -> Literal["left", "right", "equal"]:
        """Which of two true returns is better, as far as it can tell."""
        if self._rng.random() < self._judging.lapse:
            return "right" if self._rng.random() < 0.5 else "left"
        if abs(right - left) <= self._judging.equal_within:
            return "equal"
        chance = 1 / (1 + math.exp(-max(-500.0, min(500.0, self._judging.beta * (right - left)))))
        return "right" if self._rng.random() < chance else "left"
