"""The interface of simulated participants, who look at a world and return the next key with its delay.

Simulated teachers also watch an agent, take over, correct, rate and compare. Participants register in the entry-point
group ``minihuman.players`` and are made by name.
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
    """A key press: the key, the delay since the picture or the last key, and the time for which it is held."""

    key: str
    delay_ms: float
    hold_ms: float = 90.0


@dataclass(frozen=True, slots=True)
class NoPress:
    """A withheld response: no key until the world continues by its clock."""


class SimulatedParticipant(abc.ABC):
    """A participant who presses keys in place of a person. It reads the world but never steps it."""

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode; ``pool`` holds every key that may have an action."""

    @abc.abstractmethod
    def press(self, world: World) -> KeyPress | NoPress | None:
        """Return the next key press in the present state of the world; None is no answer.

        Without an answer the session ends as ``player_failed``, as it does after an exception or a minute without an
        answer. With `NoPress` the participant waits for the response deadline.
        """


@dataclass(frozen=True, slots=True)
class WatchedStep:
    """One state of a block that an agent plays, as a teacher sees it."""

    who: Literal["agent", "person"]  # in control
    step: int
    t_ms: float  # session time
    action: str  # the policy's choice; "" if unknown
    hand_back: str  # the key that returns control; "" where takeovers are not possible
    good: str  # the keys of a rating; "" where steps are not rated
    bad: str
    reached: bool = False  # the episode has ended in success; this is its last picture


class SimulatedTeacher(SimulatedParticipant):
    """A participant who can also watch, rate, correct and compare an agent."""

    @abc.abstractmethod
    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode."""

    @abc.abstractmethod
    def watch(self, world: World, watched: WatchedStep) -> KeyPress | None:
        """Return the next key press, or None to wait for the next state.

        A press that is due after the next state's picture happens nevertheless, as a person's would.
        """

    def correct(self, episode: EpisodeClip) -> int | None:
        """Return the step from which to correct an episode; None if there is nothing to correct."""
        return None

    def prefer(self, left: EpisodeClip, right: EpisodeClip) -> tuple[PairAnswer, float]:
        """Compare two clips after watching both to their ends; return the answer and its delay in milliseconds."""
        return "cannot_tell", 1_000.0


PARTICIPANT_GROUP = "minihuman.players"


def make_participant(name: str, rng: np.random.Generator) -> SimulatedParticipant:
    """Make a simulated participant from its name and settings ("human-like:lapse=0.1").

    Raises:
        SimulationError: if no participant has that name, or a setting is not valid.
    """
    return make_plugin(
        PARTICIPANT_GROUP,
        name,
        SimulatedParticipant,  # type: ignore[type-abstract]
        SimulationError,
        rng,
        noun="player",
    )
