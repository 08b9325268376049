"""The simulated participant interface: look at the world, return the next key and its delay. Includes loading by name.

Simulated teachers also watch an agent, take over, correct, rate and compare. Participants register in the
entry-point group ``minihuman.players``.
"""

import abc
from dataclasses import dataclass
from typing import Literal

import numpy as np

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.events import PairAnswer
from minihuman.errors import SimulationError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.plugins import make_plugin
from minihuman.worlds.adapters.world import World


@dataclass(frozen=True, slots=True)
class KeyPress:
    """A key, the delay from the picture or the last key to its press, and how long it is held."""

    key: str
    delay_ms: float
    hold_ms: float = 90.0


@dataclass(frozen=True, slots=True)
class NoPress:
    """A response is withheld: no key until the world goes on by its clock."""


class SimulatedParticipant(abc.ABC):
    """Presses the keys in place of a person. It looks at the world but never steps it."""

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode; ``pool`` holds every key that may have an action."""

    @abc.abstractmethod
    def press(self, world: World) -> KeyPress | NoPress | None:
        """Choose the next key from the present state of the world; None: no answer, which ends the session.

        The session then ends as ``player_failed``, as it does after an exception or a minute without an answer. With
        `NoPress` the participant waits for the deadline of a response.
        """


@dataclass(frozen=True, slots=True)
class WatchedStep:
    """A teacher's view of a block that an agent plays, once per state."""

    who: Literal["agent", "person"]  # in control
    step: int
    t_ms: float  # session time
    action: str  # the policy's choice; "" if unknown
    hand_back: str  # the key that returns control; "" where takeovers are not possible
    good: str  # the keys of a rating; "" where steps are not rated
    bad: str
    reached: bool = False  # the episode has ended in success; this is its last picture


class SimulatedTeacher(SimulatedParticipant):
    """A participant that can also watch, rate, correct and compare an agent."""

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode."""

    @abc.abstractmethod
    def watch(self, world: World, watched: WatchedStep) -> KeyPress | None:
        """Choose the next key, or None to wait for the next state.

        A press that is due after the next state's picture happens all the same, as a person's would.
        """

    def correct(self, episode: EpisodeClip) -> int | None:
        """Choose the step of an episode from which to correct it; None if there is nothing to correct."""
        return None

    def prefer(self, left: EpisodeClip, right: EpisodeClip) -> tuple[PairAnswer, float]:
        """Compare two clips seen to their ends; return the answer and its delay in milliseconds."""
        return "cannot_tell", 1_000.0


PARTICIPANT_GROUP = "minihuman.players"


def make_participant(name: str, rng: np.random.Generator) -> SimulatedParticipant:
    """Make a simulated participant from its name and settings ("human-like:lapse=0.1").

    Raises:
        SimulationError: if no participant has that name, or a setting is wrong.
    """
    return make_plugin(
        PARTICIPANT_GROUP,
        name,
        SimulatedParticipant,  # type: ignore[type-abstract]
        SimulationError,
        rng,
        noun="player",
    )
