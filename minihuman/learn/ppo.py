"""PPO with the settings, losses and random draws of Stable-Baselines3: its environment and its two loops.

There is one world, without wrappers or logging. A rollout acts through the network's fast forward pass, and its arrays
are allocated once. The results are those of Stable-Baselines3, and a step takes a third less time.
"""

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from torch.nn import functional

from minihuman.learn.policy.network import EncoderName, Policy, get_policy_settings, make_forward
from minihuman.learn.policy.observation import Observation, ObservationEncoder, get_image_shape
from minihuman.worlds.hashing import hash64


@dataclass(frozen=True, slots=True)
class PpoSettings:
    """The settings of proximal policy optimisation; the defaults are those of Stable-Baselines3."""

    n_steps: int = 2048  # steps between updates
    batch_size: int = 64
    n_epochs: int = 10
    learning_rate: float = 3e-4
    clip_range: float = 0.2


class TrainingEnv(gymnasium.Env[Any, Any]):
    """A world for training, in which each episode has its own seed, derived from the training run's seed.

    Returns and lengths of episodes are in ``info["episode"]``, as Stable-Baselines3 expects them, without wall-clock
    times.
    """

    def __init__(
        self,
        world_id: str,
        options: dict[str, Any],
        *,
        seed: int,
        eyesight: ObservationEncoder,
        actions: int | None = None,
    ) -> None:
        """Make the world.

        Args:
            world_id: a Gymnasium id; only worlds of minihuman can be saved
            options: the keyword arguments of ``gymnasium.make``
            seed: the seed from which the seeds of all episodes are derived
            eyesight: the settings of the agent's observations
            actions: the number of the world's actions that the agent has; None for all
        """
        self.world = gymnasium.make(world_id, disable_env_checker=True, **options).unwrapped
        self.eyesight = eyesight
        self._encoder = eyesight.episode_encoder()
        self.observation_space = eyesight.space(self.world)
        self.image_shape = get_image_shape(self.observation_space)
        assert isinstance(self.world.action_space, spaces.Discrete)
        self.action_space = spaces.Discrete(actions or int(self.world.action_space.n))
        self._seed = seed
        self._episode = -1
        self._return = 0.0
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the next episode, whose seed follows from the training run's; both arguments are ignored."""
        self._episode += 1
        self._return = 0.0
        self._steps = 0
        raw, info = self.world.reset(seed=episode_seed(self._seed, self._episode))
        return self._encoder.encode(self.world, raw), info

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Step the world; at the end of an episode, add its return, length and success to ``info``."""
        raw, reward, terminated, truncated, info = self.world.step(int(action))
        self._return += float(reward)
        self._steps += 1
        if terminated or truncated:
            info["episode"] = {"r": self._return, "l": self._steps}
            info["is_success"] = terminated and float(reward) > 0
        return self._encoder.encode(self.world, raw), float(reward), terminated, truncated, info


def episode_seed(seed: int, episode: int) -> int:
    """Return the reset seed of an episode of a training run.

    Args:
        seed: the seed of the training run.
        episode: the number of the episode, from 0.
    """
    return hash64((seed, "episode", episode)) % 2**31  # a reset seed has 31 bits


EPSILON = 1e-8  # added to the advantages' standard deviation, as in Stable-Baselines3


class Rollout:
    """The steps since the last update, in arrays that the next rollout overwrites.

    Args:
        n_steps: the number of steps.
        example: an observation, whose parts have the shapes of all observations.
    """

    def __init__(self, n_steps: int, example: Observation) -> None:
        channels, height, width = example["image"].shape
        # channels last, as in the world's own image, because convolutions on a CPU are faster so
        self.images = np.empty((n_steps, height, width, channels), np.uint8)
        self.missions = None
        if "mission" in example:
            self.missions = np.empty((n_steps, *example["mission"].shape), np.float32)
        self.actions = np.empty(n_steps, np.int64)
        self.rewards = np.empty(n_steps, np.float32)
        self.values = np.empty(n_steps, np.float32)
        self.log_probs = np.empty(n_steps, np.float32)
        self.starts = np.empty(n_steps, np.float32)  # 1 where an episode began with this step
        self.advantages = np.empty(n_steps, np.float32)

    def estimate_advantages(self, last_value: float, ended: bool, *, gamma: float, gae_lambda: float) -> None:
        """Compute the generalised advantage estimates of all steps (Schulman et al., 2016), in ``advantages``.

        Args:
            last_value: the value of the state after the last step.
            ended: whether that step ended an episode.
            gamma: the discount factor.
            gae_lambda: the decay of the trace.
        """
        next_value = np.float32(last_value)
        goes_on = np.float32(not ended)
        advantage = np.float32(0)
        for step in reversed(range(len(self.actions))):
            temporal_difference = self.rewards[step] + gamma * next_value * goes_on - self.values[step]
            advantage = np.float32(temporal_difference + gamma * gae_lambda * goes_on * advantage)
            self.advantages[step] = advantage
            next_value = self.values[step]
            goes_on = 1 - self.starts[step]


class LeanPpo(PPO):
    """Stable-Baselines3's PPO on one ``TrainingEnv``."""

    policy: Policy
    _last_obs: dict[str, NDArray[Any]]

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Collect a rollout into the agent's own arrays; return False if the callback ended the training."""
        assert isinstance(env, DummyVecEnv)
        world = env.envs[0].unwrapped
        assert isinstance(world, TrainingEnv)
        assert self._last_episode_starts is not None
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        sampler = _ActionSampler(self.policy)
        observation = {name: part[0] for name, part in self._last_obs.items()}
        starts = bool(self._last_episode_starts[0])
        rollout = self._reuse_rollout(n_rollout_steps, observation)
        for step in range(n_rollout_steps):
            rollout.images[step] = observation["image"].transpose(1, 2, 0)
            if rollout.missions is not None:
                rollout.missions[step] = observation["mission"]
            action, value, log_prob = sampler.draw(observation)
            observation, reward, terminated, truncated, info = world.step(action)
            self.num_timesteps += 1
            if not callback.on_step():
                return False
            began_with_step = starts
            starts = terminated or truncated
            self._update_info_buffer([info], np.array([starts]))
            if truncated and not terminated:  # the return beyond a step limit is estimated by the state's value
                reward += self.gamma * sampler.value(observation)
            rollout.actions[step] = action
            rollout.rewards[step] = reward
            rollout.starts[step] = began_with_step
            rollout.values[step] = value
            rollout.log_probs[step] = log_prob
            if starts:
                observation, _ = world.reset()
        rollout.estimate_advantages(sampler.value(observation), starts, gamma=self.gamma, gae_lambda=self.gae_lambda)
        self._last_obs = {name: part[None] for name, part in observation.items()}
        self._last_episode_starts = np.array([starts])
        callback.on_rollout_end()
        return True

    def _reuse_rollout(self, n_steps: int, example: Observation) -> Rollout:
        """Return the arrays of the last rollout to overwrite; new ones for the first rollout."""
        if not hasattr(self, "_rollout"):
            self._rollout = Rollout(n_steps, example)
        return self._rollout

    def train(self) -> None:
        """Update the policy from the last rollout, in minibatches that NumPy's global generator draws."""
        policy = self.policy
        rollout = self._rollout
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        assert callable(self.clip_range)
        clip = self.clip_range(self._current_progress_remaining)
        images = torch.from_numpy(rollout.images).to(self.device)
        if rollout.missions is None:
            missions = None
        else:
            missions = torch.from_numpy(rollout.missions).to(self.device)
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
                observations = {"image": images.index_select(0, chosen).permute(0, 3, 1, 2)}
                if missions is not None:
                    observations["mission"] = missions[chosen]
                new_log_probs, values = policy.compute_outputs(observations)
                ratio = torch.exp(new_log_probs.gather(1, actions[chosen]).squeeze(1) - log_probs[chosen])
                gain = advantages[chosen]
                if len(gain) > 1:
                    gain = (gain - gain.mean()) / (gain.std() + EPSILON)
                surrogate = torch.min(gain * ratio, gain * torch.clamp(ratio, 1 - clip, 1 + clip)).mean()
                value_error = functional.mse_loss(returns[chosen], values.squeeze(1))
                loss = self.vf_coef * value_error - surrogate
                if self.ent_coef:
                    loss = loss + self.ent_coef * (new_log_probs.exp() * new_log_probs).sum(dim=1).mean()  # -entropy
                policy.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
                policy.optimizer.step()
            self._n_updates += 1


class _ActionSampler:
    """Draws actions as Stable-Baselines3 does, and returns each with its value and log-probability."""

    def __init__(self, policy: Policy) -> None:
        if policy.device.type == "cpu":
            self._compute_outputs = make_forward(policy)
        else:
            self._compute_outputs = policy.compute_single_outputs

    def draw(self, observation: Observation) -> tuple[int, float, float]:
        """Return an action that is drawn from the policy, the state's value, and the action's log-probability."""
        logits, value = self._compute_outputs(observation)
        log_probs = torch.log_softmax(logits, dim=0)
        action = int(torch.multinomial(log_probs.exp(), 1, replacement=True))
        return action, float(value), float(log_probs[action])

    def value(self, observation: Observation) -> float:
        """Return the value of the observed state."""
        return float(self._compute_outputs(observation)[1])


LAST_EPISODES = 100  # the number of episodes over which a point of the learning curve is a mean


def make_ppo(world: TrainingEnv, *, settings: PpoSettings, eyes: EncoderName, seed: int, device: str) -> LeanPpo:
    """Return a PPO agent with fresh weights for a world, with all random draws seeded.

    Args:
        world: the world to train in.
        settings: the settings of PPO.
        eyes: the encoder of observations.
        seed: the seed of weights and actions.
        device: the device of the network, "cpu" or "cuda".
    """
    ppo = LeanPpo(
        Policy,
        DummyVecEnv([lambda: world]),
        n_steps=settings.n_steps,
        batch_size=settings.batch_size,
        n_epochs=settings.n_epochs,
        learning_rate=settings.learning_rate,
        clip_range=settings.clip_range,
        policy_kwargs=get_policy_settings(eyes),
        seed=seed,
        device=device,
        stats_window_size=LAST_EPISODES,
    )
    ppo.policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return ppo
