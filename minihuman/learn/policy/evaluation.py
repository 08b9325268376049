"""Evaluate a policy: fixed held-out episodes, successes counted, with the interval of the rate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch

from minihuman.learn.policy.network import Policy
from minihuman.learn.policy.observation import Observation, ObservationEncoder
from minihuman.learn.ppo import episode_seed
from minihuman.statistics.scores import wilson_interval

ChooseAction = Callable[[Observation], int]  # an action from what is seen


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Episodes played and how many succeeded: ended by themselves with a reward."""

    episodes: int
    successes: int
    mean_return: float
    mean_steps: float

    @property
    def rate(self) -> float:
        """The success rate."""
        return self.successes / self.episodes

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % Wilson interval."""
        return wilson_interval(self.successes, self.episodes)

    def __str__(self) -> str:
        """The rate with its interval."""
        low, high = self.interval
        return f"{self.rate:.2f} [{low:.2f}, {high:.2f}]"


def evaluate_policy(
    choose: ChooseAction,
    world_id: str,
    options: dict[str, Any],
    eyesight: ObservationEncoder,
    *,
    episodes: int,
    seed: int,
    most_steps: int | None = None,
) -> Evaluation:
    """Play held-out episodes; their seeds come from ``seed`` and are the same for every policy.

    An episode ends when the world says so, or after ``most_steps``; one or the other has to.
    """
    env: Any = gymnasium.make(world_id, disable_env_checker=True, **options)  # with its own step limit
    world = env.unwrapped
    first_action = int(env.action_space.start)
    encoder = eyesight.episode_encoder()
    returns, steps, successes = [], [], 0
    for episode in range(episodes):
        raw, _ = env.reset(seed=held_out_seed(seed, episode))
        total, length, ended, terminated, reward = 0.0, 0, False, False, 0.0
        while not ended:
            raw, reward, terminated, truncated, _ = env.step(first_action + choose(encoder.encode(world, raw)))
            total, length = total + float(reward), length + 1
            ended = terminated or truncated or length == most_steps
        returns.append(total)
        steps.append(length)
        successes += terminated and reward > 0
    return Evaluation(episodes, successes, float(np.mean(returns)), float(np.mean(steps)))


def held_out_seed(seed: int, episode: int) -> int:
    """The reset seed of a held-out episode: above 2**31, where no training or session seed of ours lies."""
    return 2**31 + episode_seed(seed, episode)


def make_sampling_policy(policy: Policy, seed: int) -> ChooseAction:
    """A policy that draws each action from its own probabilities, repeatably."""
    random = torch.Generator().manual_seed(seed)

    def choose(seen: Observation) -> int:
        return int(torch.multinomial(policy.probabilities(seen), 1, generator=random))

    return choose


def make_random_policy(actions: int, seed: int) -> ChooseAction:
    """Any action at any time: what a policy has to beat."""
    rng = np.random.default_rng(seed)
    return lambda _: int(rng.integers(actions))
