"""Cooperative Pong, one of PettingZoo's own environments, as a world of teams; any other is registered the same way."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo.butterfly.cooperative_pong import cooperative_pong

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.team import TeamStep, TeamWorld

NO_LIMIT = 2**31 - 1  # of steps, but for the environment's own end


class PettingZooTeam(TeamWorld):
    """An environment with PettingZoo's parallel API as a team world. Nobody knows where its bodies are.

    It cannot be copied in the middle of an episode: PettingZoo promises nothing of the kind. Every seat sees its one
    picture. An agent that is out idles until the last one is.

    Args:
        make: makes the environment, given ``render_mode="rgb_array"`` and the options.
        action_names: what agents can do, in the environment's order; by number where there are none.
        idle_action: what an agent without an input does.
        **options: keyword arguments of the environment.

    Raises:
        WorldError: if agents differ in what they can do or observe, or actions are not numbers or observations arrays.
    """

    def __init__(
        self, make: Callable[..., Any], action_names: Sequence[str] = (), idle_action: int = 0, **options: Any
    ) -> None:
        env = self._env = make(render_mode="rgb_array", **options)
        self._agents, self._steps = list(env.possible_agents), 0
        both = [(env.action_space(agent), env.observation_space(agent)) for agent in self._agents]
        actions, observed = both[0]
        equal = all(one == both[0] for one in both)
        if not (equal and isinstance(actions, spaces.Discrete) and isinstance(observed, spaces.Box)):
            raise WorldError(
                f"{env} needs one Discrete action space and one Box observation space for all agents, not {both}"
            )
        self.bodies, self.observation_space, self._first_action = len(both), observed, int(actions.start)
        self.action_names = tuple(action_names or map(str, range(int(actions.n))))
        self.idle_action, self.mission, self.max_steps = idle_action, "", NO_LIMIT
        self._observed: dict[str, NDArray[Any]] = {}

    def reset(self, seed: int) -> None:
        """Begin a new episode."""
        self._observed, self._steps = dict(self._env.reset(seed=seed)[0]), 0

    def step(self, actions: Sequence[int]) -> TeamStep:
        """Make one joint step."""
        self.check_actions(actions)
        living = list(self._env.agents) if self._observed else []
        if not living:
            raise WorldError("no episode runs; call reset first")
        by_agent = dict(zip(self._agents, actions, strict=True))
        done = self._env.step({agent: by_agent[agent] + self._first_action for agent in living})
        observed, rewards, terminated, truncated, _ = done
        self._observed |= observed
        self._steps += 1
        over = all(terminated[agent] or truncated[agent] for agent in living)
        ended = over and any(terminated.values())
        return TeamStep(tuple(float(rewards.get(agent, 0)) for agent in self._agents), ended, over and not ended)

    def observation(self, body: int) -> NDArray[Any]:
        """A copy of what the agent observed last."""
        return np.array(self._observed[self._agents[body]])

    def frame(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> NDArray[np.uint8]:
        """The environment's own picture, of its own size."""
        return np.array(self._env.render(), np.uint8)

    def pose(self, body: int) -> Pose:
        """Unknown: not a number."""
        return Pose(math.nan, math.nan, math.nan, math.nan)

    def map(self) -> Map:
        """Unknown: empty."""
        return Map("cell", (0.0, 0.0, 0.0, 0.0), (), ())

    def state_hash(self) -> int:
        """Of what all observe, who is still in, and the number of steps: the state itself is not known."""
        return hash64({"observed": self._observed, "living": list(self._env.agents), "steps": self._steps})

    def save(self) -> Any:
        """Refuse to."""
        raise WorldError(f"{self._env} cannot be copied in the middle of an episode")

    def restore(self, saved: Any) -> None:
        """Refuse to."""
        self.save()


class CooperativePong(PettingZooTeam):
    """Two paddles that keep one ball in play."""

    def __init__(self, **options: Any) -> None:
        super().__init__(cooperative_pong.parallel_env, ("stay", "up", "down"), **options)


gymnasium.register("Lab/CooperativePong-v0", entry_point=CooperativePong)
