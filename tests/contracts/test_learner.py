"""Every learner of ours keeps what learners promise; what a lab may get wrong is named."""

import numpy as np
import pytest

from tests.machine import need_module

need_module("learn")

from dataclasses import dataclass, replace  # noqa: E402

import torch  # noqa: E402

from minihuman.errors import LearnError  # noqa: E402
from minihuman.learn.teaching.learner import (  # noqa: E402
    Learner,
    LearningResult,
    collect_steps,
    copy_policy,
    make_fresh_policy,
    minimise_loss,
)
from minihuman.plugins import list_plugin_names  # noqa: E402
from minihuman.testing.checks import ContractError  # noqa: E402
from minihuman.testing.learner_contract import check_learner  # noqa: E402

pytestmark = pytest.mark.program

SETTINGS = {
    "tamer": "updates=40",
    "deep-coach": "updates=40",
    "preferences": "reward_updates=4,steps=64,n_steps=64,n_epochs=1",
}


@pytest.mark.parametrize("name", list_plugin_names("minihuman.learners"))
def test_every_learner_keeps_what_learners_promise(name):
    check_learner(name, SETTINGS.get(name, "updates=40"))


@dataclass(frozen=True)
class Settings:
    updates: int = 3


class Plain(Learner):
    """Does what was done, whoever did it; each of the wrong ones changes one thing."""

    name = "plain"
    settings_type = Settings

    def learn(self, request):
        if not request.dataset.lessons:
            raise LearnError("plain has nothing to learn from: there is no lesson")
        steps = collect_steps(request.dataset.lessons)
        policy = self.begin(request)

        def loss_of(generator):
            rows = torch.randint(len(steps.actions), (8,), generator=generator)
            return torch.nn.functional.nll_loss(policy.log_probabilities(steps.pick(rows)), steps.actions[rows])

        updates, loss = minimise_loss(
            policy, loss_of, request.rng, updates=self.settings.updates, learning_rate=1e-3, budget_s=request.budget_s
        )
        return LearningResult(policy, {"updates": updates}, {"loss": loss})

    def begin(self, request):
        if request.policy is None:
            return make_fresh_policy(request.dataset, request.rng)
        return copy_policy(request.policy, request.dataset)


class DrawsFromElsewhere(Plain):
    def begin(self, request):
        return make_fresh_policy(request.dataset, np.random.default_rng(np.random.randint(2**31)))


class TrainsTheOldOne(Plain):
    def begin(self, request):
        return super().begin(request) if request.policy is None else request.policy


class ChangesTheData(Plain):
    def begin(self, request):
        request.dataset.lessons[0].rewards[0] += 1
        return super().begin(request)


class ForgetsWhereItStopped(Plain):
    def learn(self, request):
        return replace(super().learn(request), settings={"updates": 10**4 if request.budget_s < 9 else 3})


class LearnsFromNothing(Plain):
    def learn(self, request):
        if request.dataset.lessons:
            return super().learn(request)
        return LearningResult(self.begin(request), {"updates": 0}, {})


class FallsOverNothing(Plain):
    def learn(self, request):
        return super().learn(request) if request.dataset.lessons else request.dataset.lessons[0]


class NotesAnArray(Plain):
    def learn(self, request):
        return replace(super().learn(request), notes={"losses": np.zeros(3)})


class AnotherNetwork(Plain):
    def begin(self, request):
        fewer = replace(request.dataset, lessons=(), ratings=(), comparisons=(), action_names=("left", "right"))
        return make_fresh_policy(fewer, request.rng)

    def learn(self, request):
        return LearningResult(self.begin(request), {"updates": 0}, {})


class Overflows(Plain):
    def learn(self, request):
        found = super().learn(request)
        with torch.no_grad():
            next(found.policy.parameters()).fill_(float("inf"))
        return found


class GivesThePolicyAlone(Plain):
    def learn(self, request):
        return super().learn(request).policy


class Crashes(Plain):
    def learn(self, request):
        return {}["weights"]


def test_a_labs_learner_keeps_them():
    check_learner(Plain)


@pytest.mark.parametrize(
    ("learner", "said"),
    [
        (DrawsFromElsewhere, r"draws from something else than request\.rng"),
        (TrainsTheOldOne, r"changed request\.policy"),
        (ChangesTheData, r"changed request\.dataset"),
        (ForgetsWhereItStopped, "another policy without a limit"),
        (LearnsFromNothing, "without a lesson it returned a policy"),
        (FallsOverNothing, "without a lesson it raised IndexError"),
        (NotesAnArray, "notes cannot be written into the policy's file"),
        (AnotherNetwork, "cannot play the dataset's world"),
        (Overflows, "not finite"),
        (Crashes, r"learn\(\) raised KeyError: 'weights'"),
        (GivesThePolicyAlone, "gave a Policy, not a LearningResult"),
        (lambda argument: object(), r"object is not a minihuman\.ext\.Learner"),
    ],
)
def test_a_promise_that_is_not_kept_is_named(learner, said):
    with pytest.raises(ContractError, match=said):
        check_learner(learner)
