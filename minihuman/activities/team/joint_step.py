"""Joint steps: the inputs of the open step, and the agents' actions that it needs before it closes. Reads no clock.

A closed step never reopens, and the first of two inputs of a seat for one step counts.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from minihuman.activities.team.events import ActionSource


class JointAction(NamedTuple):
    """The action of every body in a step, who decided it, and how long its people had given no sign of life."""

    actions: tuple[int, ...]  # by seat
    sources: tuple[ActionSource, ...]
    silent_ms: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class StepDue:
    """A step that can be closed once its agents have chosen."""

    episode: int
    step: int  # 1 for the first
    inputs: Mapping[int, int]  # of people, by seat
    late: frozenset[int]  # seats whose input did not come in time
    agents: tuple[int, ...]  # seats in which an agent acts
    silent_ms: tuple[int, ...] = ()  # by seat, as it is due

    def close(self, agent_actions: Mapping[int, int], idle_action: int) -> JointAction:
        """Return the joint action of people, agents and late seats.

        Args:
            agent_actions: the agents' actions, by seat.
            idle_action: the action of a seat whose input is late.
        """
        decisions: dict[int, tuple[int, ActionSource]] = {
            **{seat: (action, "person") for seat, action in self.inputs.items()},
            **dict.fromkeys(self.late, (idle_action, "late")),
            **{seat: (agent_actions[seat], "agent") for seat in self.agents},
        }
        seats = sorted(decisions)
        actions_by_seat = tuple(decisions[seat][0] for seat in seats)
        sources_by_seat = tuple(decisions[seat][1] for seat in seats)
        return JointAction(actions_by_seat, sources_by_seat, self.silent_ms)


class OpenStep:
    """The step that is open, with the inputs that have come for it.

    Args:
        n_seats: the number of the team's seats, including those of agents.
    """

    def __init__(self, n_seats: int) -> None:
        self._n_seats = n_seats
        self._episode_and_step = (-1, 0)  # episode and step; no episode has the index -1
        self._inputs: dict[int, int] = {}  # by seat
        self._idle: set[int] = set()  # seats whose input is the idle action of a tick, without a key

    @property
    def has_input(self) -> bool:
        """Return whether any seat has given an input."""
        return bool(self._inputs)

    @property
    def seats(self) -> frozenset[int]:
        """Return the seats that have given an input."""
        return frozenset(self._inputs)

    def has_submitted(self, seat: int, episode: int, step: int) -> bool:
        """Return whether a seat has given its input for a step."""
        return self._episode_and_step == (episode, step) and seat in self._inputs

    def open(self, episode: int, step: int) -> None:
        """Open a step, unless it is open already."""
        if self._episode_and_step != (episode, step):
            self._episode_and_step = (episode, step)
            self._inputs = {}
            self._idle = set()

    def submit(self, seat: int, action: int, *, is_key: bool = True) -> None:
        """Record a seat's input, unless the seat has one for this step; ``is_key``: a key gave it, not an idle tick."""
        if seat in self._inputs:
            return
        self._inputs[seat] = action
        if not is_key:
            self._idle.add(seat)

    def withdraw_idle(self, seats: Iterable[int]) -> None:
        """Discard the idle inputs, which no key gave, of seats that an agent now holds.

        The agent can then act in this step already.
        """
        for seat in self._idle & set(seats):
            del self._inputs[seat]
        self._idle -= set(seats)

    def find_due(self, late: frozenset[int]) -> StepDue:
        """Return the step as it would close now, given the seats whose input is late.

        An agent acts in each seat that has no input and is not late.
        """
        episode, step = self._episode_and_step
        agents = tuple(seat for seat in range(self._n_seats) if seat not in self._inputs and seat not in late)
        return StepDue(episode, step, dict(self._inputs), late, agents)
