"""Continuous actions: a Gaussian policy draws vectors, learns from them, and is refused where actions are numbered."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from msgspec.structs import replace as replace_plan

from minihuman.errors import LearnError
from minihuman.learn.policy.action_distributions import GaussianActions, clip_actions
from minihuman.learn.policy.file import load_policy
from minihuman.learn.policy.players import PolicyAgent
from minihuman.learn.training import train
from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice
from minihuman.worlds.adapters.world import World
from tests.builders import plan

BRIEF = TrainingSettings(steps=6_000, worlds=16, rollout=32, learning_rate=3e-3, evaluation=0, entropy=0.0)


class Meet(gymnasium.Env):
    """A point on a line goes to a mark: it observes both as numbers, and an action is a velocity."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 (Gymnasium's own way to declare it)
    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def render(self):
        return np.zeros((8, 8, 3), np.uint8)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.mark = self.np_random.uniform(-1, 1, 2)
        self.steps = 0
        return self._observe(), {}

    def _observe(self):
        return np.array((self.place, self.mark), np.float32)

    def step(self, action):
        self.place += 0.3 * float(action[0])
        self.steps += 1
        is_there = abs(self.place - self.mark) < 0.1
        return self._observe(), float(is_there), is_there, self.steps >= 12, {}


gymnasium.register("Meet-v0", Meet)
MEET = (WorldChoice("Meet-v0"),)


def test_outputs_are_those_of_a_diagonal_gaussian():
    outputs = torch.tensor([[0.3, -1.0, -0.5, 0.2], [2.0, 0.0, -0.5, 0.2]])
    actions = torch.tensor([[0.1, -0.4], [5.0, 0.3]])
    theirs = torch.distributions.Normal(outputs[:, :2], outputs[:, 2:].exp())
    ours = GaussianActions()
    torch.testing.assert_close(ours.log_probability(outputs, actions), theirs.log_prob(actions).sum(dim=1))
    torch.testing.assert_close(ours.entropy(outputs), theirs.entropy().sum(dim=1))
    torch.manual_seed(1)
    drawn = ours.draw(outputs.repeat(4000, 1))[::2]
    torch.testing.assert_close(drawn.mean(dim=0), outputs[0, :2], atol=0.08, rtol=0)
    torch.testing.assert_close(drawn.std(dim=0), outputs[0, 2:].exp(), atol=0.08, rtol=0)


def test_worlds_take_vectors_within_their_bounds():
    box = spaces.Box(np.array((-1, 0), np.float32), np.array((1, 2), np.float32))
    assert clip_actions(box, np.array([[3.0, -0.5], [0.25, 1.0]])).tolist() == [[1.0, 0.0], [0.25, 1.0]]
    assert clip_actions(spaces.Discrete(3), np.array([2, 0])).tolist() == [2, 0]


def test_a_training_from_numbers_learns_and_its_file_plays_again(tmp_path):
    path = tmp_path / "meet.pt"
    report = train(TrainingJob(MEET, replace(BRIEF, evaluation=60)), path)
    first = next(point for point in report.points if point.episodes >= 50)
    (evaluation,) = report.evaluations
    assert first.success < 0.6 < 0.9 <= evaluation.rate
    policy, card = load_policy(path)
    assert card.is_continuous
    assert card.action_names == ("component_0",)
    outputs, _ = policy.compute_single_outputs({"image": np.array([[[-0.9]], [[0.9]]], np.float32)})
    assert outputs[0] > 0.3, "the mark is to the right"


def test_a_study_refuses_a_policy_of_vectors_by_name(tmp_path):
    path = tmp_path / "roam.pt"
    options = {"control": "continuous", "max_steps": 20}
    choice = WorldChoice("minihuman/MiniWorld-OneRoom-v0", options)
    train(TrainingJob((choice,), replace(BRIEF, steps=1, worlds=2, minibatches=1, rollout=2)), path)
    world = World(choice.id, options)
    world.reset(1)
    with pytest.raises(LearnError, match=r"roam.pt has continuous actions; agents and simulated participants"):
        PolicyAgent(str(path)).begin(replace_plan(plan(), world=choice.id, options=options), world)


@pytest.mark.parametrize(
    ("choice", "change", "message"),
    [
        (
            WorldChoice("minihuman/MiniWorld-PickupObjects-v0", {"control": "continuous"}),
            {},
            r"has the action space Dict\(.*PPO learns numbered actions \(Discrete\) or one vector \(Box\)",
        ),
        (
            WorldChoice("minihuman/MiniWorld-OneRoom-v0", {"control": "continuous"}),
            {"from_people": "study"},
            "has continuous actions, and people's are cloned as numbered actions only; omit from_people",
        ),
    ],
)
def test_what_cannot_be_learned_is_named(tmp_path: Path, choice, change, message):
    with pytest.raises(LearnError, match=message):
        train(TrainingJob((choice,), replace(BRIEF, **change)), tmp_path / "policy.pt")
