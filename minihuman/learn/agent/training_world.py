"""A world as training meets it: seeded episodes, the agent's eyesight, and a way to stop and go on exactly."""

import time
from typing import Any

import gymnasium
from gymnasium import spaces

from minihuman.learn.agent.observe import Eyesight, Observation, image_shape
from minihuman.worlds.contract import NativeWorld
from minihuman.worlds.hashing import hash64


class TrainingWorld(gymnasium.Env[Any, Any]):
    """A world under training. Every episode resets with its own seed, counted from the job's.

    Episodes' returns and lengths are in ``info["episode"]`` as Stable-Baselines3 expects them, without wall times.
    """

    def __init__(
        self,
        world_id: str,
        options: dict[str, Any],
        *,
        seed: int,
        eyesight: Eyesight,
        actions: int | None = None,
    ) -> None:
        """Make the world.

        Args:
            world_id: A Gymnasium id; only our own worlds can be saved.
            options: Keyword arguments of ``gymnasium.make``.
            seed: From which every episode's seed is drawn.
            eyesight: What the agent sees of it.
            actions: How many actions the agent is told of; None for all.
        """
        self.world = gymnasium.make(world_id, disable_env_checker=True, **options).unwrapped
        self.eyesight = eyesight
        self._looker = eyesight.looker()
        self.observation_space = eyesight.space(self.world)
        self.image_shape = image_shape(self.observation_space)
        assert isinstance(self.world.action_space, spaces.Discrete)
        self.action_space = spaces.Discrete(actions or int(self.world.action_space.n))
        self.step_s = 0.0  # wall time spent inside the world
        self._seed = seed
        self._episode = -1
        self._return = 0.0
        self._actions: list[int] = []  # of the episode so far

    @property
    def action_names(self) -> tuple[str, ...]:
        """The world's action names; the agent may have been told of the first few only."""
        assert isinstance(self.world, NativeWorld)
        return self.world.action_names

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the next episode. A seed given here is ignored: the job's own decides."""
        started = time.perf_counter()
        self._episode += 1
        self._return, self._actions = 0.0, []
        raw, info = self.world.reset(seed=episode_seed(self._seed, self._episode))
        seen = self._looker.see(self.world, raw)
        self.step_s += time.perf_counter() - started
        return seen, info

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One step of the world."""
        started = time.perf_counter()
        raw, reward, terminated, truncated, info = self.world.step(int(action))
        self._return += float(reward)
        self._actions.append(int(action))
        if terminated or truncated:
            info["episode"] = {"r": self._return, "l": len(self._actions)}
            info["is_success"] = terminated and float(reward) > 0
        seen = self._looker.see(self.world, raw)
        self.step_s += time.perf_counter() - started
        return seen, float(reward), terminated, truncated, info

    def save(self) -> dict[str, Any]:
        """What is needed to go on from here, in plain values: which episode it is, and what was done in it."""
        return {"episode": self._episode, "actions": list(self._actions)}

    def restore(self, saved: dict[str, Any]) -> Observation:
        """Go on from a saved point: the episode is played again up to there. What is seen there is returned."""
        self._episode = saved["episode"] - 1
        seen, _ = self.reset()
        for action in saved["actions"]:
            seen, *_ = self.step(action)
        return seen


def episode_seed(seed: int, episode: int) -> int:
    """The reset seed of an episode, counted from 0."""
    return hash64((seed, "episode", episode)) % 2**31
