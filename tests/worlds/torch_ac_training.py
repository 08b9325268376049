"""Train with torch-ac as rl-starter-files do, and print what they print of a training and a digest of the weights.

A program of its own: importing torch-ac sets how a process starts others, and its environments' processes never end.
"""

import hashlib
import sys
from typing import Any

import gymnasium
import minigrid  # noqa: F401  # registers the worlds that ours are compared with
import numpy as np
import torch
import torch_ac

import minihuman  # noqa: F401  # registers the worlds


class Model(torch.nn.Module, torch_ac.RecurrentACModel):  # type: ignore[misc]
    """An actor and a critic with a memory of 64 numbers."""

    memory_size = 64

    def __init__(self, n_actions: int) -> None:
        super().__init__()
        self.image = torch.nn.Sequential(torch.nn.Flatten(), torch.nn.Linear(147, 32), torch.nn.ReLU())
        self.memory = torch.nn.LSTMCell(32, 32)
        self.actor = torch.nn.Linear(32, n_actions)
        self.critic = torch.nn.Linear(32, 1)

    def forward(self, observations: Any, memory: Any) -> Any:
        """Compute the distribution of actions, the value and the next memory."""
        hidden, cell = self.memory(self.image(observations.image), memory.chunk(2, dim=1))
        actions = torch.distributions.Categorical(logits=self.actor(hidden))
        return actions, self.critic(hidden).squeeze(1), torch.cat((hidden, cell), dim=1)


def preprocess(observations: list[Any], device: Any = None) -> Any:
    """Collect the images of observations."""
    images = torch.tensor(np.array([observation["image"] for observation in observations]), dtype=torch.float)
    return torch_ac.DictList({"image": images})


def main(world: str) -> None:
    """Train on a world."""
    torch.set_num_threads(1)
    torch.manual_seed(1)
    envs = [gymnasium.make(world, render_mode=None) for _ in range(2)]
    for number, env in enumerate(envs):
        env.reset(seed=1 + 10_000 * number)
    model = Model(int(envs[0].action_space.n))  # type: ignore[attr-defined]
    settings = {"num_frames_per_proc": 32, "recurrence": 4, "batch_size": 32, "preprocess_obss": preprocess}
    algorithm = torch_ac.PPOAlgo(envs, model, torch.device("cpu"), **settings)
    np.random.seed(1)  # by which it orders its batches
    frames = 0
    for _ in range(2):
        experiences, log = algorithm.collect_experiences()
        log |= algorithm.update_parameters(experiences)
        frames += log["num_frames"]
        print("frames", frames, *(log[name] for name in ("entropy", "value", "policy_loss", "value_loss", "grad_norm")))
    weights = b"".join(parameter.detach().numpy().tobytes() for parameter in model.parameters())
    print("weights", hashlib.sha256(weights).hexdigest())


if __name__ == "__main__":
    main(sys.argv[1])
