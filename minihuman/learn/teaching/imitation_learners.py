"""Learners that imitate people: cloning, HG-DAgger and intervention-weighted regression.

The learners differ in the steps that they use and in the weights of these steps. As published, each starts from fresh
weights every time, so that a policy depends on the data alone.
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
    """A learner that fits a policy to the steps of lessons."""

    settings_type = FittingSettings

    @abc.abstractmethod
    def takes(self, lesson: Lesson) -> bool:
        """Return whether the learner uses a lesson."""

    @abc.abstractmethod
    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Return the weight of each step, (n,), in proportion to which it is drawn."""

    def learn(self, request: LearningRequest) -> LearningResult:
        """Learn from fresh weights, ignoring the previous policy.

        Raises:
            LearnError: if none of the lessons that the learner uses has a step of a person.
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
    """Behaviour cloning: a learner that imitates every step of whole demonstrations equally.

    Source: Pomerleau (1989), ALVINN, NIPS 1. The optimiser is Adam at 1e-3 with weight decay 1e-4 and minibatches of
    64, as in ``learn clone``. The number of updates is fixed, since a session with one person has no validation
    participants.
    """

    name: ClassVar[str] = "cloning"

    def takes(self, lesson: Lesson) -> bool:
        """Return whether a lesson is a whole demonstration."""
        return lesson.is_demonstration

    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Return the same weight for all steps."""
        return np.ones(len(steps.actions))


class HgDagger(ImitationLearner):
    """Human-gated DAgger: a learner that imitates people's demonstrations, takeovers and corrections equally.

    Source: Kelly, Sidrane, Driggs-Campbell and Kochenderfer (2019), ICRA, algorithm 1. The person decides when to
    steer, only the person's steps are added, and the policy is trained anew on all of them after each round. The
    authors also estimate where a policy is safe, by the doubt of an ensemble; that is not part of the policy and is
    left out.
    """

    name: ClassVar[str] = "hg-dagger"

    def takes(self, lesson: Lesson) -> bool:
        """Return whether a lesson has a step of a person."""
        return bool(lesson.by_person.any())

    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Return weight 1 for the person's steps and 0 for the agent's."""
        return steps.by_person.astype(np.float64)


class InterventionWeighted(ImitationLearner):
    """Intervention-weighted regression: a learner that gives people's steps and the agent's half of the weight each.

    Source: Mandlekar, Xu, Martin-Martin, Zhu, Fei-Fei and Savarese (2020), arXiv:2012.06733. Half of each minibatch
    comes from interventions and half from the other steps, so that agent's steps with which a person did not interfere
    count as good. Demonstrations count as interventions here.
    """

    name: ClassVar[str] = "intervention-weighted"

    def takes(self, lesson: Lesson) -> bool:
        """Return True, since the learner uses every lesson."""
        return True

    def weigh(self, steps: LabelledSteps) -> NDArray[np.float64]:
        """Return weights that sum to the same for the person's steps and for the agent's, if there are both."""
        person = steps.by_person
        return np.asarray(np.where(person, 1 / max(1, person.sum()), 1 / max(1, (~person).sum())))
