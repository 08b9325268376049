"""The port every learner implements: what was taught and the policy so far in, a better policy out.

Others register in the entry-point group ``minihuman.learners``.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from minihuman.errors import LearnError
from minihuman.learn.agent.network import Eyes, Policy, bare_policy
from minihuman.learn.agent.observe import image_shape
from minihuman.learn.teach.dataset import Dataset
from minihuman.learn.teach.fitting import seeded
from minihuman.plugins import check_made, load

GROUP = "minihuman.learners"
SMALLEST_PICTURE = 36  # rows that the network for pictures needs
SettingsOf = TypeVar("SettingsOf")


@dataclass(frozen=True, slots=True)
class Learned:
    """A policy, and the settings under which no time limit is needed to learn the very same one."""

    policy: Policy
    settings: dict[str, Any]
    notes: dict[str, Any]  # what was found on the way: losses, counts, a delay; plain values


@dataclass(frozen=True, slots=True)
class Asked:
    """What a learner is to make a policy of."""

    dataset: Dataset  # all that was taught so far
    policy: Policy | None  # the one played last, which is left as it is; None where there was none yet
    rng: np.random.Generator  # all chance comes from it
    budget_s: float  # after so many seconds it ends where it is; the settings returned say where that was
    checkpoint: Path | None = None  # a file from which a learner that was stopped goes on, to the same weights


class Learner(abc.ABC):
    """Makes a policy of what was taught. The same data, policy and seed give the same weights."""

    name: ClassVar[str]

    def learn(
        self,
        dataset: Dataset,
        policy: Policy | None,
        rng: np.random.Generator,
        budget_s: float,
        *,
        checkpoint: Path | None = None,
    ) -> Learned:
        """Learn for ``budget_s`` seconds at most; the arguments are those of ``Asked``.

        Raises:
            LearnError: if there is nothing that it could learn from.
        """
        return self.answer(Asked(dataset, policy, rng, budget_s, checkpoint))

    @abc.abstractmethod
    def answer(self, asked: Asked) -> Learned:
        """Learn what is asked for.

        Raises:
            LearnError: if there is nothing that it could learn from.
        """


MakeLearner = Callable[[str], Learner]  # from what follows the name's colon


def make_learner(name: str) -> Learner:
    """Make a learner from its name; what follows a colon are settings ("hg-dagger:updates=400").

    Raises:
        LearnError: if no learner has that name, or its settings are wrong.
    """
    kind, _, argument = name.partition(":")
    learner = load(GROUP, kind, LearnError, what="learner")(argument)
    check_made(learner, Learner, LearnError, group=GROUP, name=kind)
    assert isinstance(learner, Learner)  # checked just now
    return learner


def read_settings(settings: type[SettingsOf], text: str, *, of: str) -> SettingsOf:
    """Read ``updates=400,batch_size=32`` into a dataclass of numbers; what is not named keeps its default.

    Raises:
        LearnError: if a name is no setting, or a value no number.
    """
    known: dict[str, Any] = {field.name: field.default for field in fields(settings)}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for part in filter(None, text.split(",")):
        name, _, value = part.partition("=")
        if name not in known:
            raise LearnError(f"{of} has no setting {name!r}; it has {', '.join(known)}")
        try:
            values[name] = type(known[name])(value)
        except ValueError:
            raise LearnError(f"{of}: {name} is {value!r}; give a number") from None
    return settings(**values)


def eyes_for(dataset: Dataset) -> Eyes:
    """The network that what is seen here calls for."""
    if image_shape(dataset.space)[1] >= SMALLEST_PICTURE:
        return "map" if dataset.eyesight.sight == "whole" else "atari"
    return "near" if dataset.eyesight.sight == "remembered" else "codes"


def new_policy(dataset: Dataset, rng: np.random.Generator) -> Policy:
    """A policy with fresh weights, drawn from ``rng``."""
    with seeded(rng):
        return bare_policy(dataset.space, len(dataset.action_names), eyes_for(dataset))


def copy_of(policy: Policy, dataset: Dataset) -> Policy:
    """The same policy again, to be trained on."""
    copy = bare_policy(dataset.space, len(dataset.action_names), eyes_for(dataset))
    try:
        copy.load_state_dict(policy.state_dict())
    except RuntimeError as error:
        raise LearnError(f"the policy to go on from is another network: {str(error).splitlines()[0]}") from None
    return copy
