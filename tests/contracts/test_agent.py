"""Every agent of ours keeps what agents promise; what a lab may get wrong is named."""

import numpy as np
import pytest

from minihuman.agents.agent import BaseAgent
from minihuman.errors import SimulationError
from minihuman.testing.checks import ContractError
from minihuman.testing.participant_contract import check_agent
from tests.machine import needs


@pytest.mark.parametrize(("name", "argument"), [("random", ""), ("optimal", ""), ("optimal", "0.2")])
@pytest.mark.parametrize("world", ["minihuman/MiniGrid-Empty-5x5-v0", "minihuman/MiniWorld-OneRoomS6Fast-v0"])
def test_every_agent_keeps_what_agents_promise(name, argument, world):
    check_agent(name, argument, world)


@needs("learn")
def test_a_policy_file_keeps_them(tmp_path):
    import torch

    from minihuman.learn.policy.file import PolicyCard, save_policy
    from minihuman.learn.policy.network import build_policy
    from minihuman.learn.policy.observation import ObservationEncoder

    names = ("left", "right", "forward")
    eyesight = ObservationEncoder(missions=False)
    card = PolicyCard("minihuman/MiniGrid-Empty-5x5-v0", {}, names, (3, 7, 7), eyesight, "codes", "nothing", 0, 1)
    with torch.random.fork_rng():
        torch.manual_seed(1)
        save_policy(build_policy(card.observation_space, len(names), "codes"), card, tmp_path / "policy.pt")
    check_agent("policy", str(tmp_path / "policy.pt"))


class Even(BaseAgent):
    """Every action is as likely as another; each of the wrong ones changes one thing."""

    def begin(self, plan, world):
        self.steps = 0

    def action_probabilities(self, world):
        self.steps += 1
        n = len(world.action_names)
        return np.full(n, 1 / n, np.float32)


class Steps(Even):
    def action_probabilities(self, world):
        world.step(0)
        return super().action_probabilities(world)


class Resets(Even):
    def begin(self, plan, world):
        super().begin(plan, world)
        world.reset(plan.seed + 1)


class Draws(Even):
    def action_probabilities(self, world):
        row = np.random.random(len(world.action_names)).astype(np.float32)
        return row / row.sum()


class Remembers(Even):
    steps = 0

    def begin(self, plan, world):
        self.steps = self.steps

    def action_probabilities(self, world):
        row = super().action_probabilities(world)
        return row if self.steps < 60 else np.eye(len(row), dtype=np.float32)[0]


class Unscaled(Even):
    def action_probabilities(self, world):
        return 2 * super().action_probabilities(world)


class Negative(Even):
    def action_probabilities(self, world):
        row = super().action_probabilities(world)
        row[:2] = -0.5, row[0] + row[1] + 0.5
        return row


class Crashes(Even):
    def action_probabilities(self, world):
        return {}["weights"]


class FewerActions(Even):
    def action_probabilities(self, world):
        return np.array([0.5, 0.5], np.float32)


class AnAction(Even):
    def action_probabilities(self, world):
        return 0


def test_a_labs_agent_keeps_them():
    check_agent(Even)


@pytest.mark.parametrize(
    ("agent", "said"),
    [
        (Steps, r"action_probabilities\(\) changed the world"),
        (Resets, r"begin\(\) changed the world"),
        (Draws, "a new one gave other probabilities"),
        (Remembers, "the same one gave other probabilities"),
        (Unscaled, "sum to 2, not to 1"),
        (Negative, "below 0"),
        (FewerActions, r"gave float32\[2\]; it gives float32\[7\]"),
        (Crashes, r"action_probabilities\(\) raised KeyError: 'weights'; .* agent_failed"),
        (AnAction, "gave int; it gives float32"),
        (lambda argument: object(), r"object is not a minihuman\.ext\.BaseAgent"),
    ],
)
def test_a_promise_that_is_not_kept_is_named(agent, said):
    with pytest.raises(ContractError, match=said):
        check_agent(agent)


def test_a_world_that_it_cannot_play_is_said_as_anywhere():
    with pytest.raises(SimulationError, match="no path leads to the goal"):
        check_agent("optimal", world="minihuman/MiniGrid-Playground-v0")
