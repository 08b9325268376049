"""Learning from preferences: a reward model from comparisons, and a policy trained on it with PPO."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch

from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.observe import Observation
from minihuman.learn.agent.training import new_ppo, train
from minihuman.learn.agent.training_world import TrainingWorld
from minihuman.learn.teach.dataset import Dataset
from minihuman.learn.teach.port import Asked, Learned, Learner, copy_of, eyes_for, read_settings
from minihuman.learn.teach.reward_model import RewardFitting, fit_reward
from minihuman.learn.transfer.plan import Ppo

Worth = Callable[[Observation, int, Any], float]  # of a step: what was seen, what was done, the world after it


class JudgedWorld(TrainingWorld):
    """A world under training whose rewards are somebody's judgement of each step, and which never ends.

    Where an episode ends by itself the next begins, and the learner is not told: as in Christiano and others' Atari
    games, where the end of a game is no end. Comparisons say nothing of what is added to every step; without an end
    nothing depends on it, and with one a policy would put the goal off where steps are worth more than 0, and hurry to
    its end where they are worth less. An episode that takes too long is broken off, which says nothing either.
    """

    def __init__(self, dataset: Dataset, worth: Worth, *, seed: int) -> None:
        super().__init__(
            dataset.world,
            dataset.options,
            seed=seed,
            eyesight=dataset.eyesight,
            actions=len(dataset.action_names),
        )
        self._worth = worth
        self._most_steps = dataset.most_steps
        self._before: Observation = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the next episode."""
        self._before, info = super().reset()
        return self._before, info

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One step, judged."""
        before = self._before
        seen, _, terminated, truncated, _ = super().step(action)
        worth = self._worth(before, action, self.world)
        if terminated:
            seen, _ = super().reset()
        self._before = seen
        too_long = not terminated and (truncated or len(self.save()["actions"]) >= self._most_steps)
        return seen, worth, False, too_long, {}


@dataclass(frozen=True, slots=True)
class PreferenceSettings:
    """Settings of learning from preferences."""

    reward_updates: int = 600
    steps: int = 4096  # of PPO
    n_steps: int = 512
    n_epochs: int = 10
    learning_rate: float = 1e-3  # at a round's start; it falls to 0 by its end, so that a round ends where it is good
    gamma: float = 0.95  # what counts of a step's worth for the step before it
    entropy: float = 0.01  # weight of the policy's entropy: Christiano and others' for Atari


class Preferences(Learner):
    """Deep reinforcement learning from human preferences.

    Christiano, Leike, Brown, Martic, Legg and Amodei (2017), NeurIPS 30: see ``fit_reward`` and ``JudgedWorld``. Theirs
    trains with A2C or TRPO while comparisons come in; here PPO (Schulman and others, 2017) goes on from the policy so
    far after each round of comparisons, with rollouts of 512 steps, ten passes and a learning rate of 0.001, which
    small grids are learnt with soonest.
    """

    name: ClassVar[str] = "preferences"

    def __init__(self, argument: str = "") -> None:
        """Read the settings.

        Raises:
            LearnError: if one is wrong.
        """
        self.settings = read_settings(PreferenceSettings, argument, of=self.name)

    def answer(self, asked: Asked) -> Learned:
        """Go on from the policy so far, or from fresh weights. The time limit is the reward model's.

        Raises:
            LearnError: if no comparison says something.
        """
        settings = self.settings
        model, updates = fit_reward(
            asked.dataset,
            RewardFitting(updates=settings.reward_updates),
            asked.rng,
            budget_s=asked.budget_s,
            checkpoint=asked.checkpoint,
        )
        trained = optimise(
            asked.dataset,
            lambda seen, action, _: model.reward(seen, action),
            settings,
            start=asked.policy,
            seed=int(asked.rng.integers(2**31)),
            checkpoint=None if asked.checkpoint is None else asked.checkpoint.with_name(f"{asked.checkpoint.name}-ppo"),
        )
        notes = {"comparisons": len(asked.dataset.comparisons)}
        return Learned(trained, asdict(settings) | {"reward_updates": updates}, notes)


def optimise(
    dataset: Dataset,
    worth: Worth,
    settings: PreferenceSettings,
    *,
    seed: int,
    start: Policy | None = None,
    checkpoint: Path | None = None,
) -> Policy:
    """Train a policy with PPO on rewards that ``worth`` gives, from ``start`` on or from fresh weights."""
    world = JudgedWorld(dataset, worth, seed=seed)
    ppo = Ppo(n_steps=settings.n_steps, n_epochs=settings.n_epochs, learning_rate=settings.learning_rate)
    state, own = np.random.get_state(), torch.get_rng_state()
    try:
        agent = new_ppo(world, settings=ppo, eyes=eyes_for(dataset), seed=seed, device="cpu")
        agent.gamma, agent.ent_coef = settings.gamma, settings.entropy
        agent.lr_schedule = lambda left: settings.learning_rate * left
        if start is not None:
            agent.policy.load_state_dict(copy_of(start, dataset).state_dict())
        train(agent, world, steps=settings.steps, checkpoint=checkpoint)
    finally:
        np.random.set_state(state)  # Stable-Baselines3 seeds the streams of everybody
        torch.set_rng_state(own)
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    assert isinstance(agent.policy, Policy)
    agent.policy.set_training_mode(False)
    return agent.policy
