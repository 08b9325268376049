"""Proximal policy optimisation with Stable-Baselines3's settings, losses and draws, its two loops written out.

One world, no wrappers, no logging: a rollout acts through ``acting``, an update runs over tensors that were made once.
The sums are Stable-Baselines3's (a test compares a rollout and an update); a step costs a third less.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from torch.nn import functional

from minihuman.learn.agent.acting import thinker
from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.observe import Observation
from minihuman.learn.agent.training_world import TrainingWorld

EPSILON = 1e-8  # Stable-Baselines3's, under an advantage's standard deviation


class Rollout:
    """What happened since the last update: ``n`` steps, as arrays that are written over by the next."""

    def __init__(self, n: int, like: Observation) -> None:
        channels, height, width = like["image"].shape
        # channels last: what convolutions on a CPU want, and what the world gave
        self.images = np.empty((n, height, width, channels), np.uint8)
        self.missions = np.empty((n, *like["mission"].shape), np.float32) if "mission" in like else None
        self.actions = np.empty(n, np.int64)
        self.rewards = np.empty(n, np.float32)
        self.values = np.empty(n, np.float32)
        self.log_probs = np.empty(n, np.float32)
        self.starts = np.empty(n, np.float32)  # 1 where an episode began with this step
        self.advantages = np.empty(n, np.float32)

    def keep(self, step: int, seen: Observation) -> None:
        """Keep what was seen before a step."""
        self.images[step] = seen["image"].transpose(1, 2, 0)
        if self.missions is not None:
            self.missions[step] = seen["mission"]

    def judge(self, last_value: float, ended: bool, *, gamma: float, gae_lambda: float) -> None:
        """Generalised advantage estimates (Schulman et al., 2016), backwards from what is expected after the end."""
        following, goes_on, running = np.float32(last_value), np.float32(not ended), np.float32(0)
        for step in reversed(range(len(self.actions))):
            delta = self.rewards[step] + gamma * following * goes_on - self.values[step]
            running = np.float32(delta + gamma * gae_lambda * goes_on * running)
            self.advantages[step] = running
            following, goes_on = self.values[step], 1 - self.starts[step]


class LeanPpo(PPO):
    """Stable-Baselines3's PPO on one ``TrainingWorld``."""

    policy: Policy
    _last_obs: dict[str, NDArray[Any]]

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Act for so many steps. Stable-Baselines3's own buffer is not used."""
        assert isinstance(env, DummyVecEnv)
        world = env.envs[0].unwrapped
        assert isinstance(world, TrainingWorld)
        assert self._last_episode_starts is not None
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        choose = _Chooser(self.policy)
        seen = {name: part[0] for name, part in self._last_obs.items()}
        starts = bool(self._last_episode_starts[0])
        rollout = self._rollout = getattr(self, "_rollout", None) or Rollout(n_rollout_steps, seen)
        for step in range(n_rollout_steps):
            rollout.keep(step, seen)
            action, value, log_prob = choose(seen)
            seen, reward, terminated, truncated, info = world.step(action)
            self.num_timesteps += 1
            if not callback.on_step():
                return False
            starts, begun = terminated or truncated, starts
            self._update_info_buffer([info], np.array([starts]))
            if truncated and not terminated:  # what would have come is expected, not lost
                reward += self.gamma * choose.value(seen)
            rollout.actions[step], rollout.rewards[step], rollout.starts[step] = action, reward, begun
            rollout.values[step], rollout.log_probs[step] = value, log_prob
            if starts:
                seen, _ = world.reset()
        rollout.judge(choose.value(seen), starts, gamma=self.gamma, gae_lambda=self.gae_lambda)
        self._last_obs = {name: part[None] for name, part in seen.items()}
        self._last_episode_starts = np.array([starts])
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Update the policy from the last rollout: ``n_epochs`` passes in minibatches drawn from NumPy's stream."""
        policy, rollout = self.policy, self._rollout
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        assert callable(self.clip_range)
        clip = self.clip_range(self._current_progress_remaining)
        images = torch.from_numpy(rollout.images).to(self.device)
        missions = None if rollout.missions is None else torch.from_numpy(rollout.missions).to(self.device)
        actions, advantages, log_probs, returns = (
            torch.from_numpy(values).to(self.device)
            for values in (
                rollout.actions[:, None],
                rollout.advantages,
                rollout.log_probs,
                rollout.advantages + rollout.values,
            )
        )
        parameters = list(policy.parameters())
        for _ in range(self.n_epochs):
            order = torch.from_numpy(np.random.permutation(len(images))).to(self.device)
            for chosen in torch.split(order, self.batch_size):
                seen = {"image": images.index_select(0, chosen).permute(0, 3, 1, 2)}
                if missions is not None:
                    seen["mission"] = missions[chosen]
                choices, values = policy.think(seen)
                ratio = torch.exp(choices.gather(1, actions[chosen]).squeeze(1) - log_probs[chosen])
                gain = advantages[chosen]
                if len(gain) > 1:
                    gain = (gain - gain.mean()) / (gain.std() + EPSILON)
                surrogate = torch.min(gain * ratio, gain * torch.clamp(ratio, 1 - clip, 1 + clip)).mean()
                error = functional.mse_loss(returns[chosen], values.squeeze(1))
                loss = self.vf_coef * error - surrogate
                if self.ent_coef:
                    loss = loss + self.ent_coef * (choices.exp() * choices).sum(dim=1).mean()
                policy.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
                policy.optimizer.step()
            self._n_updates += 1


class _Chooser:
    """Draws an action as Stable-Baselines3 does, and says its value and log-probability."""

    def __init__(self, policy: Policy) -> None:
        self._think = thinker(policy) if policy.device.type == "cpu" else policy.think_of

    def __call__(self, seen: Observation) -> tuple[int, float, float]:
        logits, value = self._think(seen)
        log_probs = torch.log_softmax(logits, dim=0)
        action = int(torch.multinomial(log_probs.exp(), 1, replacement=True))
        return action, float(value), float(log_probs[action])

    def value(self, seen: Observation) -> float:
        """What is expected from here on."""
        return float(self._think(seen)[1])
