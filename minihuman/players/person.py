"""A simulated person's parameters, and the population that people are drawn from. No world, no keys.

Each parameter has a middle (the population's median) and a spread (the standard deviation of its logarithm between
people). The times follow the literature that is named with each; what decides how long people look for a goal
(``astray``, ``forget``, ``misjudge``) and how much they differ was fitted to the ten people of Chevalier-Boisvert et
al. (2023), whose ten episodes in first-person FourRooms gave a mean reward of 0.88, about 4 time-outs in 100, about 2.4
times the fewest steps, and a standard deviation of 0.066 between people's means.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from minihuman.errors import PlayerError

_CHANCES = ("lapse", "astray", "practice", "forget_keys")
_LONGEST_S = 60.0  # that a press may take


@dataclass(frozen=True, slots=True)
class Person:
    """What sets one simulated person apart; as it stands, the middle of the population.

    Reaction times are ex-Gaussian: a normal part and an exponential one, as choice reaction times are (Luce, 1986).
    """

    mu_ms: float = 330.0  # the normal part's mean before any practice; 300 to 400 are usual (Luce, 1986)
    sigma_ms: float = 50.0  # its standard deviation
    tau_ms: float = 150.0  # the exponential part's mean
    floor_ms: float = 160.0  # nobody is faster; simple reactions take 213 ms on average (Woods et al., 2015)
    repeat: float = 0.55  # a press of the last key again takes this share: no choice any more (Card et al., 1983)
    orient_ms: float = 700.0  # mean time to look at a new episode's first picture before anything is pressed
    post_error_ms: float = 50.0  # added after a press in vain: post-error slowing (Rabbitt, 1966)
    practice: float = 0.35  # share of time and of going astray that practice takes away in the end
    practice_presses: float = 150.0  # by then 63 % of it is gone: exponential, not a power (Heathcote et al., 2000)
    fatigue: float = 0.04  # by how much 1,000 presses slow one down
    lapse: float = 0.015  # chance a press that the finger lands on any key of the pool; does not fall with practice
    astray: float = 0.05  # chance a press, before any practice, of setting off in a wrong direction
    detour_steps: float = 4.0  # mean length of going astray
    misjudge: float = 4.0  # SD, in actions, of how well a place is judged to look from: people search with a limited
    # horizon (Kryven et al., 2024)
    forget: float = 0.002  # chance a second that a place that was seen, a cell or a square metre, is forgotten
    forget_keys: float = 0.05  # chance that a key's meaning is forgotten between blocks

    def __post_init__(self) -> None:
        """Refuse what no person can be.

        Raises:
            PlayerError: if a parameter is out of range.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in _CHANCES and not 0 <= value <= 1:
                raise PlayerError(f"{field.name} is {value}; a chance is 0 to 1")
            if not 0 <= value < math.inf:
                raise PlayerError(f"{field.name} is {value}; use 0 or more")
        if self.detour_steps < 1:
            raise PlayerError(f"detour_steps is {self.detour_steps}; a detour has 1 step or more")
        if self.practice_presses < 1:
            raise PlayerError(f"practice_presses is {self.practice_presses}; use 1 or more")

    def unpractised(self, presses: int) -> float:
        """1 before the first press, falling to ``1 - practice``."""
        return 1 - self.practice * -math.expm1(-presses / self.practice_presses)

    def reaction_ms(self, rng: np.random.Generator, *, presses: int, again: bool, extra_ms: float = 0.0) -> float:
        """A reaction time after so many presses; ``again`` is one to the key pressed last."""
        drawn = rng.normal(self.mu_ms, self.sigma_ms) + rng.exponential(self.tau_ms)
        share = (self.repeat if again else 1.0) * self.unpractised(presses) * (1 + self.fatigue * presses / 1000)
        return float(min(max(self.floor_ms, drawn * share + extra_ms), _LONGEST_S * 1000))


SPREADS = {  # the standard deviation of each parameter's logarithm between people
    "mu_ms": 0.15,
    "sigma_ms": 0.3,
    "tau_ms": 0.4,
    "repeat": 0.1,
    "orient_ms": 0.4,
    "post_error_ms": 0.4,
    "practice": 0.25,
    "practice_presses": 0.5,
    "fatigue": 0.5,
    "lapse": 0.6,
    "astray": 0.8,
    "misjudge": 0.5,
    "forget": 0.8,
}


@dataclass(frozen=True, slots=True)
class Population:
    """Whom people are drawn from: what is fixed is everybody's, the rest varies round ``middle``."""

    middle: Person = Person()  # frozen
    fixed: frozenset[str] = frozenset()
    spread: float = 1.0  # times SPREADS; at 0 everybody is the same person

    @classmethod
    def parse(cls, text: str) -> "Population":
        """Read ``lapse=0.1,tau_ms=300``: what is named is everybody's; ``spread=0`` makes the rest so too.

        Raises:
            PlayerError: if a name is no parameter, or a value no number.
        """
        known = [field.name for field in fields(Person)]
        values: dict[str, Any] = {}
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            if name not in (*known, "spread"):
                raise PlayerError(f"human-like has no parameter {name!r}; it has {', '.join((*known, 'spread'))}")
            try:
                values[name] = float(value)
            except ValueError:
                raise PlayerError(f"human-like: {name} is {value!r}; give a number") from None
        spread = values.pop("spread", 1.0)
        if not 0 <= spread < math.inf:
            raise PlayerError(f"spread is {spread}; use 0 or more")
        return cls(Person(**values), frozenset(values), spread)

    def draw(self, rng: np.random.Generator) -> Person:
        """Somebody."""
        drawn = {}
        for name, spread in SPREADS.items():
            factor = math.exp(self.spread * spread * float(rng.standard_normal()))  # the same draws whatever is fixed
            if name not in self.fixed:
                value = getattr(self.middle, name) * factor
                drawn[name] = min(value, 0.9) if name in _CHANCES else value
        return replace(self.middle, **drawn)
