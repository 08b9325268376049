"""PPO over a batch of worlds in one process, with or without a memory: `minihuman learn ppo`.

The algorithm is that of Schulman et al., "Proximal Policy Optimization Algorithms" (2017), with details that
Stable-Baselines3 also has: advantages are estimated by GAE and normalised in each minibatch, and the value of the last
state counts at a step limit but not at an end. A memory is a gated recurrent unit behind the encoder, trained through
whole rollouts. A policy that was cloned from people can be held near its clone. The batch steps all worlds in compiled
code, the network processes their observations together, and a rollout stays in one block of memory.
"""

import math
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.curriculum import Curriculum
from minihuman.learn.policy.network import Policy
from minihuman.learn.training_settings import TrainingSettings
from minihuman.learn.training_worlds import Batch, BatchEncoder, TrainingLevel, TrainingWorlds

RECENT = 100  # the number of latest episodes over which a point of the curve is a mean
_OBSERVATION_PREFIX = "seen "  # of the names of a rollout's fields that are observations
_EPSILON = 1e-8  # added to the advantages' standard deviation, as in Stable-Baselines3


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """A point of the learning curve: the state of a training run after an update.

    The "latest episodes" of its fields are at most ``RECENT`` episodes.
    """

    steps: int
    episodes: int
    return_mean: float  # over the latest episodes, NaN before the first
    success: float  # the share of them that ended with a reward
    length_mean: float  # steps of them
    policy_loss: float  # means over the update's minibatches
    value_loss: float
    entropy: float  # nats
    approx_kl: float  # from the policy that collected the rollout, estimated by Schulman's k3; nats
    clip_fraction: float  # the share of steps whose ratio was clipped
    cpu_s: float  # since the training began


@dataclass(slots=True)
class Losses:
    """Sums over the minibatches of an update, for the learning curve."""

    policy: float = 0.0
    value: float = 0.0
    entropy: float = 0.0
    kl: float = 0.0
    clipped: float = 0.0
    minibatches: int = 0

    def means(self) -> tuple[float, float, float, float, float]:
        """Return the means of the sums over the minibatches, in the order of the fields; 0 without minibatches."""
        n = max(1, self.minibatches)
        return self.policy / n, self.value / n, self.entropy / n, self.kl / n, self.clipped / n


@dataclass(frozen=True, slots=True)
class EpisodeSoFar:
    """A world's current episode: its level and the actions so far, from which the episode can be replayed."""

    level: TrainingLevel
    actions: list[Any]  # numbers, or lists of components


class BatchPpo:
    """A training run, with its worlds, their current observations, and the network's memory of each world.

    Args:
        policy: the policy to train.
        worlds: the worlds to train in.
        curriculum: the rule that chooses the level of each episode.
        encoder: the encoder of the observations of all worlds.
        settings: the settings; their number of worlds must be that of ``worlds``.
        clone: a policy that the trained one stays close to, as strongly as ``settings.kl`` says; None to train freely.
    """

    def __init__(
        self,
        policy: Policy,
        worlds: TrainingWorlds,
        curriculum: Curriculum,
        encoder: BatchEncoder,
        settings: TrainingSettings,
        clone: Policy | None = None,
    ) -> None:
        self.steps = self.episodes = self.updates = 0
        self._policy = policy
        self._worlds = worlds
        self._curriculum = curriculum
        self._settings = replace(settings, worlds=worlds.num_envs)
        self._clone = clone if settings.kl else None
        self._critic_updates = settings.critic_updates if clone is not None else 0
        self._encoder = encoder
        self._optimizer = torch.optim.Adam(policy.parameters(), settings.learning_rate, eps=1e-5, fused=True)
        self._hidden = torch.zeros(worlds.num_envs, policy.features_dim, device=settings.device)
        self._starts = torch.ones(worlds.num_envs, device=settings.device)  # 1.0 where an episode begins
        self._returns = np.zeros(worlds.num_envs)
        self._lengths = np.zeros(worlds.num_envs, np.int64)
        self._recent: deque[tuple[float, bool, int]] = deque(maxlen=RECENT)
        # the number of the world and the level of each episode that ended in the rollout, in the order of their ends
        self._ended_levels: list[tuple[int, TrainingLevel]] = []
        self._cpu_s = 0.0
        self._losses = Losses()
        self._playing: list[EpisodeSoFar] = []

    def begin(self) -> None:
        """Begin the first episode of every world at a level that the curriculum draws."""
        levels = [self._curriculum.draw() for _ in range(self._worlds.num_envs)]
        self._playing = [EpisodeSoFar(level, []) for level in levels]
        self._worlds.begin(range(self._worlds.num_envs), levels)
        self._observations = self._encode()

    def update(self) -> CurvePoint:
        """Collect a rollout, update the policy from it, and return the new point of the learning curve."""
        began = time.process_time()
        self._losses = Losses()
        hidden = self._hidden
        rollout = self._collect()
        if self._curriculum.needs_scores:
            self._score_levels(rollout)
        self._set_learning_rate()
        self._policy.requires_grad_(self.updates >= self._critic_updates)  # until then, only the critic learns
        self._policy.value_net.requires_grad_(True)
        self._policy.mlp_extractor.value_net.requires_grad_(True)
        self._learn(rollout, hidden)
        self.updates += 1
        self._cpu_s += time.process_time() - began
        latest_episodes = self._recent or [(math.nan, math.nan, math.nan)]
        return_mean, success, length_mean = np.mean(latest_episodes, axis=0).tolist()
        losses = self._losses.means()
        return CurvePoint(self.steps, self.episodes, return_mean, success, length_mean, *losses, self._cpu_s)

    def _set_learning_rate(self) -> None:
        """Set the learning rate of the next update; with a linear schedule, it falls to 0 over the run."""
        rate = self._settings.learning_rate
        if self._settings.schedule == "linear":
            rate *= self._get_remaining_share()
        for group in self._optimizer.param_groups:
            group["lr"] = rate

    def _get_remaining_share(self) -> float:
        """Return the share of the run's steps that remain; it falls from 1 to 0."""
        return max(0.0, 1 - self.steps / self._settings.steps)

    def _collect(self) -> Batch:
        """Act for the steps of a rollout; return its fields by name, each of shape [rollout, worlds, ...].

        The fields are the observations, with a prefix to their names, and "actions", "log_probs", "values", "starts"
        and "advantages"; with a clone also "clone", its log-probabilities of all actions.
        """
        settings = self._settings
        policy = self._policy
        steps_by_field: dict[str, list[torch.Tensor]] = {}
        rewards = torch.zeros(settings.rollout, settings.worlds)
        with torch.no_grad():
            for t in range(settings.rollout):
                step_fields = {_OBSERVATION_PREFIX + name: part for name, part in self._observations.items()}
                outputs, values, self._hidden = policy.compute_step_outputs(
                    self._observations, self._hidden, self._starts
                )
                actions = policy.distribution.draw(outputs)
                step_fields |= {
                    "actions": actions,
                    "log_probs": policy.distribution.log_probability(outputs, actions),
                    "values": values.squeeze(1),
                    "starts": self._starts,
                }
                if self._clone is not None:
                    step_fields["clone"] = self._clone.log_probabilities(self._observations)
                for name, part in step_fields.items():
                    steps_by_field.setdefault(name, []).append(part)
                rewards[t] = self._step(actions.cpu().numpy())
            _, last_values, _ = policy.compute_step_outputs(self._observations, self._hidden, self._starts)
        rollout = {name: torch.stack(parts) for name, parts in steps_by_field.items()}
        rewards = rewards.to(settings.device)
        ends = torch.cat((rollout["starts"][1:], self._starts[None]))
        next_values = torch.cat((rollout["values"][1:], last_values.T))
        rollout["advantages"] = self._estimate_advantages(rewards, rollout["values"], next_values, ends)
        return rollout

    def _estimate_advantages(
        self, rewards: torch.Tensor, values: torch.Tensor, next_values: torch.Tensor, ends: torch.Tensor
    ) -> torch.Tensor:
        """Return the generalised advantage estimate (GAE) of each step; all arrays have the shape [rollout, worlds].

        ``next_values`` are the values of the states after each step; ``ends`` is 1.0 where a step ended an episode.
        """
        settings = self._settings
        advantage = torch.zeros_like(next_values[-1])
        newest_first = []
        for t in reversed(range(settings.rollout)):
            discount = settings.gamma * (1 - ends[t])
            temporal_difference = rewards[t] + discount * next_values[t] - values[t]
            advantage = temporal_difference + discount * settings.gae_lambda * advantage
            newest_first.append(advantage)
        return torch.stack(newest_first[::-1])

    def _step(self, actions: NDArray[Any]) -> torch.Tensor:
        """Step every world, and begin the next episode where one ended; return the rewards float32[worlds].

        At a step limit, the reward includes the discounted value of the state that followed.

        Args:
            actions: an action for each world.
        """
        joint_step = self._worlds.step(actions)
        rewards = joint_step.rewards.astype(np.float32)
        over = joint_step.terminated | joint_step.truncated
        self._returns += rewards
        self._lengths += 1
        self.steps += len(actions)
        for episode, action in zip(self._playing, actions.tolist(), strict=True):
            episode.actions.append(action)
        if over.any():
            self._end_episodes(np.flatnonzero(over), joint_step.terminated & (rewards > 0))
            rewards += self._estimate_value_beyond(joint_step.truncated & ~joint_step.terminated)
            self._begin_next(np.flatnonzero(over).tolist())
        self._observations = self._encode()
        self._starts = torch.as_tensor(over, dtype=torch.float32, device=self._settings.device)
        return torch.from_numpy(rewards)

    def _end_episodes(self, ended: NDArray[np.int64], has_succeeded: NDArray[np.bool_]) -> None:
        """Count the episodes that ended, and tell the curriculum whether they succeeded.

        Args:
            ended: the numbers of the worlds whose episodes ended.
            has_succeeded: for each world, whether its episode ended in success, bool[worlds].
        """
        self.episodes += len(ended)
        for i in ended.tolist():
            self._recent.append((float(self._returns[i]), bool(has_succeeded[i]), int(self._lengths[i])))
            self._curriculum.finish(self._playing[i].level, bool(has_succeeded[i]))
        self._returns[ended] = 0.0
        self._lengths[ended] = 0

    def _estimate_value_beyond(self, limited: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Return the discounted value of each state at which a step limit ended an episode, float32[worlds].

        It is 0 for the other worlds.

        Args:
            limited: for each world, whether a step limit has just ended its episode, bool[worlds].
        """
        discounted_values = np.zeros(len(limited), np.float32)
        numbers = np.flatnonzero(limited)
        if len(numbers):
            final = {name: part[torch.from_numpy(numbers)] for name, part in self._encode().items()}
            starts = torch.zeros(len(numbers), device=self._settings.device)
            _, values, _ = self._policy.compute_step_outputs(final, self._hidden[numbers], starts)
            discounted_values[numbers] = self._settings.gamma * values.squeeze(1).cpu().numpy()
        return discounted_values

    def _begin_next(self, ended: list[int]) -> None:
        """Begin the next episode in the worlds whose numbers are in ``ended``, at levels that the curriculum draws."""
        levels = [self._curriculum.draw() for _ in ended]
        for number, level in zip(ended, levels, strict=True):
            if self._curriculum.needs_scores:
                self._ended_levels.append((number, self._playing[number].level))
            self._playing[number] = EpisodeSoFar(level, [])
        if not self._worlds.begins_by_itself:
            self._worlds.begin(ended, levels)

    def _score_levels(self, rollout: Batch) -> None:
        """Tell the curriculum the score of each level whose episode ended in a rollout.

        The score is the mean absolute advantage over the steps of the episode that lie in the rollout.
        """
        sizes = rollout["advantages"].abs().cpu().numpy()
        next_starts = np.vstack((rollout["starts"].cpu().numpy()[1:], self._starts.cpu().numpy()[None]))
        is_end = next_starts > 0  # [rollout, worlds]: a step ends an episode if the next step begins one
        n_worlds = sizes.shape[1]
        begins = [0] * n_worlds  # the first step of each world's episode
        ends = [iter(np.flatnonzero(is_end[:, number]).tolist()) for number in range(n_worlds)]
        for number, level in self._ended_levels:
            end = next(ends[number]) + 1
            self._curriculum.score(level, float(sizes[begins[number] : end, number].mean()))
            begins[number] = end
        self._ended_levels.clear()

    def _learn(self, rollout: Batch, hidden: torch.Tensor) -> None:
        """Update the policy from a rollout.

        A minibatch has steps drawn from all worlds or, if the policy has a memory, whole rollouts of some worlds.

        Args:
            rollout: the fields of the rollout, as ``_collect`` returns them.
            hidden: the policy's memory before the rollout's first step, one row per world.
        """
        settings = self._settings
        returns = rollout["advantages"] + rollout["values"]
        if settings.memory:
            n_parts = settings.worlds
        else:
            n_parts = settings.worlds * settings.rollout
        for _ in range(settings.epochs):
            for chosen in torch.randperm(n_parts).chunk(settings.minibatches):
                if settings.memory:
                    minibatch = {name: part[:, chosen] for name, part in rollout.items()}
                    return_targets = returns[:, chosen].flatten()
                    start_hidden = hidden[chosen]
                else:
                    minibatch = {name: part.flatten(0, 1)[chosen][None] for name, part in rollout.items()}
                    return_targets = returns.flatten()[chosen]
                    start_hidden = hidden[:0]
                loss = self._compute_loss(minibatch, return_targets, start_hidden)
                self._optimizer.zero_grad(set_to_none=True)
                loss.backward()  # type: ignore[no-untyped-call]
                nn.utils.clip_grad_norm_(self._policy.parameters(), settings.max_gradient_norm)
                self._optimizer.step()

    def _compute_loss(self, minibatch: Batch, return_targets: torch.Tensor, start_hidden: torch.Tensor) -> torch.Tensor:
        """Return PPO's loss on a minibatch: clipped policy gain, value error, entropy and divergence from the clone.

        Args:
            minibatch: fields of the rollout, each of shape [steps, batch, ...].
            return_targets: the return of each step, [steps * batch], which the critic is to predict.
            start_hidden: the memory before the first step, one row per column; empty without a memory.
        """
        settings = self._settings
        observations = {
            name.removeprefix(_OBSERVATION_PREFIX): part
            for name, part in minibatch.items()
            if name.startswith(_OBSERVATION_PREFIX)
        }
        distribution = self._policy.distribution
        outputs, values = self._policy.compute_sequence_outputs(observations, start_hidden, minibatch["starts"])
        log_prob = distribution.log_probability(outputs, minibatch["actions"].flatten(0, 1))
        advantages = minibatch["advantages"].flatten()
        advantages = (advantages - advantages.mean()) / (advantages.std() + _EPSILON)
        log_ratio = log_prob - minibatch["log_probs"].flatten()
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1 - settings.clip, 1 + settings.clip)
        gain = torch.min(ratio * advantages, clipped * advantages).mean()
        entropy = distribution.entropy(outputs).mean()
        error = (values.squeeze(1) - return_targets).square().mean()
        self._add_losses(-gain, error, entropy, log_ratio.detach())
        loss = settings.value * error - gain - settings.entropy * entropy
        if "clone" in minibatch:
            clone = minibatch["clone"].flatten(0, 1)
            divergence = (clone.exp() * (clone - outputs)).sum(dim=1).mean()  # KL(clone, policy)
            loss = loss + settings.kl * self._get_remaining_share() * divergence
        return loss

    def _add_losses(
        self, policy_loss: torch.Tensor, value_loss: torch.Tensor, entropy: torch.Tensor, log_ratio: torch.Tensor
    ) -> None:
        """Add a minibatch's losses to the update's sums.

        Args:
            policy_loss: the mean loss of the actor.
            value_loss: the mean squared error of the critic.
            entropy: the mean entropy in nats.
            log_ratio: the logarithm of each action's present over its past probability.
        """
        losses = self._losses
        losses.policy += policy_loss.item()
        losses.value += value_loss.item()
        losses.entropy += entropy.item()
        losses.kl += float((log_ratio.exp() - 1 - log_ratio).mean())  # Schulman's k3
        losses.clipped += float(((log_ratio.exp() - 1).abs() > self._settings.clip).float().mean())
        losses.minibatches += 1

    def _encode(self) -> Batch:
        """Return the present observations of all worlds, as tensors on the device."""
        return self._encoder.encode(self._worlds)

    def save(self) -> dict[str, Any]:
        """Return the run's state, from which `restore` continues it, in tensors and plain values."""
        return {
            "policy": self._policy.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "counts": (self.steps, self.episodes, self.updates),
            "curriculum": self._curriculum.save(),
            "levels": [tuple(episode.level) for episode in self._playing],
            "actions": [list(episode.actions) for episode in self._playing],
            "observations": self._observations,
            "hidden": self._hidden,
            "starts": self._starts,
            "returns": torch.from_numpy(self._returns.copy()),
            "lengths": torch.from_numpy(self._lengths.copy()),
            "recent": list(self._recent),
            "cpu_s": self._cpu_s,
            "torch_rng": torch.get_rng_state(),
            "cuda_rng": torch.cuda.get_rng_state_all() if self._settings.device == "cuda" else [],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Continue a run from the state that `save` returned; the worlds replay their current episodes.

        Raises:
            LearnError: if a world does not show the same observation as before.
        """
        self._policy.load_state_dict(saved["policy"])
        self._optimizer.load_state_dict(saved["optimizer"])
        self.steps, self.episodes, self.updates = saved["counts"]
        self._curriculum.restore(saved["curriculum"])
        levels = [TrainingLevel(*level) for level in saved["levels"]]
        self._playing = [EpisodeSoFar(*episode) for episode in zip(levels, saved["actions"], strict=True)]
        self._worlds.replay(levels, saved["actions"])
        self._observations = self._encode()
        for name, part in self._observations.items():
            if not torch.equal(part.cpu(), saved["observations"][name].cpu()):
                raise LearnError(
                    "a world does not show again what it showed before the checkpoint, so the run cannot be resumed; "
                    "train in worlds that a seed determines"
                )
        self._hidden = saved["hidden"].to(self._settings.device)
        self._starts = saved["starts"].to(self._settings.device)
        self._returns = saved["returns"].numpy().copy()
        self._lengths = saved["lengths"].numpy().copy()
        self._recent.extend(saved["recent"])
        self._cpu_s = saved["cpu_s"]
        torch.set_rng_state(saved["torch_rng"])
        if saved["cuda_rng"]:
            torch.cuda.set_rng_state_all(saved["cuda_rng"])
