"""A simulated person: has to find its keys by trying them, plans with noise, lapses, is slow at times, and improves.

Not a model of anyone: its parameters are known, so that a study's whole analysis can be tried on data whose truth is
known before the first participant comes.
"""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from minihuman.errors import PlayerError, WorldError
from minihuman.players.exploring import Searcher
from minihuman.players.port import Player, Press, way_of
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World
from minihuman.worlds.hashing import hash64

_UNDO = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}


@dataclass(frozen=True, slots=True)
class Person:
    """What sets one simulated person apart. Probabilities and times are those of the first episode."""

    mu_ms: float = 320.0  # reaction times are ex-Gaussian: the normal part's mean
    sigma_ms: float = 60.0  # its standard deviation
    tau_ms: float = 180.0  # the exponential part's mean
    lapse: float = 0.04  # chance a press that the finger lands on any key of the pool
    astray: float = 0.06  # chance a press of setting off in a wrong direction
    detour_steps: float = 3.0  # mean length of going astray
    practice: float = 0.3  # exponent: all of the above but detours fall as episodes ** -practice

    def __post_init__(self) -> None:
        """Refuse what no person can be.

        Raises:
            PlayerError: if a parameter is out of range.
        """
        for name in ("lapse", "astray"):
            if not 0 <= getattr(self, name) <= 1:
                raise PlayerError(f"{name} is {getattr(self, name)}; a chance is 0 to 1")
        for name in ("mu_ms", "sigma_ms", "tau_ms", "practice"):
            if not 0 <= getattr(self, name) < math.inf:
                raise PlayerError(f"{name} is {getattr(self, name)}; use 0 or more")
        if not 1 <= self.detour_steps < math.inf:
            raise PlayerError(f"detour_steps is {self.detour_steps}; a detour has 1 step or more")

    @classmethod
    def parse(cls, text: str) -> "Person":
        """Read ``lapse=0.1,tau_ms=300``; what is not named keeps its default.

        Raises:
            PlayerError: if a name is no parameter, or a value no number.
        """
        known = [field.name for field in fields(cls)]
        values: dict[str, Any] = {}
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            if name not in known:
                raise PlayerError(f"human-like has no parameter {name!r}; it has {', '.join(known)}")
            try:
                values[name] = float(value)
            except ValueError:
                raise PlayerError(f"human-like: {name} is {value!r}; give a number") from None
        return cls(**values)


class HumanLikePlayer(Player):
    """Plays as a ``Person`` would: knows a key's action once it has seen the picture change after pressing it."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self.person = Person.parse(argument)
        self._rng = rng
        self._episodes = 0
        self._lost = False
        self._pool: tuple[str, ...] = ()
        self._plan: EpisodePlan | None = None
        self._understood: dict[str, str] = {}  # key -> action
        self._fruitless: dict[str, int] = {}  # key -> how often nothing was seen to come of it
        self._way: list[str] = []
        self._searcher: Searcher | None = None  # where an instruction says what to do
        self._detour: list[str] = []
        self._last: tuple[str, int] | None = None  # the last key, and what was seen when it was pressed

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Carry over what is known of the keys, if they are the same ones."""
        if self._plan is not None and _places(plan) == _places(self._plan):
            self._understood = {key: plan.key_map.keys[key] for key in self._understood}
        else:
            self._understood, self._fruitless = {}, {}
        if plan.show_keys:
            self._understood = dict(plan.key_map.keys)
        self._plan, self._pool = plan, pool
        self._episodes += 1
        self._way, self._detour, self._last, self._lost = [], [], None, False
        self._searcher = Searcher(world) if world.clauses() else None

    def press(self, world: World) -> Press:
        """Look, learn from the last key, then press one.

        Raises:
            PlayerError: if the world is of no kind that has a planner.
        """
        seen = hash64([repr(world.pose()), world.observation])
        if self._last is not None:
            self._learn(*self._last, seen)
        key = self._choose(world)
        self._last = key, seen
        return Press(key, self._reaction_ms())

    def _learn(self, key: str, before: int, seen: int) -> None:
        """What has the last key done, and is the way still the way?"""
        assert self._plan is not None
        action = self._plan.key_map.keys.get(key)
        if seen == before or action is None:
            self._fruitless[key] = self._fruitless.get(key, 0) + 1
            return
        self._understood[key] = action
        if self._way[:1] == [action]:
            self._way.pop(0)
        elif self._way and action in _UNDO:
            self._way.insert(0, _UNDO[action])
        else:
            self._way = []

    def _choose(self, world: World) -> str:
        if self._happens(self.person.lapse):
            return self._any(self._pool)
        if not self._detour and self._understood and self._happens(self.person.astray):
            length = int(self._rng.geometric(1 / self.person.detour_steps))
            self._detour = [self._any(sorted(self._understood)) for _ in range(length)]
        if self._detour:
            return self._detour.pop()
        if self._searcher is not None:
            self._way = self._searcher.way()
        elif not self._way:
            self._way = self._planned(world)
        known = [key for key, action in self._understood.items() if self._way[:1] == [action]]
        return known[0] if known else self._untried()

    def _planned(self, world: World) -> list[str]:
        """The way from here; none in an episode in which one was once too hard to find."""
        if not self._lost:
            try:
                return way_of(world)
            except WorldError:
                self._lost = True
        return []

    def _untried(self) -> str:
        """One of the keys not understood yet, those that seemed dead last."""
        unknown = [key for key in self._pool if key not in self._understood] or list(self._pool)
        fewest = min(self._fruitless.get(key, 0) for key in unknown)
        return self._any([key for key in unknown if self._fruitless.get(key, 0) == fewest])

    def _reaction_ms(self) -> float:
        person = self.person
        normal = self._rng.normal(person.mu_ms, person.sigma_ms)
        return max(80.0, float(normal + self._rng.exponential(person.tau_ms)) * self._unpractised)

    def _happens(self, chance: float) -> bool:
        return bool(self._rng.random() < chance * self._unpractised)

    @property
    def _unpractised(self) -> float:
        """1 in the first episode, less in each later one."""
        return float(self._episodes**-self.person.practice)

    def _any(self, keys: list[str] | tuple[str, ...]) -> str:
        return keys[int(self._rng.integers(len(keys)))]


def _places(plan: EpisodePlan) -> dict[str, int]:
    """Where in the block's list of actions each key's action stands: what stays when keys are carried over."""
    return {key: plan.actions.index(action) for key, action in plan.key_map.keys.items() if action in plan.actions}
