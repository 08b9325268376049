"""Credit assignment for ratings: which step a press was about, and how long after the picture people press.

The picture that shows a step's outcome is seen from the moment it is shown: a press of a person who takes `d` ms is
about the step whose outcome was seen `d` ms before. The delay can be found from the presses: their times after a
picture tell it up to a whole number of steps, and of these the right one explains best how steps were rated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.learn.teaching.dataset import Dataset
from minihuman.learn.teaching.learner import LabelledSteps, collect_steps

LONGEST_MS = 2000.0  # that a person takes; more is about something else
SHORTEST_MS = 100.0
UNKNOWN_DELAY_MS = 500.0  # the middle of TAMER's own 200 to 800 ms, where presses are too few to tell
MIN_PRESSES = 12  # presses of which a delay can be told
MAX_PRESSES = 600  # presses that are looked at, the last ones
RIDGE = 0.3


@dataclass(frozen=True, slots=True)
class Presses:
    """Presses and the steps that each may be about."""

    values: NDArray[np.float64]  # (presses,) 1 good, -1 bad
    steps: NDArray[np.int64]  # (presses, candidates) rows of all lessons' steps; -1 where there is no more
    after_ms: NDArray[np.float64]  # (presses, candidates) from the outcome's picture to the press; NaN likewise
    period_ms: float  # between pictures

    def about(self, delay_ms: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """For each press the step that fits a delay best, or -1, and its delay."""
        away = np.abs(self.after_ms - delay_ms)
        away[np.isnan(away)] = np.inf
        best = away.argmin(axis=1)
        each = np.arange(len(best))
        near = away[each, best] <= self.period_ms
        return np.where(near, self.steps[each, best], -1), self.after_ms[each, best]


def collect_presses(dataset: Dataset) -> tuple[Presses, LabelledSteps]:
    """A data set's ratings beside its steps.

    Raises:
        LearnError: if it has none that follows a step's picture.
    """
    lessons = [lesson for lesson in dataset.lessons if len(lesson.actions)]
    if not lessons:
        raise LearnError(f"none of the {len(dataset.lessons)} lessons has a step; play an episode first")
    first, told = 0, dict[str, list[NDArray[np.int64]]]()  # by session: when each outcome was seen, and its row
    periods = np.concatenate([np.diff(lesson.shown_ns) for lesson in lessons])
    period_ns = int(np.median(periods)) if len(periods) else 0
    for lesson in lessons:
        seen_ns = np.append(lesson.shown_ns[1:], lesson.shown_ns[-1] + period_ns)
        rows = np.arange(first, first + len(lesson.actions))
        told.setdefault(_session(lesson.name), []).append(np.stack((seen_ns, rows)))
        first += len(lesson.actions)
    sessions = {name: _in_time(np.concatenate(parts, axis=1)) for name, parts in told.items()}
    nothing = np.zeros((2, 0), np.int64)
    candidates = max(1, int(np.ceil(LONGEST_MS * 1e6 / max(1, period_ns)))) + 1
    steps = np.full((len(dataset.ratings), candidates), -1)
    after = np.full((len(dataset.ratings), candidates), np.nan)
    for place, rating in enumerate(dataset.ratings):
        seen_ns, row = sessions.get(_session(rating.lesson), nothing)
        last = int(np.searchsorted(seen_ns, rating.t_ns - SHORTEST_MS * 1e6, side="right"))
        chosen = np.arange(max(0, last - candidates), last)[::-1]
        delays = (rating.t_ns - seen_ns[chosen]) / 1e6
        chosen, delays = chosen[delays <= LONGEST_MS], delays[delays <= LONGEST_MS]
        steps[place, : len(chosen)], after[place, : len(chosen)] = row[chosen], delays
    fits = (steps >= 0).any(axis=1)
    if not fits.any():
        raise LearnError(
            f"none of the {len(dataset.ratings)} ratings was given within {LONGEST_MS:g} ms of a picture; rate "
            "steps while they are shown"
        )
    values = np.array([rating.value for rating in dataset.ratings])
    return Presses(values[fits], steps[fits], after[fits], period_ns / 1e6), collect_steps(lessons)


def _session(lesson: str) -> str:
    """Whose clock a lesson's times are on: each session's begins at 0."""
    return lesson.partition(":")[0]


def _in_time(told: NDArray[np.int64]) -> NDArray[np.int64]:
    return told[:, np.argsort(told[0], kind="stable")]


def find_delay(presses: Presses, steps: LabelledSteps) -> float | None:
    """The mean delay in ms; None where there are too few presses to tell."""
    newest = presses.after_ms[:, 0]
    if len(newest) < MIN_PRESSES or not presses.period_ms:
        return None
    turn = np.angle(np.exp(2j * np.pi * newest / presses.period_ms).mean()) / (2 * np.pi)
    within = float(turn % 1 * presses.period_ms)
    tries = [within + k * presses.period_ms for k in range(1 + int(LONGEST_MS // presses.period_ms))]
    tries = [delay for delay in tries if SHORTEST_MS <= delay <= LONGEST_MS]
    best = min(tries, key=lambda delay: _surprise(presses, steps, delay))
    about, after = presses.about(best)
    return float(after[about >= 0].mean())


def _surprise(presses: Presses, steps: LabelledSteps, delay_ms: float) -> float:
    """The mean square error of predicting each press from the others, given this delay.

    By ridge regression with a kernel that is 1 for the same action on the same picture, 0 for different actions.
    """
    about, _ = presses.about(delay_ms)
    fits = np.flatnonzero(about >= 0)[-MAX_PRESSES:]
    if len(fits) < MIN_PRESSES:
        return float("inf")
    rows = about[fits]
    seen = steps.observations["image"][rows].flatten(1).numpy().astype(np.float64)
    squares = (seen**2).sum(axis=1)
    apart = np.maximum(squares[:, None] + squares - 2 * seen @ seen.T, 0)
    actions = steps.actions[rows].numpy()
    alike = np.exp(-apart / max(1.0, float(np.median(apart)))) * (actions[:, None] == actions)
    inverse = np.linalg.inv(alike + RIDGE * np.eye(len(rows)))
    values = presses.values[fits] - presses.values[fits].mean()
    return float(np.mean((inverse @ values / np.diag(inverse)) ** 2))


def get_credit_weights(after_ms: NDArray[np.float64], delay_ms: float, spread_ms: float) -> NDArray[np.float64]:
    """How much of each press belongs to each step it may be about: a normal density of delays, each row's sum 1."""
    density = np.exp(-0.5 * ((after_ms - delay_ms) / spread_ms) ** 2)
    density = np.nan_to_num(density)
    sums = density.sum(axis=1, keepdims=True)
    weights: NDArray[np.float64] = density / np.maximum(sums, 1e-12)
    return weights
