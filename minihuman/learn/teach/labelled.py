"""Labelled steps: what a policy is to do where, with how much weight, and a policy fitted to that."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from minihuman.learn.agent.network import Policy
from minihuman.learn.teach.dataset import Lesson
from minihuman.learn.teach.fitting import fit


@dataclass(frozen=True, slots=True)
class Fitting:
    """How a policy is fitted to labelled steps."""

    updates: int = 800
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    warm_up: int = 0  # see ``fit``
    averaged: float = 0.0


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps of many lessons, one row each."""

    observations: dict[str, torch.Tensor]
    actions: torch.Tensor  # int64[n]
    by_person: NDArray[np.bool_]  # (n,)

    def pick(self, rows: torch.Tensor) -> dict[str, torch.Tensor]:
        """What was seen at some of them."""
        return {name: values[rows] for name, values in self.observations.items()}


def steps_of(lessons: Sequence[Lesson]) -> Steps:
    """All steps of some lessons, one lesson after the other."""
    names = lessons[0].observations
    return Steps(
        {name: torch.as_tensor(np.concatenate([each.observations[name] for each in lessons])) for name in names},
        torch.as_tensor(np.concatenate([each.actions for each in lessons])),
        np.concatenate([each.by_person for each in lessons]),
    )


def fit_to(
    policy: Policy,
    steps: Steps,
    weights: NDArray[np.float64],
    settings: Fitting,
    rng: np.random.Generator,
    *,
    budget_s: float,
    checkpoint: Path | None,
) -> tuple[int, float]:
    """Fit a policy, in place, to do what was done; a step is drawn as often as its weight says.

    Returns:
        Updates made and the mean cross-entropy of the last of them, in nats.
    """
    chances = torch.as_tensor(weights)

    def loss_of(generator: torch.Generator) -> torch.Tensor:
        rows = torch.multinomial(chances, settings.batch_size, replacement=True, generator=generator)
        return torch.nn.functional.nll_loss(policy.log_probabilities(steps.pick(rows)), steps.actions[rows])

    policy.set_training_mode(True)
    policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    done = fit(
        policy,
        loss_of,
        rng,
        updates=settings.updates,
        learning_rate=settings.learning_rate,
        weight_decay=settings.weight_decay,
        warm_up=settings.warm_up,
        averaged=settings.averaged,
        budget_s=budget_s,
        checkpoint=checkpoint,
    )
    policy.set_training_mode(False)
    return done
