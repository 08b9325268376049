"""The port of simulated teachers: players who watch an agent, take over, compare and rate."""

import abc
from dataclasses import dataclass
from typing import Literal

from minihuman.players.port import Player, Press
from minihuman.study.activities.pair_events import Stretch, Verdict
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World


@dataclass(frozen=True, slots=True)
class Watched:
    """What a teacher sees of a block that an agent plays, once for each new state."""

    who: Literal["agent", "person"]  # steers
    step: int
    t_ms: float  # session time at which it is looked at
    action: str  # what the policy would do now; "" where it does not say
    hand_back: str  # the key that gives control back; "" where nobody can take it
    good: str  # the keys of a rating; "" where none is asked for
    bad: str
    reached: bool = False  # the episode is over and was a success: this is its last picture


class Teacher(Player):
    """A player that may let an agent play."""

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """An episode has started."""

    @abc.abstractmethod
    def watch(self, world: World, watched: Watched) -> Press | None:
        """The next key, some time after this state's picture came; None lets it be until the next state.

        A press whose time comes after the next state's picture goes down even so, as a person's would.
        """

    def correct(self, episode: Stretch) -> int | None:
        """The step of an episode from which to show what should have been done; None: it was well done."""
        return None

    def prefer(self, left: Stretch, right: Stretch) -> tuple[Verdict, float]:
        """What to say of two stretches that were seen to their ends, and after how many milliseconds."""
        return "cannot_tell", 1_000.0
