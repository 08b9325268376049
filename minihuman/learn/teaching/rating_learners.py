"""Learning from ratings: TAMER, Deep COACH, and the assignment of a rating to a step.

TAMER models how a person rates each action and takes the action with the best expected rating. For Deep COACH, ratings
are advantages: the better a policy's actions are rated, the more likely they become. Both need credit assignment. A
step's outcome can be seen from the moment its frame is displayed, so if a person takes `d` ms to react, a key press
rates the step whose outcome was displayed `d` ms before. The delay can be estimated from the presses: their times after
a frame determine it up to a whole number of steps, and the right number is the one that best explains the ratings.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.policy.network import Policy
from minihuman.learn.teaching.dataset import Dataset, Lesson
from minihuman.learn.teaching.learner import (
    LabelledSteps,
    Learner,
    LearningRequest,
    LearningResult,
    collect_steps,
    copy_policy,
    make_fresh_policy,
    minimise_loss,
)

LONGEST_MS = 2000.0  # the longest time from a picture to a press that rates it
SHORTEST_MS = 100.0  # the shortest such time
UNKNOWN_DELAY_MS = 500.0  # the middle of TAMER's 200 to 800 ms; assumed if presses are too few for an estimate
MIN_PRESSES = 12  # presses from which a delay can be estimated
MAX_PRESSES = 600  # the latest presses, from which a delay is estimated
RIDGE = 0.3  # penalty of the ridge regression that compares delays
LEAST_PROBABILITY = 0.05  # of an action at the time it was taken, so that ratios of probabilities stay finite
_NS_PER_MS = 1e6


@dataclass(frozen=True, slots=True)
class Presses:
    """Rating key presses, with the steps to which each can refer."""

    values: NDArray[np.float64]  # (presses,) 1 good, -1 bad
    steps: NDArray[np.int64]  # (presses, candidates) rows among all lessons' steps, newest first; -1 after the last
    after_ms: NDArray[np.float64]  # (presses, candidates) from the outcome's picture to the press; NaN after the last
    period_ms: float  # between pictures

    def match_steps(self, delay_ms: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return for each press the row of the step that best fits a delay, and the press's delay after that step.

        The row is -1 if no step is within a period of the delay.
        """
        deviations_ms = np.abs(self.after_ms - delay_ms)
        deviations_ms[np.isnan(deviations_ms)] = np.inf
        best = deviations_ms.argmin(axis=1)
        press_rows = np.arange(len(best))
        is_near = deviations_ms[press_rows, best] <= self.period_ms
        return np.where(is_near, self.steps[press_rows, best], -1), self.after_ms[press_rows, best]


def collect_presses(dataset: Dataset) -> tuple[Presses, LabelledSteps]:
    """Return a dataset's ratings as presses with the steps to which they can refer, and the steps of all lessons.

    Raises:
        LearnError: if no lesson has a step, or no rating was pressed 100 to 2000 ms after a step's outcome was shown.
    """
    lessons = [lesson for lesson in dataset.lessons if len(lesson.actions)]
    if not lessons:
        raise LearnError(f"none of the {len(dataset.lessons)} lessons has a step; play an episode first")
    periods = np.concatenate([np.diff(lesson.shown_ns) for lesson in lessons])
    period_ns = 0
    if len(periods):
        period_ns = int(np.median(periods))
    outcomes_by_session = _order_outcomes(lessons, period_ns)
    no_outcomes = np.zeros((2, 0), np.int64)
    steps_in_longest_delay = int(np.ceil(LONGEST_MS * _NS_PER_MS / max(1, period_ns)))
    n_candidates = max(1, steps_in_longest_delay) + 1
    steps = np.full((len(dataset.ratings), n_candidates), -1)
    after_ms = np.full((len(dataset.ratings), n_candidates), np.nan)
    for number, rating in enumerate(dataset.ratings):
        seen_ns, rows = outcomes_by_session.get(_get_session(rating.lesson), no_outcomes)
        end = int(np.searchsorted(seen_ns, rating.t_ns - SHORTEST_MS * _NS_PER_MS, side="right"))
        newest_first = np.arange(max(0, end - n_candidates), end)[::-1]
        delays_ms = (rating.t_ns - seen_ns[newest_first]) / _NS_PER_MS
        is_recent = delays_ms <= LONGEST_MS
        n_recent = np.count_nonzero(is_recent)
        steps[number, :n_recent] = rows[newest_first[is_recent]]
        after_ms[number, :n_recent] = delays_ms[is_recent]
    has_candidate = (steps >= 0).any(axis=1)
    if not has_candidate.any():
        raise LearnError(
            f"none of the {len(dataset.ratings)} ratings was given within {LONGEST_MS:g} ms of a picture; rate "
            "steps while they are shown"
        )
    ratings = np.array([rating.value for rating in dataset.ratings])[has_candidate]
    presses = Presses(ratings, steps[has_candidate], after_ms[has_candidate], period_ns / _NS_PER_MS)
    return presses, collect_steps(lessons)


def _order_outcomes(lessons: Sequence[Lesson], period_ns: int) -> dict[str, NDArray[np.int64]]:
    """Return for each session an array int64[2, steps], ordered by time, of its steps.

    The first row has the session time in nanoseconds at which each step's outcome was displayed, and the second row has
    the step's row among the steps of all lessons. The outcome of a lesson's last step is assumed to be displayed one
    period after the picture before the step.
    """
    first_row = 0
    outcomes_by_session = dict[str, list[NDArray[np.int64]]]()
    for lesson in lessons:
        seen_ns = np.append(lesson.shown_ns[1:], lesson.shown_ns[-1] + period_ns)
        rows = np.arange(first_row, first_row + len(lesson.actions))
        outcomes_by_session.setdefault(_get_session(lesson.name), []).append(np.stack((seen_ns, rows)))
        first_row += len(lesson.actions)
    joined = {name: np.concatenate(parts, axis=1) for name, parts in outcomes_by_session.items()}
    return {name: outcomes[:, np.argsort(outcomes[0], kind="stable")] for name, outcomes in joined.items()}


def _get_session(lesson: str) -> str:
    """Return the name of a lesson's session, within which times are comparable."""
    return lesson.partition(":")[0]


def find_delay(presses: Presses, steps: LabelledSteps) -> float | None:
    """Return the mean delay in milliseconds between a step's outcome and the press that rates it.

    None means that there are too few presses for an estimate, or no period between pictures. The phase of the presses
    within the period determines the delay up to a number of periods; the number is the one with the least error.
    """
    after_newest_ms = presses.after_ms[:, 0]
    if len(after_newest_ms) < MIN_PRESSES or not presses.period_ms:
        return None
    phases_rad = 2 * np.pi * after_newest_ms / presses.period_ms
    mean_phase_rad = np.angle(np.exp(1j * phases_rad).mean())
    within_period_ms = float(mean_phase_rad / (2 * np.pi) % 1 * presses.period_ms)
    n_periods = int(LONGEST_MS // presses.period_ms)
    candidates_ms = [within_period_ms + periods * presses.period_ms for periods in range(n_periods + 1)]
    candidates_ms = [delay_ms for delay_ms in candidates_ms if SHORTEST_MS <= delay_ms <= LONGEST_MS]
    best_ms = min(candidates_ms, key=lambda delay_ms: _compute_prediction_error(presses, steps, delay_ms))
    step_rows, after_ms = presses.match_steps(best_ms)
    return float(after_ms[step_rows >= 0].mean())


def _compute_prediction_error(presses: Presses, steps: LabelledSteps, delay_ms: float) -> float:
    """Return the mean squared error of predicting each rating from the others, if all presses had a delay.

    The prediction is a ridge regression with a kernel that is 1 for the same action on the same image, less for other
    images, and 0 for different actions. The error is infinite if too few presses fit the delay.

    Args:
        presses: the rating presses.
        steps: the steps of all lessons.
        delay_ms: the delay from a step's outcome to the press that rates it.
    """
    step_rows, _ = presses.match_steps(delay_ms)
    fits = np.flatnonzero(step_rows >= 0)[-MAX_PRESSES:]
    if len(fits) < MIN_PRESSES:
        return float("inf")
    rows = step_rows[fits]
    pictures = steps.observations["image"][rows].flatten(1).numpy().astype(np.float64)
    squares = (pictures**2).sum(axis=1)
    squared_distances = np.maximum(squares[:, None] + squares - 2 * pictures @ pictures.T, 0)
    actions = steps.actions[rows].numpy()
    bandwidth = max(1.0, float(np.median(squared_distances)))
    kernel = np.exp(-squared_distances / bandwidth) * (actions[:, None] == actions)
    inverse = np.linalg.inv(kernel + RIDGE * np.eye(len(rows)))
    ratings = presses.values[fits] - presses.values[fits].mean()
    leave_one_out_residuals = inverse @ ratings / np.diag(inverse)  # the closed form, without fitting n times
    return float(np.mean(leave_one_out_residuals**2))


def get_credit_weights(after_ms: NDArray[np.float64], delay_ms: float, spread_ms: float) -> NDArray[np.float64]:
    """Return the share of each press that each candidate step receives, by a normal density of delays.

    The shares of a press sum to 1, or are all 0 if it is too far from every candidate.

    Args:
        after_ms: the delay of each press after each candidate, (presses, candidates); NaN where there is no candidate.
        delay_ms: the mean of the density.
        spread_ms: the standard deviation of the density.
    """
    density = np.exp(-0.5 * ((after_ms - delay_ms) / spread_ms) ** 2)
    density = np.nan_to_num(density)
    sums = density.sum(axis=1, keepdims=True)
    return np.asarray(density / np.maximum(sums, 1e-12))  # without a division by 0


class ActionValues(nn.Module):
    """A policy's actor as a network that returns one value per action: the policy's logits."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.eyes = policy.features_extractor
        self.actor = policy.mlp_extractor.policy_net
        self.head = policy.action_net

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the values float32[batch, actions] of all actions."""
        values: torch.Tensor = self.head(
            self.actor(self.eyes({**observations, "image": observations["image"].float() / 255}))
        )
        return values


@dataclass(frozen=True, slots=True)
class TamerSettings:
    """The settings of TAMER."""

    updates: int = 150
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    delay_ms: float = 0.0  # between picture and press; 0 to estimate it from the presses
    spread_ms: float = 150.0  # standard deviation of the delays
    sharpness: float = 5.0  # by which expected ratings are multiplied, so that the policy is a softmax of the products


class Tamer(Learner):
    """TAMER: training an agent manually via evaluative reinforcement.

    In Knox and Stone (2009), K-CAP, a model of the person's rating of an action is fitted to the ratings. A density of
    delays distributes each rating over the steps to which it can refer, and the agent takes the action with the best
    expected rating. The form here is that of Deep TAMER (Warnell, Waytowich, Lawhern and Stone, 2018, AAAI): a network
    with a squared error weighted by that density (one step is drawn from it for each press in a minibatch), and
    minibatches of all ratings so far. Two things differ. The density is normal and its mean is estimated from the
    presses, where TAMER assumes 200 to 800 ms. Actions are drawn, instead of taking the best one, so that an agent
    whose only memory is its view can leave a corner.
    """

    name: ClassVar[str] = "tamer"
    settings_type = TamerSettings

    def learn(self, request: LearningRequest) -> LearningResult:
        """Learn from fresh weights, ignoring the previous policy.

        Raises:
            LearnError: if there is no rating.
        """
        settings: TamerSettings = self.settings
        presses, steps = collect_presses(request.dataset)
        fresh = make_fresh_policy(request.dataset, request.rng)
        delay_ms = settings.delay_ms or find_delay(presses, steps)
        weights = torch.as_tensor(
            get_credit_weights(presses.after_ms, delay_ms or UNKNOWN_DELAY_MS, settings.spread_ms), dtype=torch.float32
        )
        fits = weights.sum(dim=1) > 0  # the other presses are too far from any picture
        weights = weights[fits]
        step_rows = torch.as_tensor(presses.steps)[fits].clamp(min=0)  # -1 has weight 0, so it is never drawn
        ratings = torch.as_tensor(presses.values, dtype=torch.float32)[fits]
        judge = ActionValues(fresh)

        def loss_of(generator: torch.Generator) -> torch.Tensor:
            minibatch = torch.randint(len(ratings), (settings.batch_size,), generator=generator)
            # one step is drawn by its share of the credit, which on average is the sum over all candidate steps
            drawn = torch.multinomial(weights[minibatch], 1, generator=generator)
            rows = step_rows[minibatch].gather(1, drawn)[:, 0]
            expected = judge(steps.pick(rows)).gather(1, steps.actions[rows, None])[:, 0]
            error: torch.Tensor = ((expected - ratings[minibatch]) ** 2).mean()
            return error

        updates, loss = minimise_loss(
            judge,
            loss_of,
            request.rng,
            updates=settings.updates,
            learning_rate=settings.learning_rate,
            weight_decay=settings.weight_decay,
            budget_s=request.budget_s,
            checkpoint=request.checkpoint,
        )
        _sharpen(fresh, settings.sharpness)
        fresh.set_training_mode(False)
        notes = {"ratings": len(ratings), "delay_ms": delay_ms, "loss": loss}
        return LearningResult(fresh, asdict(settings) | {"updates": updates}, notes)


def _sharpen(policy: Policy, factor: float) -> None:
    """Multiply a policy's logits by a factor, in place."""
    with torch.no_grad():
        for weights in (policy.action_net.weight, policy.action_net.bias):
            assert isinstance(weights, torch.Tensor)
            weights.mul_(factor)


TRACE_STEPS = 4  # the steps among which a press is shared: the step that it rates, and those before


@dataclass(frozen=True, slots=True)
class CoachSettings:
    """The settings of Deep COACH."""

    updates: int = 60
    batch_size: int = 64
    learning_rate: float = 1e-3
    entropy: float = 0.1  # weight of the policy's entropy
    decay: float = 0.35  # of the share of each step further back
    most_ratio: float = 10.0  # the limit of an action's present over its past probability, for good ratings
    delay_ms: float = 0.0  # between picture and press; 0 to estimate it from the presses


class DeepCoach(Learner):
    """Deep COACH: deep reinforcement learning from policy-dependent human feedback.

    In Arumugam, Lee, Saskin and Littman (2019), arXiv:1902.04257, after COACH (MacGlashan and others, 2017, ICML), a
    rating is an advantage under the policy that was rated. It scales the gradient of an action's log-probability;
    earlier steps receive a share, by an eligibility trace that decays with 0.35; each action is weighted by the ratio
    of its present to its past probability; and an entropy term keeps the policy's entropy up. The authors assume a
    delay of one step of 250 ms, use minibatches of 16 windows of 10 steps, a learning rate of 0.00025 and an entropy
    weight of 1.5, and learn after every press. Here, updates are made between episodes from all ratings so far, for
    which the ratio of probabilities corrects; it is limited to 10.
    """

    name: ClassVar[str] = "deep-coach"
    settings_type = CoachSettings

    def learn(self, request: LearningRequest) -> LearningResult:
        """Continue from the previous policy, or from fresh weights if there is none.

        Raises:
            LearnError: if there is no rating.
        """
        settings: CoachSettings = self.settings
        presses, steps = collect_presses(request.dataset)
        trained = _copy_or_make_policy(request)
        delay_ms = settings.delay_ms or find_delay(presses, steps)
        step_rows, _ = presses.match_steps(delay_ms or UNKNOWN_DELAY_MS)
        fits = np.flatnonzero(step_rows >= 0)
        pressed_rows = torch.as_tensor(step_rows[fits])
        ratings = torch.as_tensor(presses.values[fits], dtype=torch.float32)
        since_reset = [np.arange(len(lesson.actions)) for lesson in request.dataset.lessons]
        steps_since_reset = torch.as_tensor(np.concatenate(since_reset))
        past_probabilities = torch.as_tensor(_find_past_probabilities(request.dataset), dtype=torch.float32)
        shares = settings.decay ** torch.arange(TRACE_STEPS, dtype=torch.float32)

        def loss_of(generator: torch.Generator) -> torch.Tensor:
            minibatch = torch.randint(len(pressed_rows), (settings.batch_size,), generator=generator)
            steps_back = torch.multinomial(shares, settings.batch_size, replacement=True, generator=generator)
            rows = pressed_rows[minibatch] - torch.minimum(steps_back, steps_since_reset[pressed_rows[minibatch]])
            log_probs = trained.log_probabilities(steps.pick(rows))
            chosen = log_probs.gather(1, steps.actions[rows, None])[:, 0]
            ratio = (chosen - past_probabilities[rows].log()).exp()
            gain = ratings[minibatch] * torch.where(ratings[minibatch] > 0, ratio.clamp(max=settings.most_ratio), ratio)
            return -gain.mean() + settings.entropy * (log_probs.exp() * log_probs).sum(dim=1).mean()

        trained.set_training_mode(True)
        updates, loss = minimise_loss(
            trained,
            loss_of,
            request.rng,
            updates=settings.updates,
            learning_rate=settings.learning_rate,
            most_norm=1.0,
            budget_s=request.budget_s,
            checkpoint=request.checkpoint,
        )
        trained.set_training_mode(False)
        notes = {"ratings": len(pressed_rows), "delay_ms": delay_ms, "loss": loss}
        return LearningResult(trained, asdict(settings) | {"updates": updates}, notes)


def _copy_or_make_policy(request: LearningRequest) -> Policy:
    """Return a copy of the previous policy, or one with fresh weights if there is none."""
    if request.policy is None:
        return make_fresh_policy(request.dataset, request.rng)
    return copy_policy(request.policy, request.dataset)


def _find_past_probabilities(dataset: Dataset) -> NDArray[np.float64]:
    """Return the probability of each step's action when it was taken, (n,), at least 0.05; 1 if it is unknown."""
    probabilities: list[NDArray[Any]] = []
    for lesson in dataset.lessons:
        n = len(lesson.actions)
        if lesson.policy_probabilities is None:
            probabilities.append(np.ones(n))
        else:
            probabilities.append(lesson.policy_probabilities[np.arange(n), lesson.actions])
    return np.asarray(np.clip(np.concatenate(probabilities), LEAST_PROBABILITY, 1), np.float64)
