"""Learning from ratings: TAMER, Deep COACH, and which step a press was about.

TAMER models how a person rates each action and takes the one that would be rated best. For Deep COACH ratings are
advantages: a policy's actions become more likely the better they were rated. Both need credit assignment: the picture
that shows a step's outcome is seen from the moment it is shown, so a press of a person who takes `d` ms is about the
step whose outcome was seen `d` ms before. The delay can be found from the presses: their times after a picture tell it
up to a whole number of steps, and of these the right one explains best how steps were rated.
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

LONGEST_MS = 2000.0  # that a person takes; more is about something else
SHORTEST_MS = 100.0
UNKNOWN_DELAY_MS = 500.0  # the middle of TAMER's own 200 to 800 ms, where presses are too few to tell
MIN_PRESSES = 12  # presses from which a delay can be estimated
MAX_PRESSES = 600  # presses that are looked at, the last ones
RIDGE = 0.3


@dataclass(frozen=True, slots=True)
class Presses:
    """Presses and the steps that each may be about."""

    values: NDArray[np.float64]  # (presses,) 1 good, -1 bad
    steps: NDArray[np.int64]  # (presses, candidates) rows of all lessons' steps; -1 where there is no more
    after_ms: NDArray[np.float64]  # (presses, candidates) from the outcome's picture to the press; NaN likewise
    period_ms: float  # between pictures

    def match_steps(self, delay_ms: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Match each press with the step that fits a delay best, or -1; return the steps' rows and their delays."""
        away = np.abs(self.after_ms - delay_ms)
        away[np.isnan(away)] = np.inf
        best = away.argmin(axis=1)
        press_rows = np.arange(len(best))
        near = away[press_rows, best] <= self.period_ms
        return np.where(near, self.steps[press_rows, best], -1), self.after_ms[press_rows, best]


def collect_presses(dataset: Dataset) -> tuple[Presses, LabelledSteps]:
    """Collect a data set's ratings beside its steps.

    Raises:
        LearnError: if it has none that follows a step's picture.
    """
    lessons = [lesson for lesson in dataset.lessons if len(lesson.actions)]
    if not lessons:
        raise LearnError(f"none of the {len(dataset.lessons)} lessons has a step; play an episode first")
    periods = np.concatenate([np.diff(lesson.shown_ns) for lesson in lessons])
    period_ns = 0
    if len(periods):
        period_ns = int(np.median(periods))
    sessions = _order_outcomes(lessons, period_ns)
    nothing = np.zeros((2, 0), np.int64)
    candidates = max(1, int(np.ceil(LONGEST_MS * 1e6 / max(1, period_ns)))) + 1
    steps = np.full((len(dataset.ratings), candidates), -1)
    after = np.full((len(dataset.ratings), candidates), np.nan)
    for place, rating in enumerate(dataset.ratings):
        seen_ns, row = sessions.get(_session(rating.lesson), nothing)
        last = int(np.searchsorted(seen_ns, rating.t_ns - SHORTEST_MS * 1e6, side="right"))
        chosen = np.arange(max(0, last - candidates), last)[::-1]
        delays = (rating.t_ns - seen_ns[chosen]) / 1e6
        chosen = chosen[delays <= LONGEST_MS]
        delays = delays[delays <= LONGEST_MS]
        steps[place, : len(chosen)] = row[chosen]
        after[place, : len(chosen)] = delays
    fits = (steps >= 0).any(axis=1)
    if not fits.any():
        raise LearnError(
            f"none of the {len(dataset.ratings)} ratings was given within {LONGEST_MS:g} ms of a picture; rate "
            "steps while they are shown"
        )
    values = np.array([rating.value for rating in dataset.ratings])
    return Presses(values[fits], steps[fits], after[fits], period_ns / 1e6), collect_steps(lessons)


def _order_outcomes(lessons: Sequence[Lesson], period_ns: int) -> dict[str, NDArray[np.int64]]:
    """Return, by session, when each step's outcome was seen and the step's row, int64[2, steps], in order of time."""
    first = 0
    outcomes_by_session = dict[str, list[NDArray[np.int64]]]()
    for lesson in lessons:
        seen_ns = np.append(lesson.shown_ns[1:], lesson.shown_ns[-1] + period_ns)
        rows = np.arange(first, first + len(lesson.actions))
        outcomes_by_session.setdefault(_session(lesson.name), []).append(np.stack((seen_ns, rows)))
        first += len(lesson.actions)
    joined = {name: np.concatenate(parts, axis=1) for name, parts in outcomes_by_session.items()}
    return {name: outcomes[:, np.argsort(outcomes[0], kind="stable")] for name, outcomes in joined.items()}


def _session(lesson: str) -> str:
    """Return the session on whose clock a lesson's times are: each session's begins at 0."""
    return lesson.partition(":")[0]


def find_delay(presses: Presses, steps: LabelledSteps) -> float | None:
    """Find the mean delay in ms; None where there are too few presses to tell."""
    newest = presses.after_ms[:, 0]
    if len(newest) < MIN_PRESSES or not presses.period_ms:
        return None
    turn = np.angle(np.exp(2j * np.pi * newest / presses.period_ms).mean()) / (2 * np.pi)
    within = float(turn % 1 * presses.period_ms)
    tries = [within + k * presses.period_ms for k in range(1 + int(LONGEST_MS // presses.period_ms))]
    tries = [delay for delay in tries if SHORTEST_MS <= delay <= LONGEST_MS]
    best = min(tries, key=lambda delay: _predict_error(presses, steps, delay))
    step_rows, after = presses.match_steps(best)
    return float(after[step_rows >= 0].mean())


def _predict_error(presses: Presses, steps: LabelledSteps, delay_ms: float) -> float:
    """Compute the mean square error of predicting each press from the others, given this delay.

    By ridge regression with a kernel that is 1 for the same action on the same picture, 0 for different actions.
    """
    step_rows, _ = presses.match_steps(delay_ms)
    fits = np.flatnonzero(step_rows >= 0)[-MAX_PRESSES:]
    if len(fits) < MIN_PRESSES:
        return float("inf")
    rows = step_rows[fits]
    pictures = steps.observations["image"][rows].flatten(1).numpy().astype(np.float64)
    squares = (pictures**2).sum(axis=1)
    apart = np.maximum(squares[:, None] + squares - 2 * pictures @ pictures.T, 0)
    actions = steps.actions[rows].numpy()
    alike = np.exp(-apart / max(1.0, float(np.median(apart)))) * (actions[:, None] == actions)
    inverse = np.linalg.inv(alike + RIDGE * np.eye(len(rows)))
    values = presses.values[fits] - presses.values[fits].mean()
    return float(np.mean((inverse @ values / np.diag(inverse)) ** 2))


def get_credit_weights(after_ms: NDArray[np.float64], delay_ms: float, spread_ms: float) -> NDArray[np.float64]:
    """Return how much of each press belongs to each candidate step: a normal density of delays, each row's sum 1."""
    density = np.exp(-0.5 * ((after_ms - delay_ms) / spread_ms) ** 2)
    density = np.nan_to_num(density)
    sums = density.sum(axis=1, keepdims=True)
    return np.asarray(density / np.maximum(sums, 1e-12))


class ActionValues(nn.Module):
    """A policy's actor as a number per action: its logits, before they become probabilities."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.eyes = policy.features_extractor
        self.actor = policy.mlp_extractor.policy_net
        self.head = policy.action_net

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the actions' values, float32[batch, actions]."""
        values: torch.Tensor = self.head(
            self.actor(self.eyes({**observations, "image": observations["image"].float() / 255}))
        )
        return values


@dataclass(frozen=True, slots=True)
class TamerSettings:
    """Settings of TAMER."""

    updates: int = 150
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    delay_ms: float = 0.0  # between picture and press; 0 finds it from the presses
    spread_ms: float = 150.0  # of the delays' density
    sharpness: float = 5.0  # the policy's probabilities are those of a softmax of so many times the ratings expected


class Tamer(Learner):
    """Training an agent manually via evaluative reinforcement.

    Knox and Stone (2009), K-CAP: a model of the person's rating of an action is fitted to the ratings, each shared
    among the steps it may be about by a density of delays, and the agent does what is expected to be rated best. The
    form is Deep TAMER's (Warnell, Waytowich, Lawhern and Stone, 2018, AAAI): a network, squared error weighted by that
    density (of each press in a minibatch one step is drawn by it), minibatches of all ratings so far. Here the density
    is normal and its mean is found from the presses, where TAMER takes 200 to 800 ms as given; and actions are drawn,
    not the best one taken, so that an agent whose memory is its view leaves the corner it stands in.
    """

    name: ClassVar[str] = "tamer"
    settings_type = TamerSettings

    def learn(self, request: LearningRequest) -> LearningResult:
        """Learn from fresh weights; the policy so far is not looked at.

        Raises:
            LearnError: if there is no rating.
        """
        settings: TamerSettings = self.settings
        presses, steps = collect_presses(request.dataset)
        fresh = make_fresh_policy(request.dataset, request.rng)
        delay = settings.delay_ms or find_delay(presses, steps)
        weights = torch.as_tensor(
            get_credit_weights(presses.after_ms, delay or UNKNOWN_DELAY_MS, settings.spread_ms), dtype=torch.float32
        )
        fits = weights.sum(dim=1) > 0  # the others are too far from any picture
        weights = weights[fits]
        step_rows = torch.as_tensor(presses.steps)[fits].clamp(min=0)
        ratings = torch.as_tensor(presses.values, dtype=torch.float32)[fits]
        judge = ActionValues(fresh)

        def loss_of(generator: torch.Generator) -> torch.Tensor:
            minibatch = torch.randint(len(ratings), (settings.batch_size,), generator=generator)
            # a step drawn by its share of the credit: on average the sum over steps, at one step's cost
            place = torch.multinomial(weights[minibatch], 1, generator=generator)
            rows = step_rows[minibatch].gather(1, place)[:, 0]
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
        notes = {"ratings": len(ratings), "delay_ms": delay, "loss": loss}
        return LearningResult(fresh, asdict(settings) | {"updates": updates}, notes)


def _sharpen(policy: Policy, factor: float) -> None:
    """Multiply a policy's logits by a factor."""
    with torch.no_grad():
        for values in (policy.action_net.weight, policy.action_net.bias):
            assert isinstance(values, torch.Tensor)
            values.mul_(factor)


TRACE_STEPS = 4  # before the step a press is about that have a share in it


@dataclass(frozen=True, slots=True)
class CoachSettings:
    """Settings of Deep COACH."""

    updates: int = 60
    batch_size: int = 64
    learning_rate: float = 1e-3
    entropy: float = 0.1  # weight of the policy's entropy
    decay: float = 0.35  # of the share of each step further back
    most_ratio: float = 10.0  # by which an action may be likelier than it was when it was made
    delay_ms: float = 0.0  # between picture and press; 0 finds it from the presses


class DeepCoach(Learner):
    """Deep reinforcement learning from policy-dependent human feedback.

    Arumugam, Lee, Saskin and Littman (2019), arXiv:1902.04257, after COACH (MacGlashan and others, 2017, ICML): a
    rating is an advantage under the policy that was rated, so the gradient of an action's log-probability is scaled by
    it, steps before share in it by a trace that decays with 0.35, each action by how much likelier it has become since,
    and the policy's entropy is kept up. They take a delay of one step of 250 ms, minibatches of 16 windows of 10 steps,
    a learning rate of 0.00025 and an entropy weight of 1.5, and learn after every press. Here updates come between
    episodes, from all ratings so far, which is what the ratio of likelihoods is for; it is cut at 10.
    """

    name: ClassVar[str] = "deep-coach"
    settings_type = CoachSettings

    def learn(self, request: LearningRequest) -> LearningResult:
        """Continue from the policy so far, or start with fresh weights.

        Raises:
            LearnError: if there is no rating.
        """
        settings: CoachSettings = self.settings
        presses, steps = collect_presses(request.dataset)
        trained = _copy_or_make_policy(request)
        delay = settings.delay_ms or find_delay(presses, steps)
        step_rows, _ = presses.match_steps(delay or UNKNOWN_DELAY_MS)
        fits = np.flatnonzero(step_rows >= 0)
        pressed_rows = torch.as_tensor(step_rows[fits])
        ratings = torch.as_tensor(presses.values[fits], dtype=torch.float32)
        since_reset = [np.arange(len(lesson.actions)) for lesson in request.dataset.lessons]
        steps_since_reset = torch.as_tensor(np.concatenate(since_reset))
        past_probabilities = torch.as_tensor(_find_past_probabilities(request.dataset), dtype=torch.float32)

        def loss_of(generator: torch.Generator) -> torch.Tensor:
            minibatch = torch.randint(len(pressed_rows), (settings.batch_size,), generator=generator)
            steps_back = torch.multinomial(shares, settings.batch_size, replacement=True, generator=generator)
            rows = pressed_rows[minibatch] - torch.minimum(steps_back, steps_since_reset[pressed_rows[minibatch]])
            log_probs = trained.log_probabilities(steps.pick(rows))
            chosen = log_probs.gather(1, steps.actions[rows, None])[:, 0]
            ratio = (chosen - past_probabilities[rows].log()).exp()
            gain = ratings[minibatch] * torch.where(ratings[minibatch] > 0, ratio.clamp(max=settings.most_ratio), ratio)
            return -gain.mean() + settings.entropy * (log_probs.exp() * log_probs).sum(dim=1).mean()

        shares = settings.decay ** torch.arange(TRACE_STEPS, dtype=torch.float32)
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
        notes = {"ratings": len(pressed_rows), "delay_ms": delay, "loss": loss}
        return LearningResult(trained, asdict(settings) | {"updates": updates}, notes)


def _copy_or_make_policy(request: LearningRequest) -> Policy:
    if request.policy is None:
        return make_fresh_policy(request.dataset, request.rng)
    return copy_policy(request.policy, request.dataset)


def _find_past_probabilities(dataset: Dataset) -> NDArray[np.float64]:
    """Return the probability of each action when it was taken; 1 where it is unknown."""
    chances: list[NDArray[Any]] = []
    for lesson in dataset.lessons:
        n = len(lesson.actions)
        if lesson.policy_probabilities is None:
            chances.append(np.ones(n))
        else:
            chances.append(lesson.policy_probabilities[np.arange(n), lesson.actions])
    return np.asarray(np.clip(np.concatenate(chances), 0.05, 1), np.float64)
