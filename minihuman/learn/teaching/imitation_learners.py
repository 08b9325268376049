"""Learners that do what the person did: cloning, HG-DAgger and intervention-weighted regression.

They differ in which steps they take and how much each weighs. All start from fresh weights at every call, as
published: what a policy becomes depends on the data alone.
"""

import abc
from dataclasses import asdict
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.learn.teaching.dataset import Lesson
from minihuman.learn.teaching.learner import (
    FittingSettings,
    LabelledSteps,
    Learner,
    LearningRequest,
    LearningResult,
    collect_steps,
    fit_policy,
    make_fresh_policy,
)


class ImitationLearner(Learner, abc.ABC):
    """Fits a policy to steps of a person."""

    settings_type = FittingSettings

    @abc.abstractmethod
    def takes(self, lesson: Lesson) -> bool:
        """Whether to learn from a lesson at all."""

    @abc.abstractmethod
    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Return how much each step weighs."""

    def learn(self, request: LearningRequest) -> LearningResult:
        """Learn from fresh weights; the policy so far is not looked at.

        Raises:
            LearnError: if a person steered at no step that it takes.
        """
        lessons = [lesson for lesson in request.dataset.lessons if len(lesson.actions) and self.takes(lesson)]
        if not any(lesson.by_person.any() for lesson in lessons):
            raise LearnError(f"{self.name}: none of its lessons has a step taken by a person; record some first")
        steps = collect_steps(lessons)
        fresh = make_fresh_policy(request.dataset, request.rng)
        updates, loss = fit_policy(
            fresh,
            steps,
            self.weigh(steps),
            self.settings,
            request.rng,
            budget_s=request.budget_s,
            checkpoint=request.checkpoint,
        )
        notes = {"steps": len(steps.actions), "labelled_steps": int(steps.by_person.sum()), "loss": loss}
        return LearningResult(fresh, asdict(self.settings) | {"updates": updates}, notes)


class Cloning(ImitationLearner):
    """Behaviour cloning: what a person did in whole demonstrations, every step alike.

    Pomerleau (1989), ALVINN, NIPS 1. Adam at 1e-3 with weight decay 1e-4 in minibatches of 64, as in ``learn clone``;
    a fixed number of updates in place of its validation participants, of whom a session with one person has none.
    """

    name: ClassVar[str] = "cloning"

    def takes(self, lesson: Lesson) -> bool:
        """Take whole demonstrations alone."""
        return lesson.is_demonstration

    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Weigh all steps alike."""
        return np.ones(len(steps.actions))


class HgDagger(ImitationLearner):
    """Human-gated DAgger: what a person did in demonstrations, takeovers and corrections, every step alike.

    Kelly, Sidrane, Driggs-Campbell and Kochenderfer (2019), ICRA, algorithm 1: the person decides when to steer, only
    the person's steps are added, and the policy is trained anew on all of them after each round. Their doubt of an
    ensemble, by which they say where a policy is safe, is not part of the policy and is left out.
    """

    name: ClassVar[str] = "hg-dagger"

    def takes(self, lesson: Lesson) -> bool:
        """Take every lesson in which a person made a step."""
        return bool(lesson.by_person.any())

    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Weigh the person's steps alike, and the agent's not at all."""
        return steps.by_person.astype(np.float64)


class InterventionWeighted(ImitationLearner):
    """Intervention-weighted regression: the person's steps and the agent's own, each half of the weight.

    Mandlekar, Xu, Martin-Martin, Zhu, Fei-Fei and Savarese (2020), arXiv:2012.06733: minibatches are drawn with equal
    share from interventions and from the rest, so that what a person let pass counts as good. Demonstrations are
    interventions here.
    """

    name: ClassVar[str] = "intervention-weighted"

    def takes(self, lesson: Lesson) -> bool:
        """Take every lesson."""
        return True

    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Give half of the weight to the person's steps, and half to the agent's if there are any."""
        person = steps.by_person
        return np.asarray(np.where(person, 1 / max(1, person.sum()), 1 / max(1, (~person).sum())))
