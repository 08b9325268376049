"""Worlds whose ends say something each in its own way: they end by themselves at their third step."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from minihuman.worlds.first_person.layouts.one_room import OneRoom
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.object_kinds import goal
from minihuman.worlds.grid.team_grid import TeamGrid
from minihuman.worlds.team import TeamStep
from tests.worlds.duet import Duet

STEPS = 3
Ending = tuple[float, bool, bool, dict[str, Any]]  # reward, terminated, truncated, info

ENDINGS: dict[str, Ending] = {
    "paid": (1.0, True, False, {}),
    "minus": (-1.0, True, False, {}),
    "cut": (1.0, False, True, {}),
    "array": (-1.0, True, False, {"is_success": np.array([True])}),
    "array-false": (1.0, True, False, {"is_success": np.array([[0.0]])}),
    "dictionary": (0.0, True, False, {"success": {"task": np.bool_(True)}}),
    "dictionary-of-two": (0.0, True, False, {"success": {"task": True, "half": False}}),
    "nested": (0.0, True, False, {"robot": {"task": np.float32(1.0), "half": False}}),
    "never-terminates": (0.0, False, True, {"is_success": np.float32(1.0)}),
    "never-succeeds": (0.0, False, True, {"is_success": 0}),
    "half": (1.0, True, False, {"is_success": 0.5}),
    "not-a-number": (1.0, True, False, {"is_success": float("nan")}),
    "vector": (1.0, True, False, {"is_success": np.array([True, True, False])}),
    "text": (1.0, True, False, {"is_success": "yes"}),
    "nothing": (1.0, True, False, {"is_success": None}),
    "first-key": (1.0, True, False, {"is_success": False, "success": True}),
    "coins": (0.0, True, False, {"coins": np.int64(7), "where": np.array([1, 2]), "said": "oh", "set": {1}}),
}
IN_PASSING = {"passes": ({"is_success": True}, {"is_success": False})}  # in the steps before the last, and in that


class Ending3(gymnasium.Env[Any, Any]):
    """Ends as its kind says."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's own shape
    action_space = spaces.Discrete(2)
    observation_space = spaces.Box(0, 99, (1,), np.int64)

    def __init__(self, kind: str, render_mode: str | None = None) -> None:
        self.kind = kind
        self.render_mode = render_mode
        self.steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps = 0
        return np.array([0]), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        observed = np.array([self.steps])
        if self.kind in IN_PASSING:
            before, last = IN_PASSING[self.kind]
            return observed, 0.0, self.steps == STEPS, False, dict(before if self.steps < STEPS else last)
        if self.steps < STEPS:
            return observed, 0.0, False, False, {}
        reward, terminated, truncated, info = ENDINGS[self.kind]
        return observed, reward, terminated, truncated, dict(info)

    def render(self) -> Any:
        return np.full((32, 32, 3), 40 * self.steps, np.uint8)


class OwnGrid(GridWorld):
    """A grid world of a laboratory's own, which judges its third step."""

    def __init__(self, reward: float = 1.0, says: Any = None, **options: Any) -> None:
        super().__init__(width=5, height=5, max_steps=20, **options)
        self.reward, self.says = reward, says

    def layout(self, grid: Layout) -> None:
        grid.wall_rect()
        grid.put(goal(), 3, 3)
        grid.put_agent(1, 1, 0)

    def reward_and_done(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        return (self.reward, True) if self.steps_done == STEPS else (0.0, False)

    @property
    def steps_done(self) -> int:
        return int(self.step_count)

    def step(self, action: int) -> Any:
        *made, info = super().step(action)
        return (*made, info if self.says is None else {**info, "is_success": self.says})


class OwnRoom(OneRoom):
    """A first person world of a laboratory's own."""

    def reward_and_done(self, action: str) -> tuple[float, bool]:
        return 0.5, True


class OwnTeam(TeamGrid):
    """Of two bodies one is paid."""

    shared_reward = False

    def __init__(self) -> None:
        super().__init__(width=6, height=5, max_steps=20)

    def layout(self, grid: Any) -> None:
        grid.wall_rect()
        grid.put_agent(1, 1, 0, body=0)
        grid.put_agent(3, 3, 0, body=1)

    def reward_and_done(self, actions: Any, rewards: Any, terminated: bool) -> Any:
        return (1.0, 0.0), True


class SaidDuet(Duet):
    """A PettingZoo environment as a team world: each agent's info says its own."""

    def step(self, actions: Any) -> TeamStep:
        super().step(actions)
        return TeamStep((0.0, 0.0), True, False, infos=({"is_success": True}, {"is_success": False}))


gymnasium.register("tests/Ending-v0", entry_point=Ending3, disable_env_checker=True, order_enforce=False)
gymnasium.register("tests/OwnGrid-v0", entry_point=OwnGrid, disable_env_checker=True, order_enforce=False)
gymnasium.register("tests/OwnRoom-v0", entry_point=OwnRoom, disable_env_checker=True, order_enforce=False)
gymnasium.register("tests/OwnTeam-v0", entry_point="tests.worlds.odd_ends:OwnTeam")
gymnasium.register("tests/SaidDuet-v0", entry_point="tests.worlds.odd_ends:SaidDuet")
