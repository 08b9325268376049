"""The phases of a session and of the activities that come with the package, and the session's own table of moves."""

from enum import StrEnum
from typing import TYPE_CHECKING

from minihuman.study.moves import Move, Moves

if TYPE_CHECKING:
    from minihuman.study.session import Session


class Phase(StrEnum):
    """Where a session is. While a part runs, the session's phase is the part's own."""

    START = "start"
    PART = "part"  # never seen from outside: the part's phase is
    CONSENT = "consent"
    PAGE = "page"
    KEYBOARD_CHECK = "keyboard_check"
    QUESTIONS = "questions"
    INSTRUCTIONS = "instructions"
    LEARNING = "learning"
    PREPARING = "preparing"
    READY = "ready"
    INTERVAL = "interval"
    FIXATION = "fixation"
    PLAYING = "playing"
    HOLD = "hold"
    FEEDBACK = "feedback"
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


class Cause(StrEnum):
    """Why a session, or a part of it, moves on."""

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
    END = "end"


def _it_is_being_played(session: "Session") -> bool:
    return session.part.playing


def _time_makes_its_steps(session: "Session") -> bool:
    return session.part.playing and session.part.real_time


def _another_part_follows(session: "Session") -> bool:
    return session.next_part is not None


_ASKING = (Phase.PART, Phase.PAUSED, Phase.UNFOCUSED)

MOVES: "Moves[Session]" = Moves(
    [
        Move(Phase.START, Cause.BEGAN, Phase.PART),
        Move(Phase.PART, Cause.DONE, Phase.PART, _another_part_follows),
        Move(Phase.PART, Cause.DONE, Phase.OVER),
        Move(Phase.PART, Cause.PAUSE, Phase.PAUSED, _it_is_being_played),
        Move(Phase.PAUSED, Cause.RESUME, Phase.PART),
        Move(Phase.PART, Cause.FOCUS_LOST, Phase.PAUSED, _time_makes_its_steps),
        Move(Phase.PART, Cause.FOCUS_LOST, Phase.UNFOCUSED),
        Move(Phase.UNFOCUSED, Cause.FOCUS_FOUND, Phase.PART),
        *(Move(phase, Cause.ASK_QUIT, Phase.QUIT_QUESTION) for phase in _ASKING),
        *(Move(phase, Cause.ASK_ABORT, Phase.ABORT_QUESTION) for phase in (*_ASKING, Phase.QUIT_QUESTION)),
        Move(Phase.QUIT_QUESTION, Cause.STAY, None),
        Move(Phase.ABORT_QUESTION, Cause.STAY, None),
        *(
            Move(phase, Cause.END, Phase.OVER)
            for phase in (Phase.START, *_ASKING, Phase.QUIT_QUESTION, Phase.ABORT_QUESTION)
        ),
    ]
)
NOTED = frozenset({Cause.ASK_QUIT, Cause.ASK_ABORT, Cause.STAY, Cause.END})


def mermaid() -> str:
    """The session's table as a Mermaid state diagram."""
    return MOVES.mermaid(Phase.START, Phase.OVER, noted=NOTED)
