"""Agents in the seats of a team, each of which follows the joint actions in a world of its own."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.team.joint_step import JointAction
from minihuman.activities.team.plan import PERSON, SIMULATED, TeamPlan, find_seat_agent
from minihuman.activities.team.requests import Team
from minihuman.admin.policies import PolicyStore
from minihuman.agents.agent import BaseAgent, is_registered_agent, make_agent, make_policy_agent
from minihuman.errors import WorldError
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.simulation.participant import NoPress, make_participant
from minihuman.worlds.adapters.world import World


class SeatAgent:
    """An agent in one seat for one episode, which follows the joint actions in a world of its own.

    Args:
        agent: the agent that chooses actions.
        plan: the episode's plan, for any seat.
        team: the team; its index selects the agent's random stream.
        seat: the agent's seat.
        seed: the study's seed.
    """

    def __init__(self, agent: BaseAgent, plan: EpisodePlan, team: Team, seat: int, seed: int) -> None:
        self._world = World(plan.world, {**plan.options, "seat": seat})
        self._world.reset(plan.seed)
        self._agent = agent
        self._seat = seat
        self._n_steps = 0
        self._n_asked = 0  # number of states in which the agent was asked
        self._stream = f"team-agent-{plan.block_name}-{plan.episode_in_block}-{seat}"
        self._seed = seed
        self._index = team.index
        agent.begin(plan, self._world)

    def choose(self, steps: Sequence[JointAction]) -> int:
        """Return the agent's action after ``steps``, all joint actions of the episode so far.

        Raises:
            WorldError: if the agent gives no action a positive probability.
        """
        for step in steps[self._n_steps :]:
            if self._n_asked == self._n_steps:  # an agent with a memory has to see every state exactly once
                self._ask_agent()
            self._world.unwrapped.joint = step.actions
            self._world.step(step.actions[self._seat])
            self._n_steps += 1
        probabilities = self._ask_agent()
        if probabilities.shape != (len(self._world.action_names),) or not probabilities.sum() > 0:
            raise WorldError(
                f"the agent of seat {self._seat} must give a probability for each action, at least one of them above 0"
            )
        purpose = f"{self._stream}-{self._n_steps}"
        word = int(draw_words(1, seed=self._seed, purpose=purpose, index=self._index)[0])
        uniform = (word >> 11) / 2**53  # in [0, 1), from the highest 53 of the word's 64 bits
        sums = np.cumsum(probabilities)
        action = int(np.searchsorted(sums, uniform * sums[-1], side="right"))
        return min(action, len(sums) - 1)

    def _ask_agent(self) -> NDArray[np.float64]:
        """Return the agent's probability of each action in its world's present state, float64[actions]."""
        self._n_asked = self._n_steps + 1
        return np.asarray(self._agent.action_probabilities(self._world), np.float64)

    def close(self) -> None:
        """Close the agent's world."""
        self._world.close()


class SimulatedAgent(BaseAgent):
    """A simulated participant in a seat, who acts through keys and idles when a key has no action.

    Args:
        argument: the participant's name and settings, as ``make_participant`` takes them.
        rng: the participant's random generator.
        pool: every key that may have an action.
    """

    def __init__(self, argument: str, rng: np.random.Generator, pool: tuple[str, ...]) -> None:
        super().__init__(argument)
        self._participant = make_participant(argument, rng)
        self._pool = pool

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Begin an episode."""
        self._keys: Mapping[str, str] = plan.key_map.keys
        self._participant.begin(plan, self._pool, world)

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return probability 1 for the action of the pressed key, or for the idle action, and 0 for all others."""
        press = self._participant.press(world)
        names = world.action_names
        if press is None or isinstance(press, NoPress):
            name = ""
        else:
            name = self._keys.get(press.key, "")
        pressed_action: int = names.index(name) if name in names else world.unwrapped.team.idle_action
        return np.array([action == pressed_action for action in range(len(names))], np.float32)


class SeatAgents:
    """The agents of one team in its present episode.

    Args:
        protocol: the study.
        policies: the store of the study's policy files.
        team: the team, as seen from any seat.
        rules: the protocol's ``[blocks.team]``.
    """

    def __init__(self, protocol: Protocol, policies: PolicyStore, team: Team, rules: TeamPlan) -> None:
        self._protocol = protocol
        self._policies = policies
        self._team = team
        self._rules = rules
        self._agents: dict[int, SeatAgent] = {}  # by seat
        self._episode = -1

    def choose(self, seat: int, plan: EpisodePlan, steps: Sequence[JointAction]) -> int:
        """Return the action of a seat's agent after these joint actions of an episode.

        Args:
            seat: the seat of the agent.
            plan: the plan of the episode.
            steps: the joint actions of the episode so far.

        Raises:
            WorldError: if the agent gives no action a positive probability.
        """
        if self._episode != plan.episode:
            self.close()
            self._episode = plan.episode
        if seat not in self._agents:
            agent = self._load_agent(seat, f"simulated-{plan.episode}-{seat}")
            self._agents[seat] = SeatAgent(agent, plan, self._team, seat, self._protocol.study.seed)
        return self._agents[seat].choose(steps)

    def close(self) -> None:
        """Close the agents' worlds."""
        for agent in self._agents.values():
            agent.close()
        self._agents.clear()

    def _load_agent(self, seat: int, purpose: str) -> BaseAgent:
        """Return the agent of a seat; in the seat of a person who left, the team's stand-in.

        ``purpose`` names the random stream of a simulated participant.
        """
        kind = self._team.seats[seat]
        if kind == PERSON:
            kind = self._rules.stand_in
        name = find_seat_agent(kind)
        seat_kind, _, player = name.partition(":")
        if seat_kind == SIMULATED:
            [word] = draw_words(1, seed=self._protocol.study.seed, purpose=purpose, index=self._team.index)
            return SimulatedAgent(player, np.random.default_rng(int(word)), self._protocol.keys.pool)
        if is_registered_agent(name):
            return make_agent(name)
        return make_policy_agent(self._policies.checked(self._policies.keep(self._protocol.files[name])))
