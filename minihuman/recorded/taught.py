"""An episode that an agent played beside a person: who steered, what the policy would have done, what was rated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.study.activities.agent_events import Advised, ControlChanged, Rated
from minihuman.study.events import KindEvent

NO_ADVICE = -1  # instead of a policy's action, where it gave none


@dataclass(frozen=True, slots=True, eq=False)
class Taught:
    """Beside the ``n`` steps of an ``Episode``. Times are session time."""

    policy: str  # that played: the SHA-256 of its file, or an agent's name; "" where there was none yet
    by_person: NDArray[np.bool_]  # (n,) who steered when the step was made
    policy_actions: NDArray[np.int64]  # (n,) the world's action that the policy would have done; NO_ADVICE
    probabilities: NDArray[np.float32]  # (n, actions) by the world's action number; zeros where there are none
    controls: tuple[ControlChanged, ...]  # who steers from when on
    ratings: tuple[Rated, ...]  # presses that said good or bad while it ran, or while its last picture was held

    @property
    def interventions(self) -> int:
        """How often the person took over from the agent."""
        return sum(change.reason == "key" for change in self.controls)

    def agreement(self, actions: NDArray[np.int64]) -> float:
        """The share of the person's steps at which the policy would have done the same; NaN without any."""
        mine = self.by_person & (self.policy_actions != NO_ADVICE)
        return float((self.policy_actions[mine] == actions[mine]).mean()) if mine.any() else np.nan


def taught(events: Sequence[KindEvent], *, steps: int, actions: int, policy: str) -> Taught | None:
    """What an episode's events say of teaching; None where an agent had no part in it.

    Args:
        events: of the episode, in the order logged.
        steps: how many it has.
        actions: how many the world has.
        policy: that was in force when it began.
    """
    controls = tuple(event for event in events if isinstance(event, ControlChanged))
    if not controls:
        return None
    by_person = np.zeros(steps, np.bool_)
    ends = [*(change.step for change in controls[1:]), steps]
    for change, end in zip(controls, ends, strict=True):
        by_person[change.step : end] = change.who == "person"
    policy_actions = np.full(steps, NO_ADVICE, np.int64)
    probabilities = np.zeros((steps, actions), np.float32)
    for event in events:
        if isinstance(event, Advised) and event.step < steps and len(event.probabilities) == actions:
            policy_actions[event.step] = event.action
            probabilities[event.step] = event.probabilities
    ratings = tuple(event for event in events if isinstance(event, Rated))
    return Taught(policy, by_person, policy_actions, probabilities, controls, ratings)
