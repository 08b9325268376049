"""TAMER: a model of how a person rates each action, and a policy that takes the action that would be rated best."""

from dataclasses import asdict, dataclass
from typing import ClassVar

import torch
from torch import nn

from minihuman.learn.policy.network import Policy
from minihuman.learn.teaching.credit_assignment import UNKNOWN_DELAY_MS, collect_presses, find_delay, get_credit_weights
from minihuman.learn.teaching.learner import (
    Learner,
    LearningRequest,
    LearningResult,
    make_fresh_policy,
    minimise_loss,
)


class ActionValues(nn.Module):
    """A policy's actor as a number per action: its logits, before they become probabilities."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.eyes = policy.features_extractor
        self.actor = policy.mlp_extractor.policy_net
        self.head = policy.action_net

    def forward(self, seen: dict[str, torch.Tensor]) -> torch.Tensor:
        """float32[batch, actions]."""
        values: torch.Tensor = self.head(self.actor(self.eyes({**seen, "image": seen["image"].float() / 255})))
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
    density, minibatches of all ratings so far. Here the density is normal and its mean is found from the presses,
    where TAMER takes 200 to 800 ms as given; and actions are drawn, not the best one taken, so that an agent whose
    memory is its view leaves the corner it stands in.
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
        about = torch.as_tensor(presses.steps).clamp(min=0)
        said = torch.as_tensor(presses.values, dtype=torch.float32)
        judge = ActionValues(fresh)

        def loss_of(generator: torch.Generator) -> torch.Tensor:
            drawn = torch.randint(len(said), (settings.batch_size,), generator=generator)
            place = weights[drawn].argmax(dim=1, keepdim=True)  # nearly all of the weight, where steps are apart
            rows = about[drawn].gather(1, place)[:, 0]
            share = weights[drawn].gather(1, place)[:, 0]
            expected = judge(steps.pick(rows)).gather(1, steps.actions[rows, None])[:, 0]
            error: torch.Tensor = (share * (expected - said[drawn]) ** 2).mean()
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
        with torch.no_grad():
            for values in (fresh.action_net.weight, fresh.action_net.bias):
                assert isinstance(values, torch.Tensor)
                values.mul_(settings.sharpness)
        fresh.set_training_mode(False)
        notes = {"ratings": len(said), "delay_ms": delay, "loss": loss}
        return LearningResult(fresh, asdict(settings) | {"updates": updates}, notes)
