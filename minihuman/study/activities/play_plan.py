"""The plan of a block that is played: what is shown around its episodes, and when it is over."""

from collections.abc import Sequence
from typing import Literal

import msgspec


class Criterion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Practice goes on until so many of the last episodes reached the goal; a block's ``episodes`` are the most."""

    successes: int
    of: int  # the last so many
    otherwise: Literal["go_on", "end"] = "go_on"  # what follows if it is never met

    def met(self, outcomes: Sequence[str]) -> bool:
        """Whether the last outcomes are good enough; fewer than ``of`` may be."""
        return sum(outcome == "goal" for outcome in outcomes[-self.of :]) >= self.successes


class Points(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an episode is worth."""

    goal: float = 0.0
    timeout: float = 0.0
    failure: float = 0.0
    per_step: float = 0.0
    per_reward: float = 0.0

    def of(self, outcome: str, steps: int, reward: float) -> float:
        """The points of an episode; none for an abandoned one."""
        if outcome == "abandoned":
            return 0.0
        by_outcome = {"goal": self.goal, "timeout": self.timeout, "failure": self.failure}[outcome]
        return by_outcome + self.per_step * steps + self.per_reward * reward


class PlayPlan(msgspec.Struct, frozen=True):
    """A block: which episodes, and what surrounds them. Empty texts and times of 0 show nothing."""

    block: int  # the place among the session's blocks
    blocks: int  # how many the session has
    first: int  # index of its first episode
    count: int
    title: str = ""
    instruction: tuple[str, ...] = ()  # pages
    feedback: dict[str, str] = {}  # by outcome
    rest: str = ""  # after the block
    rest_s: float = 0.0  # the shortest rest
    interval_ms: float = 0.0  # nothing on the screen before an episode
    fixation_ms: float = 0.0  # then a cross
    hold_ms: float = 0.0  # the last picture stays
    marks: bool = False  # with a mark for its outcome
    max_s: float = 0.0  # an episode's longest playing time; 0: none
    block_max_s: float = 0.0
    until: Criterion | None = None
    points: Points | None = None
    show_points: bool = False  # the running total is on the screen
    mission: str = ""  # instead of the world's own words
