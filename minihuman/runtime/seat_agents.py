"""Agents in the seats of a team: each follows the joint actions in a world of its own."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.team.events import ActionSource
from minihuman.activities.team.requests import (
    Team,
)
from minihuman.agents.agent import BaseAgent
from minihuman.errors import WorldError
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World

Row = tuple[tuple[int, ...], tuple[ActionSource, ...]]


class SeatAgent:
    """An agent in one seat of one episode: follows the joint actions in a world of its own.

    Args:
        agent: chooses.
        plan: the episode, of any seat.
        team: whose index its random stream has.
        seat: the agent's.
        seed: the study's.
    """

    def __init__(self, agent: BaseAgent, plan: EpisodePlan, team: Team, seat: int, seed: int) -> None:
        self._world = World(plan.world, {**plan.options, "seat": seat})
        self._world.reset(plan.seed)
        self._agent, self._seat, self._steps, self._asked = agent, seat, 0, 0  # asked: in how many states so far
        self._stream = f"team-agent-{plan.block_name}-{plan.episode_in_block}-{seat}"
        self._seed, self._index = seed, team.index
        agent.begin(plan, self._world)

    def choose(self, rows: Sequence[Row]) -> int:
        """The action that follows these joint actions.

        Raises:
            WorldError: if the agent gives no chance to any action.
        """
        for actions, _ in rows[self._steps :]:
            if self._asked == self._steps:  # an agent with a memory has to see every state, and each once
                self._ask()
            self._world.unwrapped.joint = actions
            self._world.step(actions[self._seat])
            self._steps += 1
        chances = self._ask()
        if chances.shape != (len(self._world.action_names),) or not chances.sum() > 0:
            raise WorldError(
                f"the agent of seat {self._seat} must give a probability for each action, at least one of them above 0"
            )
        purpose = f"{self._stream}-{self._steps}"
        word = int(draw_words(1, seed=self._seed, purpose=purpose, index=self._index)[0])
        sums = np.cumsum(chances)
        return min(int(np.searchsorted(sums, (word >> 11) / 2**53 * sums[-1], side="right")), len(sums) - 1)

    def _ask(self) -> NDArray[np.float64]:
        self._asked = self._steps + 1
        return np.asarray(self._agent.action_probabilities(self._world), np.float64)

    def close(self) -> None:
        """Close its world."""
        self._world.close()


class SimulatedAgent(BaseAgent):
    """A simulated participant in a seat: acts by the keys that it presses, and idles at a key without an action."""

    def __init__(self, argument: str, rng: np.random.Generator, pool: tuple[str, ...]) -> None:
        super().__init__(argument)
        self._participant, self._pool = make_participant(argument, rng), pool

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Begin an episode."""
        self._keys: Mapping[str, str] = plan.key_map.keys
        self._participant.begin(plan, self._pool, world)

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Give the action of the key that is pressed the probability 1."""
        press, names = self._participant.press(world), world.action_names
        name = "" if press is None else self._keys.get(press.key, "")
        number: int = names.index(name) if name in names else world.unwrapped.team.idle_action
        return np.array([action == number for action in range(len(names))], np.float32)
