"""A simulated person: finds its keys by trying them, looks for the goal with what it has seen, forgets, errs, improves.

Not a model of anyone: its parameters are known, so that a study's whole analysis can be tried on data whose truth is
known before the first participant comes. Of the world it acts on what it was shown alone.
"""

import math

import numpy as np

from minihuman.errors import WorldError
from minihuman.players.person import Population
from minihuman.players.port import Player, Press
from minihuman.players.searching import Search, search_of
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World
from minihuman.worlds.hashing import hash64


class HumanLikePlayer(Player):
    """Plays as somebody of a ``Population`` would: knows a key once it has seen what comes of pressing it."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self.person = Population.parse(argument).draw(rng)
        self._rng = rng
        self._presses = 0
        self._lost = False
        self._pool: tuple[str, ...] = ()
        self._plan: EpisodePlan | None = None
        self._understood: dict[str, str] = {}  # key -> action
        self._fruitless: dict[str, int] = {}  # key -> how often nothing was seen to come of it
        self._search: Search | None = None
        self._detour: list[str] = []
        self._last: tuple[str, int] | None = None  # the last key, and what was seen when it was pressed
        self._passed_ms = 0.0  # since it was pressed
        self._in_vain = False  # nothing came of it

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Carry over what is known of the keys, if they are the same ones."""
        before, self._plan, self._pool = self._plan, plan, pool
        if before is None or _places(plan) != _places(before):
            self._understood, self._fruitless = {}, {}
        elif plan.block != before.block:
            kept = [key for key in self._understood if self._rng.random() >= self.person.forget_keys]
            self._understood, self._fruitless = {key: plan.key_map.keys[key] for key in kept}, {}
        if plan.show_keys:
            self._understood = dict(plan.key_map.keys)
        self._detour, self._last, self._lost, self._in_vain = [], None, False, False
        self._search = search_of(world, plan.view, self._misjudged, self._rng)

    def press(self, world: World) -> Press:
        """Look, learn from the last key, then press one.

        Raises:
            PlayerError: if the world is of no kind that has a planner.
        """
        assert self._search is not None, "begin() comes first"
        seen = hash64([repr(world.pose()), world.observation])
        extra_ms = self.person.post_error_ms if self._in_vain else 0.0
        if self._last is None:
            extra_ms = float(self._rng.exponential(self.person.orient_ms))
        else:
            self._learn(*self._last, seen)
            self._search.forget(-math.expm1(-self.person.forget * self._passed_ms / 1000))
        key = self._choose(self._search)
        again = self._last is not None and key == self._last[0]
        self._passed_ms = self.person.reaction_ms(self._rng, presses=self._presses, again=again, extra_ms=extra_ms)
        self._last = key, seen
        self._presses += 1
        return Press(key, self._passed_ms)

    def _learn(self, key: str, before: int, seen: int) -> None:
        """What has the last key done?"""
        assert self._plan is not None
        assert self._search is not None
        action = self._plan.key_map.keys.get(key)
        self._in_vain = seen == before or action is None
        if self._in_vain:
            self._fruitless[key] = self._fruitless.get(key, 0) + 1
        if action is not None:
            self._search.did(action, in_vain=self._in_vain)
            if not self._in_vain:
                self._understood[key] = action

    def _choose(self, search: Search) -> str:
        way = self._way(search)
        if self._rng.random() < self.person.lapse:
            return self._any(self._pool)
        astray = self.person.astray * self.person.unpractised(self._presses)
        if not self._detour and self._understood and self._rng.random() < astray:
            length = int(self._rng.geometric(1 / self.person.detour_steps))
            self._detour = [self._any(sorted(self._understood)) for _ in range(length)]
        if self._detour:
            return self._detour.pop()
        known = [key for key, action in self._understood.items() if way[:1] == [action]]
        return known[0] if known else self._untried()

    def _way(self, search: Search) -> list[str]:
        """What to do from here; nothing in an episode in which it was once too hard to find."""
        if not self._lost:
            try:
                return search.way()
            except WorldError:
                self._lost = True
        return []

    def _untried(self) -> str:
        """One of the keys not understood yet, those that seemed dead last."""
        unknown = [key for key in self._pool if key not in self._understood] or list(self._pool)
        fewest = min(self._fruitless.get(key, 0) for key in unknown)
        return self._any([key for key in unknown if self._fruitless.get(key, 0) == fewest])

    def _misjudged(self, count: int) -> np.ndarray:
        """How far off so many judgements are, in actions."""
        return self._rng.normal(0.0, self.person.misjudge, count)

    def _any(self, keys: list[str] | tuple[str, ...]) -> str:
        return keys[int(self._rng.integers(len(keys)))]


def _places(plan: EpisodePlan) -> dict[str, int]:
    """Where in the block's list of actions each key's action stands: what stays when keys are carried over."""
    return {key: plan.actions.index(action) for key, action in plan.key_map.keys.items() if action in plan.actions}
