"""The results of a world's reset and step, in the form that a session needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from minihuman.worlds.adapters.success import encode_info, read_success
from minihuman.worlds.outcomes import OutcomeRule, StepFacts


@dataclass(frozen=True, slots=True)
class ResetResult:
    """The result of a reset."""

    observation_hash: int
    mission: str  # "" where the world states none
    onset: bool = False  # info["onset"]: the first picture shows a stimulus onset


@dataclass(frozen=True, slots=True)
class StepResult:
    """The result of a step."""

    reward: float
    terminated: bool
    truncated: bool  # the environment's own limit; a session adds its plan's
    observation_hash: int
    onset: bool = False  # info["onset"]: the picture after the step shows a stimulus onset
    info: Mapping[str, Any] = field(default_factory=dict)  # the world's own
    is_own: bool = False  # whether the world is a laboratory's own, in which an end with a reward above 0 is success

    def find_success(self, rule: OutcomeRule) -> bool | None:
        """Return whether the world says that the episode succeeded; None if it does not say, or the rule does not ask.

        ``info`` takes precedence over the reward of a laboratory's own world.
        """
        if not rule.asks_world:
            return None
        stated = read_success(self.info, rule.info_key)
        if stated is not None or rule.info_key or not self.is_own:
            return stated
        return self.terminated and self.reward > 0

    def collect_facts(self, rule: OutcomeRule, *, return_: float, spent: bool = False) -> StepFacts:
        """Return the facts about this step that an outcome rule examines.

        Args:
            rule: the rule
            return_: the sum of the episode's rewards, this step's included
            spent: whether this was the last step of a session's own limit, which counts as truncation
        """
        return StepFacts(self.reward, return_, self.terminated, self.truncated or spent, self.find_success(rule))

    def encode_info(self, keys: Sequence[str]) -> str:
        """Return chosen keys of ``info`` as JSON."""
        return encode_info(self.info, keys)
