"""The learner port and what learners share: seeded, resumable gradient updates and supervised fitting of labelled
steps.

A learner takes a dataset and the policy so far and gives a better policy. Other packages register theirs in the
entry-point group `minihuman.learners`.
"""

import abc
import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.policy.file import read_checkpoint, save_atomically
from minihuman.learn.policy.network import EncoderName, Policy, build_policy
from minihuman.learn.policy.observation import get_image_shape
from minihuman.learn.teaching.dataset import Dataset, Lesson
from minihuman.plugins import make_plugin, read_settings

SAVE_EVERY = 200  # updates

Loss = Callable[[torch.Generator], torch.Tensor]  # of one minibatch, which it draws


@contextlib.contextmanager
def seed_torch(rng: np.random.Generator) -> Iterator[None]:
    """Torch's own chance comes from ``rng`` in here, and is as before afterwards."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**63)))
        yield


def minimise_loss(
    parameters: nn.Module,
    loss_of: Loss,
    rng: np.random.Generator,
    *,
    updates: int,
    learning_rate: float,
    weight_decay: float = 0.0,
    most_norm: float = 0.0,
    warm_up: int = 0,
    averaged: float = 0.0,
    budget_s: float = float("inf"),
    checkpoint: Path | None = None,
) -> tuple[int, float]:
    """Make updates with Adam until all are made or time is up; at least one.

    Args:
        parameters: What is fitted, in place.
        loss_of: The loss of a minibatch, drawn with the generator that it is given.
        rng: Seeds that generator.
        updates: How many updates are wanted.
        learning_rate: Adam's.
        weight_decay: Adam's.
        most_norm: Gradients longer than this are cut to it; 0 leaves them.
        warm_up: The learning rate grows to its full height over so many updates: Adam's first steps are as long as any,
            and can push the units of a network of convolutions so far that most of them never answer again.
        averaged: What is left in the end is a running average of the weights, in which those of an update before count
            so much less; 0 leaves the last ones. It may not depend on how many updates there are to be.
        budget_s: Seconds.
        checkpoint: A file to go on from; written every so often, and gone at the end.

    Returns:
        The updates that were made, those before the checkpoint included, and the mean loss of the last fifty.
    """
    optimiser = torch.optim.Adam(parameters.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=True)
    generator = torch.Generator().manual_seed(int(rng.integers(2**63)))
    done = 0
    losses = list[float]()
    if averaged:
        average = {name: torch.zeros_like(values) for name, values in parameters.named_parameters()}
    else:
        average = {}
    if checkpoint is not None and checkpoint.exists():
        saved = read_checkpoint(checkpoint)
        parameters.load_state_dict(saved["weights"])
        optimiser.load_state_dict(saved["optimiser"])
        generator.set_state(saved["generator"])
        done = saved["updates"]
        losses = saved["losses"]
        average = saved["average"]
    ends = time.monotonic() + budget_s
    while done < updates and (done == 0 or time.monotonic() < ends):
        loss = loss_of(generator)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if most_norm:
            nn.utils.clip_grad_norm_(parameters.parameters(), most_norm)
        for group in optimiser.param_groups if done < warm_up else ():
            group["lr"] = learning_rate * (done + 1) / warm_up
        optimiser.step()
        done += 1
        with torch.no_grad():
            for name, values in parameters.named_parameters() if averaged else ():
                average[name].lerp_(values, 1 - averaged)
        losses = [*losses[-49:], loss.item()]
        if checkpoint is not None and done % SAVE_EVERY == 0:
            save_atomically(
                {
                    "weights": parameters.state_dict(),
                    "optimiser": optimiser.state_dict(),
                    "generator": generator.get_state(),
                    "updates": done,
                    "losses": losses,
                    "average": average,
                },
                checkpoint,
            )
    with torch.no_grad():
        for name, values in parameters.named_parameters() if averaged else ():
            values.copy_(average[name] / (1 - averaged**done))
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return done, float(np.mean(losses)) if losses else float("nan")


@dataclass(frozen=True, slots=True)
class FittingSettings:
    """How a policy is fitted to labelled steps."""

    updates: int = 800
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    warm_up: int = 0  # as in ``minimise_loss``
    averaged: float = 0.0


@dataclass(frozen=True, slots=True)
class LabelledSteps:
    """Steps of many lessons, one row each."""

    observations: dict[str, torch.Tensor]
    actions: torch.Tensor  # int64[n]
    by_person: NDArray[np.bool_]  # (n,)

    def pick(self, rows: torch.Tensor) -> dict[str, torch.Tensor]:
        """The observations of some steps."""
        return {name: values[rows] for name, values in self.observations.items()}


def collect_steps(lessons: Sequence[Lesson]) -> LabelledSteps:
    """All steps of some lessons, one lesson after the other."""
    names = lessons[0].observations
    return LabelledSteps(
        {name: torch.as_tensor(np.concatenate([each.observations[name] for each in lessons])) for name in names},
        torch.as_tensor(np.concatenate([each.actions for each in lessons])),
        np.concatenate([each.by_person for each in lessons]),
    )


def fit_policy(
    policy: Policy,
    steps: LabelledSteps,
    weights: NDArray[np.float64],
    settings: FittingSettings,
    rng: np.random.Generator,
    *,
    budget_s: float,
    checkpoint: Path | None,
) -> tuple[int, float]:
    """Fit a policy, in place, to the actions; steps are drawn in proportion to their weights.

    Returns:
        Updates made and the mean cross-entropy of the last of them, in nats.
    """
    chances = torch.as_tensor(weights)

    def loss_of(generator: torch.Generator) -> torch.Tensor:
        rows = torch.multinomial(chances, settings.batch_size, replacement=True, generator=generator)
        return torch.nn.functional.nll_loss(policy.log_probabilities(steps.pick(rows)), steps.actions[rows])

    policy.set_training_mode(True)
    policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    done = minimise_loss(
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


GROUP = "minihuman.learners"
SMALLEST_PICTURE = 36  # rows that the network for pictures needs


@dataclass(frozen=True, slots=True)
class LearningRequest:
    """What a learner makes a policy from."""

    dataset: Dataset
    rng: np.random.Generator  # the only source of randomness
    policy: Policy | None = None  # the one that played last, not to be changed; None before the first
    budget_s: float = float("inf")  # stop after so many seconds; the settings returned say where that was
    checkpoint: Path | None = None  # a file from which an interrupted learner resumes, to the same weights


@dataclass(frozen=True, slots=True)
class LearningResult:
    """A policy, and the settings that give the same policy again without a time limit."""

    policy: Policy
    settings: dict[str, Any]
    notes: dict[str, Any]  # losses, counts, a delay: values that JSON can hold


@dataclass(frozen=True, slots=True)
class NoSettings:
    """The settings of a learner that has none."""


class Learner(abc.ABC):
    """Turns a teaching dataset into a policy. The same data, policy and seed give the same weights.

    Args:
        argument: The text after the colon of its name ("updates=400" of "hg-dagger:updates=400"), read into
            ``settings_type``: a dataclass of numbers. Settings that are not named keep their defaults.

    Raises:
        LearnError: if the text names no setting, or gives no number.
    """

    name: ClassVar[str]
    settings_type: ClassVar[type] = NoSettings

    def __init__(self, argument: str = "") -> None:
        defaults = {field.name: field.default for field in fields(self.settings_type)}
        self.settings: Any = self.settings_type(**read_settings(argument, defaults, LearnError, owner=self.name))

    @abc.abstractmethod
    def learn(self, request: LearningRequest) -> LearningResult:
        """Learn until done or out of time.

        Raises:
            LearnError: if the dataset has nothing to learn from.
        """


def make_learner(name: str) -> Learner:
    """Make a learner from its name; what follows a colon are settings ("hg-dagger:updates=400").

    Raises:
        LearnError: if no learner has that name, or its settings are wrong.
    """
    return make_plugin(GROUP, name, Learner, LearnError, noun="learner")  # type: ignore[type-abstract]


def choose_encoder(dataset: Dataset) -> EncoderName:
    """Choose the network that suits the observations."""
    if get_image_shape(dataset.space)[1] >= SMALLEST_PICTURE:
        if dataset.eyesight.sight == "whole":
            return "map"
        return "atari"
    if dataset.eyesight.sight == "remembered":
        return "near"
    return "codes"


def make_fresh_policy(dataset: Dataset, rng: np.random.Generator) -> Policy:
    """A policy with fresh weights, drawn from ``rng``."""
    with seed_torch(rng):
        return build_policy(dataset.space, len(dataset.action_names), choose_encoder(dataset))


def copy_policy(policy: Policy, dataset: Dataset) -> Policy:
    """The same policy again, to be trained on."""
    copy = build_policy(dataset.space, len(dataset.action_names), choose_encoder(dataset))
    try:
        copy.load_state_dict(policy.state_dict())
    except RuntimeError as error:
        raise LearnError(
            f"the starting policy has a different network ({str(error).splitlines()[0]}); start without a policy"
        ) from None
    return copy
