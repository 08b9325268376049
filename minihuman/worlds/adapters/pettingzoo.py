"""Team worlds with PettingZoo's parallel API: ``minihuman.parallel_env("minihuman/Team-FourRooms-v0")``.

Agents are named "body_0", "body_1", and so on. PettingZoo is optional; where it is installed, the environment is a
subclass of its `ParallelEnv`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.worlds.team import TeamWorld, make_team

if TYPE_CHECKING:
    _Base = Any
else:
    try:
        from pettingzoo import ParallelEnv as _Base
    except ModuleNotFoundError:
        _Base = object

AgentObservations = dict[str, NDArray[Any]]


class TeamParallelEnv(_Base):  # type: ignore[misc]  # only known where PettingZoo is installed
    """A team world with PettingZoo's parallel API, in which an episode ends for all agents at once.

    Args:
        world: the team world, which is also available as `unwrapped.world`
        world_id: the world's id
    """

    def __init__(self, world: TeamWorld, world_id: str) -> None:
        self.world = world
        self.metadata = {"name": world_id, "render_modes": ["rgb_array"], "is_parallelizable": True}
        self.render_mode = "rgb_array"
        self.possible_agents = [f"body_{body}" for body in range(world.bodies)]
        self.agents: list[str] = []
        self.observation_spaces = dict.fromkeys(self.possible_agents, world.observation_space)
        self.action_spaces = {agent: spaces.Discrete(len(world.action_names)) for agent in self.possible_agents}
        self._seeds = np.random.default_rng()

    def observation_space(self, agent: str) -> spaces.Box:
        """Return an agent's observation space."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        """Return an agent's action space."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[AgentObservations, dict[str, dict[str, Any]]]:
        """Begin an episode; return observations and empty infos by agent.

        Without a seed, one is drawn from the random stream of the last seed.
        """
        if seed is not None:
            self._seeds = np.random.default_rng(seed)
        self.world.reset(int(self._seeds.integers(2**63)) if seed is None else seed)
        self.agents = list(self.possible_agents)
        return self._observations(), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, int]
    ) -> tuple[AgentObservations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Make one joint step, in which an agent without an action idles.

        Returns:
            Observations, rewards, terminations, truncations and infos, each by agent.
        """
        idle = self.world.idle_action
        agents = self.agents
        joint_step = self.world.step([int(actions.get(agent, idle)) for agent in self.possible_agents])
        if joint_step.terminated or joint_step.truncated:
            self.agents = []
        agent_infos = joint_step.infos or ({},) * len(agents)
        return (
            self._observations(),
            dict(zip(agents, joint_step.rewards, strict=True)),
            dict.fromkeys(agents, joint_step.terminated),
            dict.fromkeys(agents, joint_step.truncated),
            {agent: {**joint_step.info, **info} for agent, info in zip(agents, agent_infos, strict=True)},
        )

    def _observations(self) -> AgentObservations:
        return {agent: self.world.observation(body) for body, agent in enumerate(self.possible_agents)}

    def render(self) -> NDArray[np.uint8]:
        """Return the picture that a person in body 0 sees, uint8[H, W, 3] of at most 640 by 480 pixels."""
        return self.world.frame(0, 640, 480)

    def close(self) -> None:
        """Do nothing, since there is nothing to close."""


def parallel_env(world_id: str, **options: Any) -> TeamParallelEnv:
    """Make a team world with PettingZoo's parallel API.

    Raises:
        WorldError: if the world cannot be made, as for `make_team`.
    """
    return TeamParallelEnv(make_team(world_id, **options), world_id)
