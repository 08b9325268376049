"""The agent interface, which gives the probability of each action in a world, and the random and the optimal agent.

Agents register in the entry-point group `minihuman.agents`; the agent `policy` loads a policy file.
"""

import abc
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.agents.goal_search import find_shortest_path
from minihuman.errors import SimulationError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.plugins import list_plugin_names, load_plugin, make_plugin
from minihuman.worlds.adapters.world import World

AGENT_GROUP = "minihuman.agents"
POLICY_AGENT = "policy"  # the name of the agent that loads a policy file


class BaseAgent(abc.ABC):
    """An agent that gives the probability of each action; the session draws the action.

    An agent is constructed from the text after the colon of its name.
    """

    def __init__(self, argument: str) -> None:
        self.argument = argument

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Start an episode.

        Raises:
            MinihumanError: if the agent cannot play the world.
        """

    @abc.abstractmethod
    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return the probability of each of the world's actions in the present state: float32[actions], with sum 1."""


class RandomAgent(BaseAgent):
    """An agent that gives every action with a key the same probability."""

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Set the probabilities: equal for all actions that have a key, and 0 for the others."""
        actions_with_key = set(plan.key_map.keys.values())
        chances = np.array([name in actions_with_key for name in world.action_names], np.float32)
        self._chances: NDArray[np.float32] = chances / chances.sum(dtype=np.float32)

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return the same probabilities in every state."""
        return self._chances


class OptimalAgent(BaseAgent):
    """An agent that follows a shortest path; ``optimal:0.2`` takes a random action with probability 0.2."""

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Read the probability of a random action from the agent's argument; without an argument, it is 0.

        Raises:
            SimulationError: if the probability is not from 0 to 1.
        """
        try:
            self._random_share = float(self.argument or 0.0)
        except ValueError:
            self._random_share = -1.0
        if not 0 <= self._random_share <= 1:
            raise SimulationError(
                f"agent optimal: {self.argument!r} is not a share of random actions; use a number from 0 to 1"
            )
        self._random = RandomAgent("")
        self._random.begin(plan, world)

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return the probabilities of a mixture of the shortest path's first action and a random action.

        Raises:
            SimulationError: if no path leads to the goal.
        """
        path = find_shortest_path(world)
        if not path:
            raise SimulationError(f"{world.id}: no path leads to the goal from {world.pose()}; use the random agent")
        best = np.array([name == path[0] for name in world.action_names], np.float32)
        random = self._random.action_probabilities(world)
        return np.float32(1 - self._random_share) * best + np.float32(self._random_share) * random


def is_registered_agent(name: str) -> bool:
    """Return whether a protocol's ``policy`` names a registered agent rather than a file."""
    return name.partition(":")[0] in list_plugin_names(AGENT_GROUP)


def load_agent_class(name: str) -> Any:
    """Import and return the class of a registered agent.

    Raises:
        MinihumanError: if no agent has that name, or it cannot be imported.
    """
    return load_plugin(AGENT_GROUP, name, SimulationError, noun="agent")


def make_agent(name: str) -> BaseAgent:
    """Make a registered agent from its name, with the text after the colon as its argument.

    Raises:
        MinihumanError: if no agent has that name, or it cannot be made.
    """
    return make_plugin(AGENT_GROUP, name, BaseAgent, SimulationError, noun="agent")  # type: ignore[type-abstract]


def make_policy_agent(path: Path) -> BaseAgent:
    """Make the agent of a policy file.

    Raises:
        MinihumanError: if the file holds no policy.
    """
    return make_agent(f"{POLICY_AGENT}:{path}")
