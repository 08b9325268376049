"""An episode as a page computes it, in Python: from the states that the server sends, with the page's digests."""

import numpy as np

from minihuman.web.computed import PageWorld
from minihuman.web.messages import (
    EpisodeRules,
    FirstPersonPosition,
    FirstPersonState,
    GridPosition,
    GridState,
    WorldPosition,
)
from minihuman.worlds.first_person import rules as first_person
from minihuman.worlds.first_person.state_digest import digest_state


class PageSteps:
    """Where keys lead.

    Args:
        world_id: of the episode's world.
        rules: that the server sent, with the first state.
    """

    def __init__(self, world_id: str, rules: EpisodeRules) -> None:
        assert rules.computed is not None
        self.rules = rules
        self.start: WorldPosition = rules.computed  # where the server said last that it was
        first = rules.computed
        self._inside = _GridSteps(world_id) if isinstance(first, GridState) else _FirstPersonSteps(first)
        self.place(rules.computed)

    def place(self, state: WorldPosition) -> None:
        """Go where the server is."""
        self._inside.place(state, np.array([int(word) for word in state.rng_state], np.uint64))
        self.start, self.step, self.ended = state, state.step, False

    def press(self, key: str) -> str:
        """Make a key's step; its digest, "" if it makes none."""
        action = self.rules.actions.get(key)
        return "" if action is None else self.act(action)

    def act(self, action: int) -> str:
        """Make a step; its digest, "" if the episode is over."""
        if self.ended:
            return ""
        reward, terminated, truncated = self._inside.step(action)
        self.step += 1
        truncated = truncated or (self.step >= self.rules.most_steps and not terminated)
        self.ended = terminated or truncated
        return self._inside.digest(reward, terminated, truncated)


class _GridSteps:
    def __init__(self, world_id: str) -> None:
        self._world = PageWorld(world_id)
        self._world.keep_steps()
        self._world.reset(0)

    def place(self, state: WorldPosition, words: np.ndarray) -> None:
        assert isinstance(state, GridPosition)
        env, runs = self._world.unwrapped, np.array(state.row)
        row = np.repeat(runs[::2], runs[1::2]).astype(np.int32)
        env.restore(env.save()._replace(row=row, rng_state=words))

    def step(self, action: int) -> tuple[float, bool, bool]:
        made = self._world.step(action)
        return made.reward, made.terminated, made.truncated

    def digest(self, reward: float, terminated: bool, truncated: bool) -> str:
        return self._world.digest(reward, terminated=terminated, truncated=truncated)


class _FirstPersonSteps:
    def __init__(self, first: FirstPersonState) -> None:
        walls, rooms, edges = (np.frombuffer(each).copy() for each in (first.walls, first.rooms, first.edges))
        self._walls, self._rooms = walls.reshape(-1, 4), (rooms.reshape(-1, 7), edges.reshape(-1, 4))

    def place(self, state: WorldPosition, words: np.ndarray) -> None:
        assert isinstance(state, FirstPersonPosition)
        things, self._numbers = (np.frombuffer(each).copy() for each in (state.things, state.numbers))
        self._things, self._words = things.reshape(-1, first_person.COLUMNS), words
        self._plan = self._walls, words, *self._rooms

    def step(self, action: int) -> tuple[float, bool, bool]:
        status = first_person.step(self._things, self._numbers, *self._plan, action)
        ends = bool(status & first_person.TERMINATED), bool(status & first_person.TRUNCATED)
        return float(self._numbers[first_person.REWARD]), *ends

    def digest(self, reward: float, terminated: bool, truncated: bool) -> str:
        ends = 1 if terminated else 2 if truncated else 0
        outcome = np.array([np.float64(reward).view(np.uint64), ends], np.uint64)
        return f"{int(digest_state(self._things, self._numbers, self._words, outcome)):016x}"
