"""The interface of learners, and their common functions: resumable gradient updates and supervised fitting of steps.

A learner takes a dataset and the previous policy and returns a better policy. Other packages register learners in the
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

SAVE_EVERY = 200  # updates between checkpoints
_LOSS_WINDOW = 50  # the latest updates, over which the returned loss is a mean

Loss = Callable[[torch.Generator], torch.Tensor]  # returns the loss of a minibatch that it draws with the generator


@contextlib.contextmanager
def seed_torch(rng: np.random.Generator) -> Iterator[None]:
    """Seed torch's global generator from ``rng`` inside a context, and restore the generator afterwards."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**63)))
        yield


def minimise_loss(
    network: nn.Module,
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
    """Minimise a loss with Adam until all updates are made or the time is up; make at least one update.

    Args:
        network: the network to fit, in place
        loss_of: a function that draws a minibatch with a given generator and returns its loss
        rng: the source of that generator's seed
        updates: the number of updates to make
        learning_rate: the learning rate of Adam
        weight_decay: the weight decay of Adam
        most_norm: the norm to which longer gradients are clipped; 0 for no clipping
        warm_up: the number of updates over which the learning rate grows to its full value. Adam's first steps are as
            long as any, and can move units of a convolutional network so far that most of them never respond again
        averaged: the decay per update of a running average that replaces the weights in the end; 0 for no average. It
            must not depend on the number of updates
        budget_s: the time limit in seconds
        checkpoint: a file to resume from, which is written every ``SAVE_EVERY`` updates and removed at the end

    Returns:
        The number of updates, including those before the checkpoint, and the mean loss of the last fifty updates.
    """
    minimiser = _Minimiser(network, rng, learning_rate, weight_decay, averaged)
    if checkpoint is not None and checkpoint.exists():
        minimiser.resume(checkpoint)
    ends = time.monotonic() + budget_s
    while minimiser.updates < updates and (minimiser.updates == 0 or time.monotonic() < ends):
        minimiser.update(loss_of, most_norm=most_norm, warm_up=warm_up)
        if checkpoint is not None and minimiser.updates % SAVE_EVERY == 0:
            minimiser.save(checkpoint)
    minimiser.finish()
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return minimiser.updates, minimiser.mean_loss


class _Minimiser:
    """A sequence of Adam updates of a network, which a checkpoint can save and resume.

    Args:
        network: the network to fit, in place
        rng: the source of the seed of the minibatches' generator
        learning_rate: the learning rate of Adam
        weight_decay: the weight decay of Adam
        averaged: the decay per update of the weights' running average, as in ``minimise_loss``
    """

    def __init__(
        self,
        network: nn.Module,
        rng: np.random.Generator,
        learning_rate: float,
        weight_decay: float,
        averaged: float,
    ) -> None:
        self.updates = 0
        self._network = network
        self._learning_rate = learning_rate
        self._averaged = averaged
        self._optimiser = torch.optim.Adam(
            network.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=True
        )
        self._generator = torch.Generator().manual_seed(int(rng.integers(2**63)))
        self._losses: list[float] = []  # of the latest updates
        self._average: dict[str, torch.Tensor] = {}  # of the weights, by name; empty where they are not averaged
        if averaged:
            self._average = {name: torch.zeros_like(values) for name, values in network.named_parameters()}

    @property
    def mean_loss(self) -> float:
        """The mean loss of the last fifty updates; NaN before the first one."""
        if not self._losses:
            return float("nan")
        return float(np.mean(self._losses))

    def update(self, loss_of: Loss, *, most_norm: float, warm_up: int) -> None:
        """Make one update with the loss of a minibatch; the arguments are those of ``minimise_loss``."""
        loss = loss_of(self._generator)
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if most_norm:
            nn.utils.clip_grad_norm_(self._network.parameters(), most_norm)
        if self.updates < warm_up:
            for group in self._optimiser.param_groups:
                group["lr"] = self._learning_rate * (self.updates + 1) / warm_up
        self._optimiser.step()
        self.updates += 1
        with torch.no_grad():
            for name, average in self._average.items():
                average.lerp_(self._network.get_parameter(name), 1 - self._averaged)
        self._losses = [*self._losses[1 - _LOSS_WINDOW :], loss.item()]

    def finish(self) -> None:
        """Replace the weights by their running average, if they are averaged."""
        with torch.no_grad():
            for name, average in self._average.items():
                bias_correction = 1 - self._averaged**self.updates  # as in Adam, since the average starts at 0
                self._network.get_parameter(name).copy_(average / bias_correction)

    def save(self, checkpoint: Path) -> None:
        """Write a checkpoint.

        Raises:
            OSError: if the file cannot be written.
        """
        save_atomically(
            {
                "weights": self._network.state_dict(),
                "optimiser": self._optimiser.state_dict(),
                "generator": self._generator.get_state(),
                "updates": self.updates,
                "losses": self._losses,
                "average": self._average,
            },
            checkpoint,
        )

    def resume(self, checkpoint: Path) -> None:
        """Resume from a checkpoint.

        Raises:
            LearnError: if the checkpoint cannot be read, such as one that another version wrote.
        """
        saved = read_checkpoint(checkpoint)
        self._network.load_state_dict(saved["weights"])
        self._optimiser.load_state_dict(saved["optimiser"])
        self._generator.set_state(saved["generator"])
        self.updates = saved["updates"]
        self._losses = saved["losses"]
        self._average = saved["average"]


@dataclass(frozen=True, slots=True)
class FittingSettings:
    """The settings of fitting a policy to labelled steps."""

    updates: int = 800
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    warm_up: int = 0  # as in ``minimise_loss``
    averaged: float = 0.0


@dataclass(frozen=True, slots=True)
class LabelledSteps:
    """The steps of many lessons, with one row per step."""

    observations: dict[str, torch.Tensor]
    actions: torch.Tensor  # int64[n]
    by_person: NDArray[np.bool_]  # (n,)

    def pick(self, rows: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the observations of the steps in some rows."""
        return {name: values[rows] for name, values in self.observations.items()}


def collect_steps(lessons: Sequence[Lesson]) -> LabelledSteps:
    """Return the steps of all given lessons, at least one, one lesson after the other."""
    observations = {}
    for name in lessons[0].observations:
        parts = [lesson.observations[name] for lesson in lessons]
        observations[name] = torch.as_tensor(np.concatenate(parts))
    actions = np.concatenate([lesson.actions for lesson in lessons])
    by_person = np.concatenate([lesson.by_person for lesson in lessons])
    return LabelledSteps(observations, torch.as_tensor(actions), by_person)


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
    """Fit a policy in place to the actions of steps, which are drawn in proportion to their weights, (n,).

    The time limit and the checkpoint are as for ``minimise_loss``.

    Returns:
        The number of updates, and the mean cross-entropy of the last fifty updates in nats.
    """
    chances = torch.as_tensor(weights)

    def loss_of(generator: torch.Generator) -> torch.Tensor:
        rows = torch.multinomial(chances, settings.batch_size, replacement=True, generator=generator)
        return torch.nn.functional.nll_loss(policy.log_probabilities(steps.pick(rows)), steps.actions[rows])

    policy.set_training_mode(True)
    policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    fit = minimise_loss(
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
    return fit


GROUP = "minihuman.learners"
SMALLEST_PICTURE = 36  # the fewest rows of an image that the convolutions of "atari" can process


@dataclass(frozen=True, slots=True)
class LearningRequest:
    """The inputs of a learner."""

    dataset: Dataset
    rng: np.random.Generator  # the only source of randomness
    policy: Policy | None = None  # the previous policy, which must not be changed; None if there is none yet
    budget_s: float = float("inf")  # the time limit in seconds; the returned settings say how many updates fitted in
    checkpoint: Path | None = None  # a file from which an interrupted learner resumes, to the same weights


@dataclass(frozen=True, slots=True)
class LearningResult:
    """A learned policy, with settings that reproduce it without a time limit."""

    policy: Policy
    settings: dict[str, Any]
    notes: dict[str, Any]  # losses, counts and the like, which JSON can hold


@dataclass(frozen=True, slots=True)
class NoSettings:
    """The settings of a learner that has no settings."""


class Learner(abc.ABC):
    """A method that learns a policy from a teaching dataset.

    The same data, policy and seed give the same weights.

    Args:
        argument: the text after the colon of the learner's name, such as "updates=400" in "hg-dagger:updates=400". It
            is read into ``settings_type``, a dataclass of numbers; settings that it does not name keep their defaults

    Raises:
        LearnError: if the text names an unknown setting, or a value is not a number.
    """

    name: ClassVar[str]
    settings_type: ClassVar[type] = NoSettings

    def __init__(self, argument: str = "") -> None:
        defaults = {field.name: field.default for field in fields(self.settings_type)}
        self.settings: Any = self.settings_type(**read_settings(argument, defaults, LearnError, owner=self.name))

    @abc.abstractmethod
    def learn(self, request: LearningRequest) -> LearningResult:
        """Learn a policy until learning is complete or the time is up.

        Raises:
            LearnError: if the dataset contains nothing to learn from.
        """


def make_learner(name: str) -> Learner:
    """Return the learner with a name, which settings can follow after a colon ("hg-dagger:updates=400").

    Raises:
        LearnError: if no learner has that name, or its settings are invalid.
    """
    return make_plugin(GROUP, name, Learner, LearnError, noun="learner")  # type: ignore[type-abstract]


def choose_encoder(dataset: Dataset) -> EncoderName:
    """Return the name of the image encoder that suits the observations of a dataset."""
    if get_image_shape(dataset.space)[1] >= SMALLEST_PICTURE:
        if dataset.eyesight.sight == "whole":
            return "map"
        return "atari"
    if dataset.eyesight.sight == "remembered":
        return "near"
    return "codes"


def make_fresh_policy(dataset: Dataset, rng: np.random.Generator) -> Policy:
    """Return a policy for a dataset, with fresh weights drawn from ``rng``."""
    with seed_torch(rng):
        return build_policy(dataset.space, len(dataset.action_names), choose_encoder(dataset))


def copy_policy(policy: Policy, dataset: Dataset) -> Policy:
    """Return a copy of a policy, for training that must not change the original.

    Args:
        policy: the policy to copy.
        dataset: the dataset to train on, from which the network follows.

    Raises:
        LearnError: if the policy's network is not the one that the dataset needs.
    """
    copy = build_policy(dataset.space, len(dataset.action_names), choose_encoder(dataset))
    try:
        copy.load_state_dict(policy.state_dict())
    except RuntimeError as error:
        raise LearnError(
            f"the starting policy has a different network ({str(error).splitlines()[0]}); start without a policy"
        ) from None
    return copy
