"""Worlds about getting to one red box soon: the reward is for being near it, and falls with every step."""

from collections.abc import Sequence
from typing import Any

from minihuman.worlds.contract import Bounds
from minihuman.worlds.first_person.entities import Box, Entity
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.rules import MOVES
from minihuman.worlds.first_person.way.planner import least_steps, plan


class GoalEnv(FirstPersonEnv):
    """Base of the worlds that end near ``self.box``, which their ``build`` places."""

    box: Box

    def __init__(self, *, max_steps: int | None = 250, **options: Any) -> None:
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def judge(self, action: str) -> tuple[float, bool]:
        """1 down to 0.8 near the box, which ends the episode."""
        return (self.prompt_reward(), True) if self.near(self.box) else (0.0, False)

    def sought(self) -> tuple[Entity, ...]:
        """The box."""
        return (self.box,)

    def way(self) -> Sequence[int] | None:
        """Turns and steps to where the box is near; empty if none were found."""
        return plan(self, self.box) or ()

    def bounds(self) -> Bounds:
        """The length of that way, and what no way undercuts."""
        return Bounds(least_steps(self, self.box), len(self.way() or ()) or None)
