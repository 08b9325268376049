"""The port of every agent that plays beside a person: it looks at the world and says what it thinks of each action.

Agents register in the entry-point group ``minihuman.agents``; ``policy`` is a policy file's.
"""

import abc
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import PlayerError
from minihuman.players.port import way_of
from minihuman.plugins import check_made, load, names
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World

GROUP = "minihuman.agents"
POLICY = "policy"  # the agent that a policy file is


class Agent(abc.ABC):
    """Made of what follows its name's colon. It draws nothing: which of its actions is done is the session's to say."""

    def __init__(self, argument: str) -> None:
        self.argument = argument

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, world: World) -> None:
        """An episode starts.

        Raises:
            MinihumanError: if it cannot play that world.
        """

    @abc.abstractmethod
    def advise(self, world: World) -> NDArray[np.float32]:
        """How likely each of the world's actions is to be the best now, float32[actions], summing to 1."""


class RandomAgent(Agent):
    """Every action that has a key is as good as another."""

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Find out which they are."""
        keyed = set(plan.key_map.keys.values())
        chances = np.array([name in keyed for name in world.action_names], np.float32)
        self._chances: NDArray[np.float32] = chances / chances.sum(dtype=np.float32)

    def advise(self, world: World) -> NDArray[np.float32]:
        """The same in every state."""
        return self._chances


class OptimalAgent(Agent):
    """Does what a shortest way to success does; ``optimal:0.2`` does any action in two of ten steps."""

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """See how often it is to go astray.

        Raises:
            PlayerError: if that is no share.
        """
        try:
            self._astray = float(self.argument or 0.0)
        except ValueError:
            self._astray = -1.0
        if not 0 <= self._astray <= 1:
            raise PlayerError(f"agent optimal: {self.argument!r} is no share of steps; use 0 to 1")
        self._random = RandomAgent("")
        self._random.begin(plan, world)

    def advise(self, world: World) -> NDArray[np.float32]:
        """The first action of the way.

        Raises:
            PlayerError: if there is none.
        """
        way = way_of(world)
        if not way:
            raise PlayerError(f"{world.id}: there is no way to the goal from {world.pose()}")
        best = np.array([name == way[0] for name in world.action_names], np.float32)
        return np.float32(1 - self._astray) * best + np.float32(self._astray) * self._random.advise(world)


def is_agent(name: str) -> bool:
    """Whether a protocol's ``policy`` names a registered agent, and no file."""
    return name.partition(":")[0] in names(GROUP)


def agent_kind(name: str) -> Any:
    """What makes a registered agent, imported with all that it needs.

    Raises:
        MinihumanError: if there is none of that name, or it cannot be imported.
    """
    return load(GROUP, name, PlayerError, what="agent")


def make_agent(name: str) -> Agent:
    """A registered agent by its name and what follows the colon.

    Raises:
        MinihumanError: if there is none of that name, or it cannot be made.
    """
    kind, _, argument = name.partition(":")
    made: Any = agent_kind(kind)(argument)
    check_made(made, Agent, PlayerError, group=GROUP, name=kind)
    assert isinstance(made, Agent)  # checked just now
    return made


def agent_of_file(path: Path) -> Agent:
    """The agent that a policy file is.

    Raises:
        MinihumanError: if it is none.
    """
    return make_agent(f"{POLICY}:{path}")
