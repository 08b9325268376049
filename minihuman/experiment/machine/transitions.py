"""Transition tables of phases: which cause leads from which phase to which, and under what condition.

This module defines the phases of the session and of the built-in activities, and the session's own table.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, Protocol, TypeVar

Subject = TypeVar("Subject")


@dataclass(frozen=True, slots=True)
class PhaseTransition(Generic[Subject]):
    """A row of a transition table: the phase ``end`` follows ``start`` for a ``cause``.

    If ``end`` is None, the session returns to the phase before the question.
    """

    start: StrEnum
    cause: StrEnum
    end: StrEnum | None
    when: Callable[[Subject], bool] | None = None  # the row's condition, whose name labels it in diagrams; None: always


class TransitionTable(Generic[Subject]):
    """A table of transitions, in which the first row whose condition holds applies."""

    def __init__(self, rows: Sequence[PhaseTransition[Subject]]) -> None:
        self.rows = tuple(rows)

    def find(self, start: StrEnum, cause: StrEnum, subject: Subject) -> PhaseTransition[Subject] | None:
        """Return the row that applies in phase ``start`` for a cause; None if there is none, so that the phase stays.

        The rows' conditions are evaluated on ``subject``.
        """
        for row in self.rows:
            if row.start is not start or row.cause is not cause:
                continue
            if row.when is None or row.when(subject):
                return row
        return None


class Phase(StrEnum):
    """A phase of a session. While a part runs, the session's phase is the part's own."""

    START = "start"
    PART = "part"  # never seen from outside: the part's phase is
    CONSENT = "consent"
    PAGE = "page"
    KEYBOARD_CHECK = "keyboard_check"
    QUESTIONS = "questions"
    INSTRUCTIONS = "instructions"
    LEARNING = "learning"
    PREPARING = "preparing"
    LOBBY = "lobby"
    READY = "ready"
    WAITING = "waiting"
    INTERVAL = "interval"
    FIXATION = "fixation"
    PLAYING = "playing"
    HOLD = "hold"
    FEEDBACK = "feedback"
    DEBRIEFING = "debriefing"
    REST = "rest"
    COMPARING = "comparing"
    LOOKING = "looking"
    SHOWING = "showing"
    CLOSING = "closing"
    PAUSED = "paused"
    UNFOCUSED = "unfocused"
    QUIT_QUESTION = "quit_question"
    ABORT_QUESTION = "abort_question"
    OVER = "over"


class TransitionCause(StrEnum):
    """The cause of a phase transition in a session or in a part of it."""

    BEGAN = "began"
    DONE = "done"
    EPISODE_ENDED = "episode_ended"
    PAUSE = "pause"
    RESUME = "resume"
    FOCUS_LOST = "focus_lost"
    FOCUS_FOUND = "focus_found"
    ASK_QUIT = "ask_quit"
    ASK_ABORT = "ask_abort"
    STAY = "stay"
    GO_BACK = "go_back"
    END = "end"


class RunningPart(Protocol):
    """The properties of the running part that the transitions' conditions read."""

    playing: bool
    real_time: bool


class SessionState(Protocol):
    """The properties of a session that the transitions' conditions read."""

    @property
    def part(self) -> RunningPart:
        """Return the running part."""

    @property
    def next_part(self) -> int | None:
        """Return the index of the part that follows; None if there is none."""


def _it_is_being_played(session: SessionState) -> bool:
    return session.part.playing


def _time_makes_its_steps(session: SessionState) -> bool:
    return session.part.playing and session.part.real_time


def _another_part_follows(session: SessionState) -> bool:
    return session.next_part is not None


_INTERRUPTIBLE_PHASES = (Phase.PART, Phase.PAUSED, Phase.UNFOCUSED)

SESSION_TRANSITIONS: TransitionTable[SessionState] = TransitionTable(
    [
        PhaseTransition(Phase.START, TransitionCause.BEGAN, Phase.PART),
        PhaseTransition(Phase.PART, TransitionCause.DONE, Phase.PART, _another_part_follows),
        PhaseTransition(Phase.PART, TransitionCause.DONE, Phase.OVER),
        PhaseTransition(Phase.PART, TransitionCause.PAUSE, Phase.PAUSED, _it_is_being_played),
        PhaseTransition(Phase.PAUSED, TransitionCause.RESUME, Phase.PART),
        PhaseTransition(Phase.PART, TransitionCause.FOCUS_LOST, Phase.PAUSED, _time_makes_its_steps),
        PhaseTransition(Phase.PART, TransitionCause.FOCUS_LOST, Phase.UNFOCUSED),
        PhaseTransition(Phase.UNFOCUSED, TransitionCause.FOCUS_FOUND, Phase.PART),
        *(PhaseTransition(phase, TransitionCause.ASK_QUIT, Phase.QUIT_QUESTION) for phase in _INTERRUPTIBLE_PHASES),
        *(
            PhaseTransition(phase, TransitionCause.ASK_ABORT, Phase.ABORT_QUESTION)
            for phase in (*_INTERRUPTIBLE_PHASES, Phase.QUIT_QUESTION)
        ),
        PhaseTransition(Phase.QUIT_QUESTION, TransitionCause.STAY, None),
        PhaseTransition(Phase.ABORT_QUESTION, TransitionCause.STAY, None),
        *(
            PhaseTransition(phase, TransitionCause.END, Phase.OVER)
            for phase in (Phase.START, *_INTERRUPTIBLE_PHASES, Phase.QUIT_QUESTION, Phase.ABORT_QUESTION)
        ),
    ]
)
