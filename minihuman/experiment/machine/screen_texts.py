"""Texts of the screens that show no world, built from the interface texts, the plan and the session's state."""

import zlib
from typing import TYPE_CHECKING

from minihuman.experiment.machine.events import EndReason
from minihuman.experiment.machine.screens import TextScreen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.words import InterfaceWords
from minihuman.moved import forward_names

ABORT_REASONS = (
    "the participant asked to stop",
    "the participant is unwell",
    "technical trouble",
    "wrong participant or protocol",
    "another reason",
)


_FAILURES = ("disk_full", "world_error", "internal_error")


def build_notice_screen(words: InterfaceWords, title: str, body: str, prompt: str = "") -> TextScreen:
    """Build a screen of a short text; ``prompt`` names the key to go on, and if it is "", the screen shows a wait."""
    return TextScreen(title, body, prompt, locale=words.locale, waits=not prompt)


def build_pause_screen(words: InterfaceWords) -> TextScreen:
    """Build the screen of a pause."""
    return TextScreen(words["paused.title"], words["paused.body"], words["go_on"], locale=words.locale)


def build_focus_lost_screen(words: InterfaceWords) -> TextScreen:
    """Build the screen shown while another window has the keyboard."""
    return TextScreen(words["unfocused.title"], words["unfocused.body"], "", locale=words.locale)


def build_wait_screen(words: InterfaceWords) -> TextScreen:
    """Build the screen shown during a short wait."""
    return TextScreen("", words["getting_ready"], "", locale=words.locale)


def build_quit_screen(words: InterfaceWords, *, declining: bool = False) -> TextScreen:
    """Build the question whether to end the session; ``declining`` if ending it refuses consent."""
    if declining:
        return TextScreen(words["consent.decline"], "", words["quit.prompt"], locale=words.locale)
    return TextScreen(words["quit.title"], words["quit.body"], words["quit.prompt"], locale=words.locale)


def build_abort_screen(words: InterfaceWords) -> TextScreen:
    """Build the screen that asks the experimenter why the session is to end."""
    reasons = (words[f"abort.reason_{number}"] for number in range(1, len(ABORT_REASONS) + 1))
    body = "\n".join(f"{number}  {reason}" for number, reason in enumerate(reasons, start=1))
    return TextScreen(words["abort.title"], body, words["abort.prompt"], locale=words.locale)


def find_abort_reason(key: str) -> str | None:
    """Return the abort reason that the key of a digit selects, on the digit row or the keypad; None for other keys."""
    reasons = {str(number): reason for number, reason in enumerate(ABORT_REASONS, start=1)}
    return reasons.get(key.removeprefix("kp_"))


def find_stop_code(reason: str, detail: str) -> str:
    """Return a short code, such as "W-3F2A", by which a participant can tell the experimenter which error occurred.

    The program prints the code together with the error's text.

    Args:
        reason: the reason why the session ended.
        detail: the details of the end in the log.
    """
    initial = reason[:1].upper()
    upper_16_bits = zlib.crc32(detail.encode()) >> 16
    return f"{initial}-{upper_16_bits:04X}"


def build_end_screen(words: InterfaceWords, reason: EndReason, detail: str) -> TextScreen:
    """Build the last screen of a session from the reason and details of its end.

    After a failure it states what happened and what is saved, and shows the stop code.
    """
    title = words["over.title"]
    text = ""
    if reason in _FAILURES:
        title = words[f"over.{reason}"]
        recording_note = words["over.kept_in_part" if reason == "disk_full" else "over.kept"]
        text = f"{recording_note}\n\n{find_stop_code(reason, detail)}"
    elif reason == "screened_out":
        text = words["over.screened_out"]
    elif reason == "complete":
        title = words["over.complete"]
    return TextScreen(title, text, "", locale=words.locale)


def build_overlay_screen(
    words: InterfaceWords, phase: Phase, reason: EndReason, detail: str, *, declining: bool = False
) -> TextScreen | None:
    """Build the screen of a phase in which no part is shown: a pause, a question about the session, or its end.

    Return None in any other phase. The arguments are those of the functions that build the screens.
    """
    match phase:
        case Phase.PAUSED:
            return build_pause_screen(words)
        case Phase.UNFOCUSED:
            return build_focus_lost_screen(words)
        case Phase.QUIT_QUESTION:
            return build_quit_screen(words, declining=declining)
        case Phase.ABORT_QUESTION:
            return build_abort_screen(words)
        case Phase.OVER:
            return build_end_screen(words, reason, detail)
    return None


def capitalise(text: str) -> str:
    """Return a text with its first letter capitalised."""
    return text[:1].upper() + text[1:]


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
