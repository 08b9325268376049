"""What should have been done instead, gathered from a session's events."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.study.activities.correction_events import (
    CorrectionBegun,
    CorrectionEnded,
    CorrectionOutcome,
    CorrectionStepped,
    EpisodeLookedAt,
)


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """A demonstration from a step of an episode, ``n`` steps long. Times are session time."""

    part: int  # index into the plan's parts
    correction: int  # 0 for the part's first
    episode: int  # that it corrects, 0 for the session's first
    attempt: int
    step: int  # after which it begins, 0 for the reset
    world: str
    options: str  # JSON
    seed: int
    before: NDArray[np.int64]  # (step,) the episode's actions that lead there from the reset
    actions: NDArray[np.int64]  # (n,) what should have been done
    keys: tuple[str, ...]  # (n,)
    key_t_ns: NDArray[np.int64]  # (n,)
    t_ns: NDArray[np.int64]  # (n + 1,) its beginning, then each step
    rewards: NDArray[np.float64]  # (n,)
    terminated: NDArray[np.bool_]  # (n,)
    truncated: NDArray[np.bool_]  # (n,)
    state_hashes: NDArray[np.uint64]  # (n + 1,)
    outcome: CorrectionOutcome


def corrections(events: Iterable[object]) -> tuple[Corrected, ...]:
    """Every correction of a session, in order; one that the log was cut off in counts as stopped there."""
    looked: dict[tuple[int, int, int], EpisodeLookedAt] = {}
    found: list[Corrected] = []
    begun: CorrectionBegun | None = None
    steps: list[CorrectionStepped] = []

    def close(outcome: CorrectionOutcome) -> None:
        if begun is not None and (of := looked.get((begun.part, begun.episode, begun.attempt))) is not None:
            found.append(_corrected(of, begun, steps, outcome))

    for event in events:
        match event:
            case EpisodeLookedAt():
                looked[event.part, event.episode, event.attempt] = event
            case CorrectionBegun():
                close("stopped")
                begun, steps = event, []
            case CorrectionStepped():
                steps.append(event)
            case CorrectionEnded():
                close(event.outcome)
                begun = None
    close("stopped")
    return tuple(found)


def _corrected(
    of: EpisodeLookedAt, begun: CorrectionBegun, steps: list[CorrectionStepped], outcome: CorrectionOutcome
) -> Corrected:
    return Corrected(
        part=begun.part,
        correction=begun.correction,
        episode=begun.episode,
        attempt=begun.attempt,
        step=begun.step,
        world=of.world,
        options=of.options,
        seed=of.seed,
        before=np.array(of.actions[: begun.step], np.int64),
        actions=np.array([step.action for step in steps], np.int64),
        keys=tuple(step.key for step in steps),
        key_t_ns=np.array([step.key_t_ns for step in steps], np.int64),
        t_ns=np.array([begun.t_ns, *(step.t_ns for step in steps)], np.int64),
        rewards=np.array([step.reward for step in steps], np.float64),
        terminated=np.array([step.terminated for step in steps], np.bool_),
        truncated=np.array([step.truncated for step in steps], np.bool_),
        state_hashes=np.array([begun.state_hash, *(step.state_hash for step in steps)], np.uint64),
        outcome=outcome,
    )
