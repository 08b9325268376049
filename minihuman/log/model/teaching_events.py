"""What a session recorded about teaching: interventions and advice per episode, compared pairs, and corrections."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.agent_blocks.events import Advised, ControlChanged
from minihuman.activities.correction.events import (
    CorrectionBegun,
    CorrectionEnded,
    CorrectionOutcome,
    CorrectionStepped,
    EpisodeLookedAt,
)
from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.events import Preferred, StretchShown
from minihuman.activities.rating.events import Rated
from minihuman.experiment.machine.events import ActivityEvent


@dataclass(frozen=True, slots=True)
class PairComparison:
    """A pair of clips and the answer to it. Times are session time."""

    part: int  # index into the plan's parts
    pair: int  # 0 for the first
    left: EpisodeClip
    right: EpisodeClip
    preference: Preferred

    @property
    def answer_ms(self) -> float:
        """Return the time in milliseconds from the first displayed picture to the key; NaN if it is unknown."""
        if self.preference.shown_ns:
            return (self.preference.pressed_ns - self.preference.shown_ns) / 1e6
        return float("nan")


def gather_comparisons(events: Iterable[object]) -> tuple[PairComparison, ...]:
    """Return every answered pair of a session, in order; a pair shown again after an interruption appears once."""
    clips: dict[tuple[int, int, str], EpisodeClip] = {}
    comparisons = []
    for event in events:
        match event:
            case StretchShown():
                clips[event.part, event.pair, event.side] = event.stretch
            case Preferred():
                left, right = (clips.get((event.part, event.pair, side)) for side in ("left", "right"))
                if left is not None and right is not None:
                    comparisons.append(PairComparison(event.part, event.pair, left, right, event))
    return tuple(comparisons)


@dataclass(frozen=True, slots=True, eq=False)
class CorrectionRecord:
    """A demonstration of ``n`` steps that starts from a step of an episode. Times are session time."""

    part: int  # index into the plan's parts
    correction: int  # 0 for the part's first
    episode: int  # the corrected episode, 0 for the session's first
    attempt: int
    step: int  # the last step before the correction, 0 for the reset
    world: str
    options: str  # JSON
    seed: int
    before: NDArray[np.int64]  # (step,) the episode's actions that lead there from the reset
    actions: NDArray[np.int64]  # (n,) the actions that the person prefers
    keys: tuple[str, ...]  # (n,)
    key_t_ns: NDArray[np.int64]  # (n,)
    t_ns: NDArray[np.int64]  # (n + 1,) its beginning, then each step
    rewards: NDArray[np.float64]  # (n,)
    terminated: NDArray[np.bool_]  # (n,)
    truncated: NDArray[np.bool_]  # (n,)
    state_hashes: NDArray[np.uint64]  # (n + 1,)
    outcome: CorrectionOutcome


def gather_corrections(events: Iterable[object]) -> tuple[CorrectionRecord, ...]:
    """Return every correction of a session, in order; one that was cut off counts as stopped."""
    episodes: dict[tuple[int, int, int], EpisodeLookedAt] = {}
    corrections: list[CorrectionRecord] = []
    beginning: CorrectionBegun | None = None
    steps: list[CorrectionStepped] = []

    def add_correction(outcome: CorrectionOutcome) -> None:
        """Add the correction that began last, unless it has ended or its episode is unknown."""
        if beginning is None:
            return
        episode = episodes.get((beginning.part, beginning.episode, beginning.attempt))
        if episode is not None:
            corrections.append(_build_correction(episode, beginning, steps, outcome))

    for event in events:
        match event:
            case EpisodeLookedAt():
                episodes[event.part, event.episode, event.attempt] = event
            case CorrectionBegun():
                add_correction("stopped")
                beginning = event
                steps = []
            case CorrectionStepped():
                steps.append(event)
            case CorrectionEnded():
                add_correction(event.outcome)
                beginning = None
    add_correction("stopped")
    return tuple(corrections)


def _build_correction(
    episode: EpisodeLookedAt, beginning: CorrectionBegun, steps: list[CorrectionStepped], outcome: CorrectionOutcome
) -> CorrectionRecord:
    return CorrectionRecord(
        part=beginning.part,
        correction=beginning.correction,
        episode=beginning.episode,
        attempt=beginning.attempt,
        step=beginning.step,
        world=episode.world,
        options=episode.options,
        seed=episode.seed,
        before=np.array(episode.actions[: beginning.step], np.int64),
        actions=np.array([step.action for step in steps], np.int64),
        keys=tuple(step.key for step in steps),
        key_t_ns=np.array([step.key_t_ns for step in steps], np.int64),
        t_ns=np.array([beginning.t_ns, *(step.t_ns for step in steps)], np.int64),
        rewards=np.array([step.reward for step in steps], np.float64),
        terminated=np.array([step.terminated for step in steps], np.bool_),
        truncated=np.array([step.truncated for step in steps], np.bool_),
        state_hashes=np.array([beginning.state_hash, *(step.state_hash for step in steps)], np.uint64),
        outcome=outcome,
    )


NO_ADVICE = -1  # in place of a policy's action if it gave none


@dataclass(frozen=True, slots=True, eq=False)
class TeachingRecord:
    """An agent's part in the ``n`` steps of an episode: control, advice and ratings. Times are session time."""

    policy: str  # the SHA-256 of its file, or an agent's name; "" if there was none yet
    by_person: NDArray[np.bool_]  # (n,) whether the person was in control at the step
    policy_actions: NDArray[np.int64]  # (n,) the action that the policy advised, or NO_ADVICE
    probabilities: NDArray[np.float32]  # (n, actions); zeros without advice
    controls: tuple[ControlChanged, ...]  # each change of who is in control
    ratings: tuple[Rated, ...]  # presses of a rating key while it ran, or while its last picture was held

    @property
    def interventions(self) -> int:
        """Return the number of times that the person took over from the agent."""
        return sum(change.reason == "key" for change in self.controls)

    def agreement(self, actions: NDArray[np.int64]) -> float:
        """Return the share of the person's steps with advice in which the policy advised the action that was taken.

        NaN if there are no such steps.

        Args:
            actions: the actions of the episode's steps, (n,).
        """
        is_compared = self.by_person & (self.policy_actions != NO_ADVICE)
        if is_compared.any():
            return float((self.policy_actions[is_compared] == actions[is_compared]).mean())
        return np.nan


def gather_teaching(events: Sequence[ActivityEvent], *, steps: int, actions: int, policy: str) -> TeachingRecord | None:
    """Build the teaching record of an episode from its events; return None if no agent took part.

    Args:
        events: the episode's events, in the order logged.
        steps: the number of the episode's steps.
        actions: the number of the world's actions.
        policy: the policy in force when the episode began.
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
    return TeachingRecord(policy, by_person, policy_actions, probabilities, controls, ratings)
