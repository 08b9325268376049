"""Deep COACH: ratings are advantages, and a policy's actions become more likely the better they were rated."""

from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from minihuman.learn.teaching.credit_assignment import UNKNOWN_DELAY_MS, collect_presses, find_delay
from minihuman.learn.teaching.dataset import Dataset
from minihuman.learn.teaching.learner import (
    Learner,
    LearningRequest,
    LearningResult,
    copy_policy,
    make_fresh_policy,
    minimise_loss,
)

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
        mine = (
            make_fresh_policy(request.dataset, request.rng)
            if request.policy is None
            else copy_policy(request.policy, request.dataset)
        )
        delay = settings.delay_ms or find_delay(presses, steps)
        about, _ = presses.about(delay or UNKNOWN_DELAY_MS)
        fits = np.flatnonzero(about >= 0)
        row, value = torch.as_tensor(about[fits]), torch.as_tensor(presses.values[fits], dtype=torch.float32)
        since_reset = [np.arange(len(lesson.actions)) for lesson in request.dataset.lessons]
        into = torch.as_tensor(np.concatenate(since_reset))
        then = torch.as_tensor(_chances_then(request.dataset), dtype=torch.float32)

        def loss_of(generator: torch.Generator) -> torch.Tensor:
            drawn = torch.randint(len(row), (settings.batch_size,), generator=generator)
            back = torch.multinomial(shares, settings.batch_size, replacement=True, generator=generator)
            rows = row[drawn] - torch.minimum(back, into[row[drawn]])
            log_probs = mine.log_probabilities(steps.pick(rows))
            chosen = log_probs.gather(1, steps.actions[rows, None])[:, 0]
            ratio = (chosen - then[rows].log()).exp()
            gain = value[drawn] * torch.where(value[drawn] > 0, ratio.clamp(max=settings.most_ratio), ratio)
            return -gain.mean() + settings.entropy * (log_probs.exp() * log_probs).sum(dim=1).mean()

        shares = settings.decay ** torch.arange(TRACE_STEPS, dtype=torch.float32)
        mine.set_training_mode(True)
        updates, loss = minimise_loss(
            mine,
            loss_of,
            request.rng,
            updates=settings.updates,
            learning_rate=settings.learning_rate,
            most_norm=1.0,
            budget_s=request.budget_s,
            checkpoint=request.checkpoint,
        )
        mine.set_training_mode(False)
        notes = {"ratings": len(row), "delay_ms": delay, "loss": loss}
        return LearningResult(mine, asdict(settings) | {"updates": updates}, notes)


def _chances_then(dataset: Dataset) -> NDArray[np.float64]:
    """The probability of each action when it was taken; 1 where it is unknown."""
    chances = [
        np.ones(len(lesson.actions))
        if lesson.policy_probabilities is None
        else lesson.policy_probabilities[np.arange(len(lesson.actions)), lesson.actions]
        for lesson in dataset.lessons
    ]
    clipped: NDArray[np.float64] = np.clip(np.concatenate(chances), 0.05, 1).astype(np.float64)
    return clipped
