"""Training that can stop at any moment: at most the update in progress is lost, never the result."""

import random
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from minihuman.learn.policy.file import read_checkpoint, save_atomically
from minihuman.learn.policy.observation import Observation
from minihuman.learn.ppo import LAST_EPISODES, TrainingEnv
from minihuman.worlds.contract import NativeWorld


@dataclass(frozen=True, slots=True)
class TrainingPoint:
    """One update of a learning curve: means over the last 100 episodes."""

    steps: int
    reward: float
    length: float
    success: float  # share that ended by themselves with a reward


class LearningCurve(BaseCallback):
    """Notes a point after each rollout, once an episode has ended."""

    def __init__(self) -> None:
        super().__init__()
        self.points: list[TrainingPoint] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        if episodes := self.model.ep_info_buffer:
            reward, length = (float(np.mean([episode[key] for episode in episodes])) for key in ("r", "l"))
            success = float(np.mean(self.model.ep_success_buffer or ()))
            self.points.append(TrainingPoint(self.num_timesteps, reward, length, success))


class ResumableEnv(TrainingEnv):
    """A world under training that can be put back to where it was, and says how long it took."""

    step_s = 0.0  # wall time spent inside the world

    @property
    def action_names(self) -> tuple[str, ...]:
        """The world's action names; the agent may use only the first few."""
        assert isinstance(self.world, NativeWorld)
        return self.world.action_names

    def reset(self, **_: Any) -> tuple[Observation, dict[str, Any]]:
        """Begin the next episode."""
        started = time.perf_counter()
        begun = super().reset()
        self._actions: list[int] = []  # of the episode so far
        self.step_s += time.perf_counter() - started
        return begun

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One step of the world."""
        started = time.perf_counter()
        self._actions.append(int(action))
        stepped = super().step(action)
        self.step_s += time.perf_counter() - started
        return stepped

    def save(self) -> dict[str, Any]:
        """The state to resume from, in plain values: the episode's number and its actions."""
        return {"episode": self._episode, "actions": list(self._actions)}

    def restore(self, saved: dict[str, Any]) -> Observation:
        """Replay the episode up to a saved point; return the observation there."""
        self._episode = saved["episode"] - 1
        seen, _ = self.reset()
        for action in saved["actions"]:
            seen, *_ = self.step(action)
        return seen


@dataclass(slots=True)
class TrainingHistory:
    """A curve so far, and where the time went (seconds, over all sittings)."""

    points: list[TrainingPoint] = field(default_factory=list)
    world_s: float = 0.0  # the world's steps and pictures
    acting_s: float = 0.0  # choosing actions
    learning_s: float = 0.0  # the updates
    cpu_s: float = 0.0  # of the processor, for all of it: what it took where other work waits too


def train_resumably(
    ppo: PPO,
    world: ResumableEnv,
    *,
    steps: int,
    checkpoint: Path | None = None,
    told: Callable[[int], None] = lambda steps: None,
) -> TrainingHistory:
    """Train for ``steps`` in all, resuming from the checkpoint if there is one.

    A run that is killed and started again ends with the same weights and the same curve, to the bit, as one that was
    not (on the CPU, with the same number of threads). ``told`` is called with the number of steps after every update.

    Raises:
        LearnError: if the checkpoint was written by another version; it is left as it is.
    """
    history = TrainingHistory()
    if checkpoint is not None and checkpoint.exists():
        history = _resume(ppo, world, read_checkpoint(checkpoint))
    fresh = ppo.num_timesteps == 0
    if ppo.num_timesteps < steps:
        ledger = _Ledger(world, history, checkpoint, told)
        ppo.learn(steps - ppo.num_timesteps, callback=ledger, log_interval=None, reset_num_timesteps=fresh)  # type: ignore[arg-type]
    return history


class _Ledger(LearningCurve):
    """Writes down each update; between an update and the next rollout everything is at rest, so it saves there."""

    def __init__(
        self, world: ResumableEnv, history: TrainingHistory, checkpoint: Path | None, told: Callable[[int], None]
    ) -> None:
        super().__init__()
        self.points = history.points
        self._world = world
        self._history = history
        self._checkpoint = checkpoint
        self._told = told
        self._mark, self._cpu_mark = time.perf_counter(), time.process_time()
        self._learning = False

    def _on_rollout_start(self) -> None:
        self._finish_update()
        self._mark, self._cpu_mark = time.perf_counter(), time.process_time()
        self._world.step_s = 0.0

    def _on_rollout_end(self) -> None:
        super()._on_rollout_end()
        now = time.perf_counter()
        self._history.world_s += self._world.step_s
        self._history.acting_s += now - self._mark - self._world.step_s
        self._mark = now
        self._learning = True

    def _on_training_end(self) -> None:
        self._finish_update()

    def _finish_update(self) -> None:
        if not self._learning:
            return
        self._learning = False
        self._history.learning_s += time.perf_counter() - self._mark
        self._history.cpu_s += time.process_time() - self._cpu_mark
        assert isinstance(self.model, PPO)
        if self._checkpoint is not None:
            save_atomically(_snapshot(self.model, self._world, self._history), self._checkpoint)
        self._told(self.num_timesteps)


def _snapshot(ppo: PPO, world: ResumableEnv, history: TrainingHistory) -> dict[str, Any]:
    held = {id(parameter) for group in ppo.policy.optimizer.param_groups for parameter in group["params"]}
    return {
        "policy": ppo.policy.state_dict(),
        "optimiser": ppo.policy.optimizer.state_dict(),
        # parameters outside the optimiser are never cleared: their gradients are state (as-published only)
        "stray_gradients": {
            name: parameter.grad
            for name, parameter in ppo.policy.named_parameters()
            if id(parameter) not in held and parameter.grad is not None
        },
        "steps": ppo.num_timesteps,
        "updates": ppo._n_updates,
        "episode_starts": bool(ppo._last_episode_starts[0]),  # type: ignore[index]
        "episodes": list(ppo.ep_info_buffer or ()),
        "successes": [bool(success) for success in ppo.ep_success_buffer or ()],
        "world": world.save(),
        "python_random": random.getstate(),
        "numpy_random": _plain(np.random.get_state()),  # minibatches are drawn from the global stream
        "torch_random": torch.get_rng_state(),
        "cuda_random": torch.cuda.get_rng_state_all(),
        "history": asdict(history),
    }


def _plain(state: Any) -> tuple[Any, ...]:
    """NumPy's random state without an array in it."""
    kind, keys, *rest = state
    return (kind, keys.tolist(), *rest)


def _resume(ppo: PPO, world: ResumableEnv, saved: dict[str, Any]) -> TrainingHistory:
    ppo.policy.load_state_dict(saved["policy"])
    ppo.policy.optimizer.load_state_dict(saved["optimiser"])
    parameters = dict(ppo.policy.named_parameters())
    for name, gradient in saved["stray_gradients"].items():
        parameters[name].grad = gradient.to(parameters[name].device)
    ppo.num_timesteps = saved["steps"]
    ppo._n_updates = saved["updates"]
    ppo._last_episode_starts = np.array([saved["episode_starts"]])
    ppo.ep_info_buffer = deque(saved["episodes"], maxlen=LAST_EPISODES)
    ppo.ep_success_buffer = deque(saved["successes"], maxlen=LAST_EPISODES)
    ppo._last_obs = {name: part[None] for name, part in world.restore(saved["world"]).items()}
    random.setstate(saved["python_random"])
    np.random.set_state(saved["numpy_random"])
    torch.set_rng_state(saved["torch_random"])
    torch.cuda.set_rng_state_all(saved["cuda_random"])
    return get_history(saved)


def get_history(saved: dict[str, Any]) -> TrainingHistory:
    """The history in a checkpoint's content."""
    kept = saved["history"]
    return TrainingHistory(**kept | {"points": [TrainingPoint(**point) for point in kept["points"]]})
