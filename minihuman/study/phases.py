"""The phases of a session and what leads from one to the next: one table; the docs draw their diagram from it."""

from enum import StrEnum


class Phase(StrEnum):
    """Where a session is."""

    START = "start"
    CONSENT = "consent"
    KEYBOARD_CHECK = "keyboard_check"
    INSTRUCTIONS = "instructions"
    READY = "ready"
    PLAYING = "playing"
    PAUSED = "paused"
    FEEDBACK = "feedback"
    REST = "rest"
    CLOSING = "closing"
    QUIT_QUESTION = "quit_question"
    ABORT_QUESTION = "abort_question"
    OVER = "over"


class Cause(StrEnum):
    """Why a session moves on. A phase with nothing to show is ``done`` as soon as it is entered."""

    BEGAN = "began"
    DONE = "done"
    EPISODE_ENDED = "episode_ended"
    NEXT_EPISODE = "next_episode"
    BLOCK_ENDED = "block_ended"
    STUDY_ENDED = "study_ended"
    PAUSE = "pause"
    RESUME = "resume"
    ASK_QUIT = "ask_quit"
    ASK_ABORT = "ask_abort"
    STAY = "stay"
    END = "end"


_MAY_ASK = (
    Phase.CONSENT,
    Phase.KEYBOARD_CHECK,
    Phase.INSTRUCTIONS,
    Phase.READY,
    Phase.PLAYING,
    Phase.PAUSED,
    Phase.FEEDBACK,
    Phase.REST,
    Phase.CLOSING,
)

BACK = None  # to the phase in which the question was asked

TRANSITIONS: dict[tuple[Phase, Cause], Phase | None] = {
    (Phase.START, Cause.BEGAN): Phase.CONSENT,
    (Phase.CONSENT, Cause.DONE): Phase.KEYBOARD_CHECK,
    (Phase.KEYBOARD_CHECK, Cause.DONE): Phase.INSTRUCTIONS,
    (Phase.INSTRUCTIONS, Cause.DONE): Phase.READY,
    (Phase.READY, Cause.DONE): Phase.PLAYING,
    (Phase.PLAYING, Cause.EPISODE_ENDED): Phase.FEEDBACK,
    (Phase.PLAYING, Cause.PAUSE): Phase.PAUSED,
    (Phase.PAUSED, Cause.RESUME): Phase.PLAYING,
    (Phase.FEEDBACK, Cause.NEXT_EPISODE): Phase.READY,
    (Phase.FEEDBACK, Cause.BLOCK_ENDED): Phase.REST,
    (Phase.FEEDBACK, Cause.STUDY_ENDED): Phase.CLOSING,
    (Phase.REST, Cause.DONE): Phase.INSTRUCTIONS,
    (Phase.CLOSING, Cause.DONE): Phase.OVER,
    **{(phase, Cause.ASK_QUIT): Phase.QUIT_QUESTION for phase in _MAY_ASK},
    **{(phase, Cause.ASK_ABORT): Phase.ABORT_QUESTION for phase in (*_MAY_ASK, Phase.QUIT_QUESTION)},
    (Phase.QUIT_QUESTION, Cause.STAY): BACK,
    (Phase.ABORT_QUESTION, Cause.STAY): BACK,
    **{(phase, Cause.END): Phase.OVER for phase in Phase if phase is not Phase.OVER},
}


def mermaid() -> str:
    """The table as a Mermaid state diagram; what any phase may do is said once, in a note."""
    lines = ["stateDiagram-v2", f"    [*] --> {Phase.START}"]
    for (phase, cause), target in TRANSITIONS.items():
        if cause not in (Cause.ASK_QUIT, Cause.ASK_ABORT, Cause.END, Cause.STAY):
            lines.append(f"    {phase} --> {target}: {cause}")
    for cause in (Cause.ASK_QUIT, Cause.ASK_ABORT):
        asking = [phase for (phase, why) in TRANSITIONS if why is cause]
        question = TRANSITIONS[asking[0], cause]
        lines.append(f"    note left of {question}: {cause} from {', '.join(asking)}; {Cause.STAY} goes back")
    ending = [phase for (phase, cause) in TRANSITIONS if cause is Cause.END]
    lines += [f"    note right of {Phase.OVER}: {Cause.END} from {', '.join(ending)}", f"    {Phase.OVER} --> [*]"]
    return "\n".join(lines)
