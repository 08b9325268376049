"""An episode, as a notebook looks at it."""

import copy
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.measures.timing import playing_s
from minihuman.recorded.episode import Episode as Recorded
from minihuman.worlds.pose import Map

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A step played again: what was seen, what was done then, and what came of it."""

    step: int  # 1 for the first
    observation: Any  # before the action
    action: str
    reward: float
    terminated: bool
    truncated: bool


class Episode:
    """One played episode. Times are seconds of session time, since the session's first segment began."""

    def __init__(self, recorded: Recorded, *, participant: str, left_out: str) -> None:
        self.recorded = recorded  # everything: hashes, key presses, pictures shown
        self.participant = participant
        self.left_out = left_out  # why it does not count; "" if it does

    @property
    def number(self) -> int:
        """Which of the session's, 1 for the first, as on the screen, in tables and in figures."""
        return self.recorded.number

    @property
    def attempt(self) -> int:
        """1, or more where an interrupted episode was begun again."""
        return self.recorded.attempt

    @property
    def block(self) -> str:
        """The block's name in the protocol."""
        return self.recorded.plan.block_name

    @property
    def world(self) -> str:
        """The world's id."""
        return self.recorded.plan.world

    @property
    def seed(self) -> int:
        """The seed of the layout."""
        return self.recorded.plan.seed

    @property
    def mission(self) -> str:
        """What was to be done."""
        return self.recorded.start.mission

    @property
    def outcome(self) -> str:
        """How it ended: goal, timeout, failure, abandoned, or cut_off where the log broke off first."""
        return self.recorded.outcome_word

    @property
    def reward(self) -> float:
        """Sum of the rewards."""
        return self.recorded.return_

    @property
    def steps(self) -> int:
        """How many steps were done."""
        return len(self.recorded.actions)

    @property
    def playing_s(self) -> float:
        """Seconds from the reset to the last step, pauses left out."""
        return playing_s(self.recorded)

    @property
    def path(self) -> NDArray[np.float64]:
        """Where the agent was, (steps + 1, 4): x, y, z in cells or metres, heading in rad; NaN where nobody knows.

        The ground plane is x and z, y points up; a heading of 0 is along +x and grows counter-clockwise from above.
        """
        return self.recorded.poses

    @property
    def times_s(self) -> NDArray[np.float64]:
        """When the reset and each step happened, (steps + 1,)."""
        return np.asarray(self.recorded.t_ns / 1e9)

    @property
    def actions(self) -> tuple[str, ...]:
        """What was done at each step, by name."""
        names = self.recorded.start.action_names
        return tuple(names[action] for action in self.recorded.actions)

    @property
    def keys(self) -> tuple[str, ...]:
        """The key that caused each step; "" for a tick's no-op."""
        return tuple(self.recorded.step_keys)

    @property
    def rewards(self) -> NDArray[np.float64]:
        """The reward of each step."""
        return self.recorded.rewards

    @property
    def reaction_ms(self) -> NDArray[np.float64]:
        """Key press minus the flip of the picture it answers, for each step; NaN where there is none."""
        return self.recorded.rt_ms

    @property
    def map(self) -> Map | None:
        """Walls and things of the floor; None where the world cannot tell."""
        return self.recorded.start.map

    def frames(self) -> list[NDArray[np.uint8]]:
        """What was shown, (steps + 1) pictures uint8[height, width, 3]: drawn again by the world, and proved equal.

        Raises:
            LogError: if the world now shows something else, and the log holds no pictures.
            WorldError: if the world cannot be run here, and the log holds no pictures.
        """
        from minihuman.replay.views import pictures

        return pictures(self.recorded)

    def play_back(self) -> Iterator[Moment]:
        """Play the episode again in its world, step by step; every observation is proved to be the one that was seen.

        Raises:
            LogError: at the first step at which the world now answers otherwise.
            WorldError: if the world cannot be made here.
        """
        from minihuman.worlds.adapt.world import World

        one = self.recorded
        with closing(World(one.plan.world, one.plan.options)) as world:
            found = world.reset(one.plan.seed).observation_hash
            for place, action in enumerate(one.actions):
                self._prove(found, place)
                seen = copy.deepcopy(world.observation)  # as a world may use its arrays again
                change = world.step(int(action))
                found = change.observation_hash
                ended = bool(one.terminated[place]), bool(one.truncated[place])
                yield Moment(place + 1, seen, one.start.action_names[action], change.reward, *ended)
            self._prove(found, self.steps)

    def figure(self) -> "Figure":
        """The path over the floor plan."""
        from minihuman.figures.paths import paths_figure

        return paths_figure([(self.world, [self.recorded])], across=1)

    def _prove(self, found: int, step: int) -> None:
        if found != int(self.recorded.observation_hashes[step]):
            where = f"{self.participant}: {self.recorded.name} step {step}"
            raise LogError(f"{where}: {self.world} now shows something else than was seen")

    def __repr__(self) -> str:
        why = f", left out: {self.left_out}" if self.left_out else ""
        return f"<{self.recorded.name} of {self.participant}: {self.block}, {self.outcome}, {self.steps} steps{why}>"
