"""The interface by which a kind of activity simulates a person in a part of a session."""

import abc
from collections.abc import Iterator
from contextlib import contextmanager

from minihuman.errors import MinihumanError, PlayerFailedError
from minihuman.experiment.keys import BUTTON_NAMES
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.running_episode import NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screens import Screen
from minihuman.plugins import limit_answer_time, locate_error
from minihuman.simulation.participant import KeyPress, NoPress, SimulatedParticipant

READING_MS = 1_000.0
HOLD_MS = 90.0
LONGEST_NS = 3_600_000_000_000  # an hour, the longest time without a key and a new screen


class SimulatedPerson(abc.ABC):
    """A simulated participant who operates a window's keys and pointer.

    Args:
        participant: the participant who decides; a `SimulatedTeacher` can do more than press keys in a world.
    """

    wrong_in_ten = 1  # how many of ten answers to questions that have a right one are given at random

    def __init__(self, participant: SimulatedParticipant) -> None:
        self.participant = participant

    @property
    @abc.abstractmethod
    def now_ns(self) -> int:
        """Return the session's time in nanoseconds."""

    @abc.abstractmethod
    def begin_episode(self, play: RunningEpisode) -> None:
        """Show an episode to the participant, unless the participant knows it already."""

    @abc.abstractmethod
    def press_key(self, key: str, delay_ms: float = READING_MS, hold_ms: float = HOLD_MS) -> None:
        """Press a key after a delay and hold it, with both times in milliseconds."""

    @abc.abstractmethod
    def point(self, target: str, along: float) -> None:
        """Click on a target of the screen, at a position along it from 0 to 1."""

    @abc.abstractmethod
    def type_text(self, text: str) -> None:
        """Type a text."""

    @abc.abstractmethod
    def choose(self, count: int) -> int:
        """Draw a number from 0 to ``count`` - 1, which the study's seed, the participant and earlier draws fix."""

    def attends(self) -> bool:
        """Draw whether the participant attends; if so, any question with a right answer is answered correctly."""
        return self.choose(10) >= self.wrong_in_ten


class PartSimulator(abc.ABC):
    """A simulator of the parts of one kind of activity in a session.

    Args:
        person: the simulated person who does the parts.
    """

    def __init__(self, person: SimulatedPerson) -> None:
        self.person = person

    @abc.abstractmethod
    def act(self, part: Activity, screen: Screen) -> bool:
        """Schedule the inputs that the screen requires, if any are due.

        Return False if the kind leaves the screen to the inputs that are usual for parts of all kinds.
        """


@contextmanager
def name_failures() -> Iterator[None]:
    """Turn any error of a simulated player in the context into a PlayerFailedError, also if the player takes too long.

    Raises:
        PlayerFailedError: if the player raises any exception or takes too long.
    """
    try:
        with limit_answer_time():
            yield
    except MinihumanError as error:  # its text describes the problem
        raise PlayerFailedError(str(error), type(error).__name__) from error
    except Exception as error:  # of a lab's own player: its session has an end of its own
        kind = type(error).__name__
        raise PlayerFailedError(f"{kind} at {locate_error(error)}: {error}", kind) from error


def check_press(press: object) -> KeyPress:
    """Check a player's key press, and return it.

    Raises:
        PlayerFailedError: if it is not a valid key press.
    """
    if not isinstance(press, KeyPress):
        answer = f"a {type(press).__name__}, not a KeyPress"
        raise PlayerFailedError(f"it answered with {answer}, which is not a possible answer", f"answered with {answer}")
    longest_ns = max(press.delay_ms, press.hold_ms) * NS_PER_MS
    if press.key not in BUTTON_NAMES or min(press.delay_ms, press.hold_ms) < 0 or not longest_ns <= LONGEST_NS:
        raise PlayerFailedError(
            f"it answered with {press!r}, which is not a possible key press", "an impossible key press"
        )
    return press


def ask_key(participant: SimulatedParticipant, play: RunningEpisode) -> KeyPress | None:
    """Return a player's next key press; None if the player withholds a response.

    Raises:
        PlayerFailedError: if there is no answer, or a response is withheld where there is no deadline.
    """
    with name_failures():
        press = participant.press(play.world)
    if isinstance(press, NoPress):
        if not play.plan.response_deadline_ms:
            raise PlayerFailedError("it pressed no key where no deadline comes", "no key and no deadline")
        return None
    if press is None:
        raise PlayerFailedError("it gave no answer", "no answer")
    return check_press(press)
