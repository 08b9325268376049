"""PPO over a batch of worlds in one process, with or without a memory: `minihuman learn ppo`.

The algorithm is that of Schulman et al., "Proximal Policy Optimization Algorithms" (2017), with details that
Stable-Baselines3 also has: advantages are estimated by GAE and normalised in each minibatch, and the value of the last
state counts at a step limit but not at an end. A memory is a gated recurrent unit behind the encoder, trained through
whole rollouts. The batch steps all worlds in compiled code, the network processes their observations together, and a
rollout stays in one block of memory.
"""

import csv
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.policy.file import PolicyCard, save_policy
from minihuman.learn.policy.network import EncoderName, Policy, build_policy
from minihuman.learn.policy.observation import SPREAD, ObservationEncoder, encode_mission, get_image_shape
from minihuman.worlds.adapters.world import World
from minihuman.worlds.team import TeamWorld

Batch = dict[str, torch.Tensor]  # what worlds show: uint8[n, channels, height, width], float32[n, 9]
RECENT = 100  # episodes that a point of the curve is over
_OBSERVATION_PREFIX = "seen "  # of the fields of a rollout that are observations


@dataclass(frozen=True, slots=True)
class BatchPpoSettings:
    """The settings of a training run; the defaults suit grids and rooms that are learned in some 100,000 steps."""

    steps: int = 300_000  # of all worlds together
    worlds: int = 16
    rollout: int = 128  # steps of each world between updates
    epochs: int = 4
    minibatches: int = 4
    learning_rate: float = 7e-4
    discount: float = 0.99
    trace: float = 0.95  # of GAE
    clip: float = 0.2
    entropy: float = 0.01
    value: float = 0.5
    gradient: float = 0.5  # the longest
    memory: bool = False
    device: str = "cpu"


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """A point of the learning curve: the state of a training run after an update."""

    steps: int
    episodes: int
    return_mean: float  # over the latest episodes, NaN before the first
    success: float  # the share of them that ended with a reward
    cpu_s: float


def train_batch(
    world: str,
    out: Path,
    settings: BatchPpoSettings,
    *,
    missions: bool = False,
    seed: int = 1,
    follow: Callable[[CurvePoint], None] = lambda _: None,
) -> list[CurvePoint]:
    """Train a policy in a batch of worlds; write the policy and, next to it, its learning curve as CSV.

    Args:
        world: the Gymnasium id of a world that has a batch, as every built-in world does
        out: the policy file to write
        missions: whether the policy observes the mission, one of "go to the COLOUR KIND"
        seed: the seed of the worlds, the network and the actions
        follow: a function that is called after each update

    Raises:
        LearnError: if the world has no batch, no image or other missions, or if the device does not exist.
    """
    if settings.device != "cpu" and not (settings.device == "cuda" and torch.cuda.is_available()):
        raise LearnError(f"device {settings.device!r} is not here; use cpu, or cuda where PyTorch finds a GPU")
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # small networks: more threads only wait for each other
    example_world: Any = World(world, {}).unwrapped
    eyesight = ObservationEncoder(missions)
    space = eyesight.space(example_world)
    eyes = _choose_encoder(get_image_shape(space))
    worlds: Any
    if hasattr(example_world, "team"):
        worlds = _Seats(example_world.team, settings)
    else:
        worlds = _make_batch(world, settings.worlds)
    settings = replace(settings, worlds=worlds.num_envs)
    policy = build_policy(space, len(example_world.action_names), eyes, memory=settings.memory).to(settings.device)
    run = _Run(policy, worlds, eyes == "codes", missions, settings, seed)
    progress: list[CurvePoint] = []
    while run.steps < settings.steps:
        progress.append(run.update())
        follow(progress[-1])
    card = PolicyCard(
        world=world,
        world_options={},
        action_names=example_world.action_names,
        image_shape=get_image_shape(space),
        eyesight=eyesight,
        eyes=eyes,
        trained_by="batch ppo",
        steps=run.steps,
        seed=seed,
        notes={"settings": asdict(settings)},
        memory=settings.memory,
    )
    save_policy(policy.cpu(), card, out)
    _write_curve(progress, out.with_suffix(".csv"))
    return progress


def _choose_encoder(image_shape: tuple[int, int, int]) -> EncoderName:
    """Return the name of the encoder that suits images of a shape (channels, height, width)."""
    channels, height, _ = image_shape
    if height > 20:
        return "atari"
    if channels == 3:
        return "codes"
    return "planes"


def _write_curve(progress: list[CurvePoint], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(asdict(progress[0])))
        writer.writeheader()
        writer.writerows(map(asdict, progress))


def _make_batch(world: str, count: int, **options: Any) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Make a batch of worlds, in which each world begins its next episode in the step that ends one."""
    try:
        return gymnasium.make_vec(
            world,
            num_envs=count,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP,
            **options,
        )
    except gymnasium.error.Error:
        raise LearnError(f"{world} has no batch of worlds; choose a world of minihuman's own") from None


class _Seats:
    """A batch of team worlds in which each seat counts as a separate world, so that one policy plays with itself.

    Shaping rewards for useful steps (`TeamBatch.shaping`, where a world has them) decrease to 0 by the middle of the
    training run, as in Carroll et al., "On the Utility of Learning about Humans for Human-AI Coordination" (2019).
    """

    def __init__(self, team: TeamWorld, settings: BatchPpoSettings) -> None:
        self._batch = team.batch(max(1, settings.worlds // team.bodies))
        self._bodies = team.bodies
        self._steps = 0
        self._shaped_steps = settings.steps / 2
        self.num_envs = self._batch.num_worlds * team.bodies

    def reset(self, *, seed: int) -> tuple[NDArray[Any], dict[str, Any]]:
        return self._batch.reset(seed).reshape(self.num_envs, *self._batch.observations.shape[2:]), {}

    def step(self, actions: NDArray[np.int64]) -> tuple[Any, ...]:
        _, rewards, ends = self._batch.step(actions.reshape(-1, self._bodies))
        shaping_weight = max(0.0, 1 - self._steps / self._shaped_steps)
        rewards = rewards + shaping_weight * getattr(self._batch, "shaping", 0.0)
        self._steps += self.num_envs
        over = np.repeat(ends, self._bodies)
        observations = self._batch.observations.reshape(self.num_envs, *self._batch.observations.shape[2:])
        return observations, rewards.ravel(), over, np.zeros_like(over), {}


_encode_mission = lru_cache(maxsize=1024)(encode_mission)


class _Run:
    """A training run, with its worlds, their current observations, and the network's memory of each world."""

    def __init__(
        self,
        policy: Policy,
        worlds: Any,  # a batch, or the seats of one
        spreads: bool,
        missions: bool,
        settings: BatchPpoSettings,
        seed: int,
    ) -> None:
        self.steps = self.episodes = 0
        self._policy = policy
        self._worlds = worlds
        self._settings = settings
        self._spread = np.array(1, np.uint8)
        if spreads:
            self._spread = np.array(SPREAD, np.uint8)
        self._missions = missions
        self._optimizer = torch.optim.Adam(policy.parameters(), settings.learning_rate, eps=1e-5, fused=True)
        self._observations = self._encode(worlds.reset(seed=seed)[0])
        self._hidden = torch.zeros(settings.worlds, policy.features_dim, device=settings.device)
        self._starts = torch.ones(settings.worlds, device=settings.device)  # 1.0 where an episode begins
        self._returns = np.zeros(settings.worlds)
        self._recent: deque[tuple[float, bool]] = deque(maxlen=RECENT)

    def update(self) -> CurvePoint:
        """Collect a rollout, update the policy from it, and return the new point of the learning curve."""
        hidden = self._hidden
        rollout = self._collect()
        for group in self._optimizer.param_groups:  # falls to nothing
            group["lr"] = self._settings.learning_rate * max(0.0, 1 - self.steps / self._settings.steps)
        self._learn(rollout, hidden)
        mean, success = np.mean(self._recent or [(math.nan, math.nan)], axis=0).tolist()
        return CurvePoint(self.steps, self.episodes, mean, success, time.process_time())

    def _collect(self) -> Batch:
        """Act for a rollout; return its steps by field, each of shape [rollout, worlds, ...], with advantages."""
        settings = self._settings
        policy = self._policy
        steps_by_field: dict[str, list[torch.Tensor]] = {}
        rewards = torch.zeros(settings.rollout, settings.worlds)
        with torch.no_grad():
            for t in range(settings.rollout):
                step_fields = {_OBSERVATION_PREFIX + name: part for name, part in self._observations.items()}
                log_probs, values, self._hidden = policy.think_on(self._observations, self._hidden, self._starts)
                actions = torch.multinomial(log_probs.exp(), 1).squeeze(1)
                chosen = log_probs.gather(1, actions[:, None]).squeeze(1)
                step_fields |= {
                    "actions": actions,
                    "log_probs": chosen,
                    "values": values.squeeze(1),
                    "starts": self._starts,
                }
                for name, part in step_fields.items():
                    steps_by_field.setdefault(name, []).append(part)
                rewards[t] = self._step(actions.cpu().numpy())
            _, last, _ = policy.think_on(self._observations, self._hidden, self._starts)
        rollout = {name: torch.stack(parts) for name, parts in steps_by_field.items()}
        rewards = rewards.to(settings.device)
        ends = torch.cat((rollout["starts"][1:], self._starts[None]))
        next_values = torch.cat((rollout["values"][1:], last.T))
        rollout["advantages"] = self._estimate_advantages(rewards, rollout["values"], next_values, ends)
        return rollout

    def _estimate_advantages(
        self, rewards: torch.Tensor, values: torch.Tensor, next_values: torch.Tensor, ends: torch.Tensor
    ) -> torch.Tensor:
        """Return the generalised advantage estimate of each step; all arrays have the shape [rollout, worlds]."""
        settings = self._settings
        advantage = torch.zeros_like(next_values[-1])
        newest_first = []
        for t in reversed(range(settings.rollout)):
            discount = settings.discount * (1 - ends[t])
            temporal_difference = rewards[t] + discount * next_values[t] - values[t]
            advantage = temporal_difference + discount * settings.trace * advantage
            newest_first.append(advantage)
        return torch.stack(newest_first[::-1])

    def _step(self, actions: NDArray[np.int64]) -> torch.Tensor:
        """Step every world; return rewards float32[n].

        At a step limit, the reward includes the discounted value of the state that followed.
        """
        raw, rewards, terminated, truncated, infos = self._worlds.step(actions)
        rewards = np.asarray(rewards, np.float32)
        over = terminated | truncated
        self._returns += rewards
        for i in np.flatnonzero(over).tolist():
            self._recent.append((float(self._returns[i]), bool(terminated[i] and rewards[i] > 0)))
        self.steps += len(actions)
        self.episodes += int(over.sum())
        self._returns[over] = 0.0
        limited = np.flatnonzero(truncated & ~terminated)
        if len(limited):
            final_observations = self._encode([infos["final_obs"][i] for i in limited])
            starts = torch.zeros(len(limited), device=self._settings.device)
            _, beyond, _ = self._policy.think_on(final_observations, self._hidden[limited], starts)
            rewards[limited] += self._settings.discount * beyond.squeeze(1).cpu().numpy()
        self._observations = self._encode(raw)
        self._starts = torch.as_tensor(over, dtype=torch.float32, device=self._settings.device)
        return torch.from_numpy(rewards)

    def _learn(self, rollout: Batch, hidden: torch.Tensor) -> None:
        """Update the policy from a rollout, whose memory at the first step is ``hidden``."""
        settings = self._settings
        returns = rollout["advantages"] + rollout["values"]
        if settings.memory:
            parts = settings.worlds
        else:
            parts = settings.worlds * settings.rollout
        for _ in range(settings.epochs):
            for chosen in torch.randperm(parts).chunk(settings.minibatches):
                if settings.memory:  # whole rollouts of some worlds
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
                nn.utils.clip_grad_norm_(self._policy.parameters(), settings.gradient)
                self._optimizer.step()

    def _compute_loss(self, minibatch: Batch, return_targets: torch.Tensor, start_hidden: torch.Tensor) -> torch.Tensor:
        """Return PPO's loss on a minibatch: clipped policy gain, value error and entropy."""
        settings = self._settings
        observations = {
            name.removeprefix(_OBSERVATION_PREFIX): part
            for name, part in minibatch.items()
            if name.startswith(_OBSERVATION_PREFIX)
        }
        log_probs, values = self._policy.think_through(observations, start_hidden, minibatch["starts"])
        log_prob = log_probs.gather(1, minibatch["actions"].flatten()[:, None]).squeeze(1)
        advantages = minibatch["advantages"].flatten()
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        ratio = (log_prob - minibatch["log_probs"].flatten()).exp()
        clipped = ratio.clamp(1 - settings.clip, 1 + settings.clip)
        gain = torch.min(ratio * advantages, clipped * advantages).mean()
        entropy = -(log_probs.exp() * log_probs).sum(dim=1).mean()
        error = (values.squeeze(1) - return_targets).square().mean()
        return settings.value * error - gain - settings.entropy * entropy

    def _encode(self, raw: Any) -> Batch:
        """Return observations as tensors on the device.

        ``raw`` is the observation of a whole batch, or a list of single observations.
        """
        if isinstance(raw, list):
            if isinstance(raw[0], dict):
                raw = {name: [observation[name] for observation in raw] for name in raw[0]}
            else:
                raw = np.stack(raw)
        image = raw
        if isinstance(raw, dict):
            image = raw["image"]
        image = np.asarray(image) * self._spread
        observations = {"image": torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, -1, 1)))}
        if self._missions:
            observations["mission"] = torch.from_numpy(np.stack([_encode_mission(text) for text in raw["mission"]]))
        return {name: part.to(self._settings.device) for name, part in observations.items()}
