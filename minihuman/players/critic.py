"""A simulated critic: presses good or bad some time after it has seen what came of an action."""

import math
from dataclasses import dataclass

import numpy as np

from minihuman.errors import PlayerError


@dataclass(frozen=True, slots=True)
class Criticising:
    """What sets one critic apart. Delays are ex-Gaussian; their mean is ``mu_ms + tau_ms``."""

    mu_ms: float = 500.0  # from the picture to the key: the normal part's mean
    sigma_ms: float = 60.0  # its standard deviation
    tau_ms: float = 100.0  # the exponential part's mean
    rate: float = 0.3  # chance a step that it presses at all
    mistakes: float = 0.05  # chance that it presses the other key

    def __post_init__(self) -> None:
        """Refuse what no critic can be.

        Raises:
            PlayerError: if a parameter is out of range.
        """
        for name in ("rate", "mistakes"):
            if not 0 <= getattr(self, name) <= 1:
                raise PlayerError(f"{name} is {getattr(self, name)}; a chance is 0 to 1")
        for name in ("mu_ms", "sigma_ms", "tau_ms"):
            if not 0 <= getattr(self, name) < math.inf:
                raise PlayerError(f"{name} is {getattr(self, name)}; use 0 or more")

    @property
    def delay_ms(self) -> float:
        """The mean delay: what a learner would have to find."""
        return self.mu_ms + self.tau_ms


class Critic:
    """Judges one step after the other by what it gained."""

    def __init__(self, criticising: Criticising, rng: np.random.Generator) -> None:
        self._is = criticising
        self._rng = rng

    def press(self, gained_steps: float, shown_ms: float) -> tuple[float, float] | None:
        """When a key goes down and what it says (1 good, -1 bad); None where no key is pressed.

        Args:
            gained_steps: By how much the action has shortened the way.
            shown_ms: When the picture was seen that shows what came of it.
        """
        if self._rng.random() >= self._is.rate:
            return None
        value = 1.0 if gained_steps > 0 else -1.0
        if self._rng.random() < self._is.mistakes:
            value = -value
        delay = self._rng.normal(self._is.mu_ms, self._is.sigma_ms) + self._rng.exponential(self._is.tau_ms)
        return shown_ms + max(100.0, float(delay)), value
