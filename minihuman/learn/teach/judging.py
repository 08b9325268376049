"""Judging a policy: held-out episodes of a world played side by side, so that it decides for all of them at once."""

from typing import Any

import gymnasium
import numpy as np
import torch

from minihuman.learn.agent.evaluate import Evaluation, held_out_seed
from minihuman.learn.agent.network import Policy
from minihuman.learn.teach.dataset import Dataset


def judge(policy: Policy, dataset: Dataset, *, episodes: int, seed: int) -> Evaluation:
    """Play the world of a dataset; actions are drawn from the policy's probabilities.

    Every policy meets the same episodes, those of ``learn.agent.evaluate``, with the same draws.
    """
    generator = torch.Generator().manual_seed(seed)
    envs: list[Any] = [
        gymnasium.make(dataset.world, disable_env_checker=True, **dataset.options) for _ in range(episodes)
    ]
    lookers = [dataset.eyesight.looker() for _ in envs]
    raws = [env.reset(seed=held_out_seed(seed, number))[0] for number, env in enumerate(envs)]
    playing = list(range(episodes))
    returns, lengths, successes = np.zeros(episodes), np.zeros(episodes), 0
    for step in range(1, dataset.most_steps + 1):
        seen = [lookers[place].see(envs[place].unwrapped, raws[place]) for place in playing]
        batch = {name: torch.as_tensor(np.stack([each[name] for each in seen])) for name in seen[0]}
        with torch.no_grad():
            chances = policy.log_probabilities(batch).exp()
        actions = torch.multinomial(chances, 1, generator=generator)[:, 0].tolist()
        going = []
        for place, action in zip(playing, actions, strict=True):
            raws[place], reward, terminated, truncated, _ = envs[place].step(action)
            returns[place] += reward
            lengths[place] = step
            successes += terminated and reward > 0
            if not (terminated or truncated):
                going.append(place)
        playing = going
        if not playing:
            break
    return Evaluation(episodes, successes, float(returns.mean()), float(lengths.mean()))
