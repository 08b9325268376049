"""Training with PPO, stoppable at any moment: what is lost is at most the update in progress, never the result."""

import os
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
from stable_baselines3.common.vec_env import DummyVecEnv

from minihuman.errors import LearnError
from minihuman.learn.agent.network import Eyes, Policy, policy_settings
from minihuman.learn.agent.ppo import LeanPpo
from minihuman.learn.agent.training_world import TrainingWorld
from minihuman.learn.transfer.plan import Ppo

LAST_EPISODES = 100  # a curve's point is the mean over so many


@dataclass(frozen=True, slots=True)
class Point:
    """One update of a learning curve: means over the last 100 episodes."""

    steps: int
    reward: float
    length: float
    success: float  # share that ended by themselves with a reward


@dataclass(slots=True)
class History:
    """A curve so far, and where the time went (seconds, over all sittings)."""

    points: list[Point] = field(default_factory=list)
    world_s: float = 0.0  # the world's steps and pictures
    acting_s: float = 0.0  # choosing actions
    learning_s: float = 0.0  # the updates
    cpu_s: float = 0.0  # of the processor, for all of it: what it took where other work waits too


def new_ppo(world: TrainingWorld, *, settings: Ppo, eyes: Eyes, seed: int, device: str) -> LeanPpo:
    """A fresh agent in a world, seeded."""
    ppo = LeanPpo(
        Policy,
        DummyVecEnv([lambda: world]),
        n_steps=settings.n_steps,
        batch_size=settings.batch_size,
        n_epochs=settings.n_epochs,
        learning_rate=settings.learning_rate,
        clip_range=settings.clip_range,
        policy_kwargs=policy_settings(eyes),
        seed=seed,
        device=device,
        stats_window_size=LAST_EPISODES,
    )
    ppo.policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return ppo


def train(
    ppo: PPO,
    world: TrainingWorld,
    *,
    steps: int,
    checkpoint: Path | None = None,
    told: Callable[[int], None] = lambda steps: None,
) -> History:
    """Train for so many steps in all, going on from the checkpoint where there is one.

    A run that is killed and started again ends with the same weights and the same curve, to the bit, as one that was
    not (on the CPU, with the same number of threads). ``told`` hears the number of steps after every update.

    Raises:
        LearnError: if the checkpoint was written by another version; it is left as it is.
    """
    history = History()
    if checkpoint is not None and checkpoint.exists():
        history = _resume(ppo, world, read_checkpoint(checkpoint))
    fresh = ppo.num_timesteps == 0
    if ppo.num_timesteps < steps:
        ledger = _Ledger(world, history, checkpoint, told)
        ppo.learn(steps - ppo.num_timesteps, callback=ledger, log_interval=None, reset_num_timesteps=fresh)  # type: ignore[arg-type]
    return history


class _Ledger(BaseCallback):
    """Writes down each update; between an update and the next rollout everything is at rest, so it saves there."""

    def __init__(
        self, world: TrainingWorld, history: History, checkpoint: Path | None, told: Callable[[int], None]
    ) -> None:
        super().__init__()
        self._world = world
        self._history = history
        self._checkpoint = checkpoint
        self._told = told
        self._mark, self._cpu_mark = time.perf_counter(), time.process_time()
        self._learning = False

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._finish_update()
        self._mark, self._cpu_mark = time.perf_counter(), time.process_time()
        self._world.step_s = 0.0

    def _on_rollout_end(self) -> None:
        now = time.perf_counter()
        history, world_s = self._history, self._world.step_s
        history.world_s += world_s
        history.acting_s += now - self._mark - world_s
        episodes = self.model.ep_info_buffer
        if episodes:
            reward, length = (float(np.mean([episode[key] for episode in episodes])) for key in ("r", "l"))
            success = float(np.mean(self.model.ep_success_buffer or ()))
            history.points.append(Point(self.num_timesteps, reward, length, success))
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


def _snapshot(ppo: PPO, world: TrainingWorld, history: History) -> dict[str, Any]:
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


def read_checkpoint(checkpoint: Path) -> dict[str, Any]:
    """A checkpoint's content: tensors and plain values.

    Raises:
        LearnError: if it was written by another version; it is left as it is.
    """
    try:
        # weights_only: a study's folder from elsewhere must not be able to run code
        saved: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=True)
    except Exception as error:  # unpickling raises whatever it likes
        raise LearnError(
            f"{checkpoint} cannot be read by this version ({type(error).__name__}); "
            "go on with the version that wrote it, or move it away and the job starts anew"
        ) from error
    return saved


def _resume(ppo: PPO, world: TrainingWorld, saved: dict[str, Any]) -> History:
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
    return history_of(saved)


def history_of(saved: dict[str, Any]) -> History:
    """The history in a checkpoint's content."""
    kept = saved["history"]
    return History(**kept | {"points": [Point(**point) for point in kept["points"]]})


def save_atomically(value: Any, path: Path) -> None:
    """Write a file with ``torch.save`` so that a crash leaves the old one or the new one, whole."""
    unfinished = path.with_name(path.name + ".part")
    with unfinished.open("wb") as file:
        torch.save(value, file)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
