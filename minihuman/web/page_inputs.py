"""Converts a page's messages to a session's inputs. No I/O: times come with the messages."""

import re
from collections.abc import Callable, Iterable, Mapping

from minihuman.experiment.machine import inputs
from minihuman.experiment.machine.events import Event, KeyPressed, Noted
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.web import messages

_POINTERS: Mapping[str, type[inputs.PointerPressed | inputs.PointerMoved | inputs.PointerReleased]] = {
    "pressed": inputs.PointerPressed,
    "moved": inputs.PointerMoved,
    "released": inputs.PointerReleased,
}
_MAX_REMEMBERED = 300  # presses; a page repeats only unacknowledged ones, which are seconds old
MakeInput = Callable[[int], inputs.Input | None]  # makes an input for the time, in ns, of the page's echo


class PageInputs:
    """Converts a page's messages to inputs, and remembers which key presses the log has.

    Args:
        past_events: the events of the session so far.
    """

    def __init__(self, past_events: Iterable[Event]) -> None:
        self._keys_down: dict[tuple[int, str], None] = {}  # the latest presses, the oldest first
        self._forgotten_ns = -1  # the time of the latest press that was forgotten
        for event in past_events:
            if isinstance(event, KeyPressed) and event.down:
                self._remember_press(event.t_ns - event.waited_ns, event.key)
        self._last_question = 0
        self._questions: dict[int, MakeInput] = {}  # by number, until the page echoes the question

    @property
    def open_questions(self) -> tuple[int, ...]:
        """Return the numbers of the questions that the page has not answered."""
        return tuple(self._questions)

    def ask(self, make_input: MakeInput) -> int:
        """Register a function that makes an input once the page echoes a question; return the question's number."""
        self._last_question += 1
        self._questions[self._last_question] = make_input
        return self._last_question

    def convert(self, message: messages.PageMessage, at_ns: int, *, is_present: bool) -> inputs.Input | None:
        """Convert a message to an input; return None if it is not one.

        Args:
            message: the message.
            at_ns: the message's time in nanoseconds.
            is_present: whether the session still shows the screen that a `DisplayedMessage` reports.
        """
        match message:
            case messages.KeyMessage():
                return self._convert_key(message, at_ns)
            case messages.DisplayedMessage() if is_present:
                return inputs.ScreenShown(at_ns, *get_display_times(message, at_ns))
            case messages.SoundMessage():
                onset_ns = min(message.onset, at_ns)
                return inputs.SoundStarted(at_ns, message.cue, message.scheduled, onset_ns, message.uncertainty)
            case messages.TickMessage():
                return inputs.Tick(at_ns)
            case messages.TextMessage():
                return inputs.TextInput(at_ns, "".join(letter for letter in message.text if letter.isprintable()))
            case messages.FieldMessage():
                text = clean_field_text(message.text)
                return inputs.TextEdited(
                    at_ns, text, message.changes, message.keys, min(message.began, at_ns), message.name
                )
            case messages.PointerMessage():
                stamp_ns = min(message.stamp, at_ns)
                make_input = _POINTERS[message.what]
                return make_input(stamp_ns, message.x, message.y, message.target, message.along, message.cause)
            case messages.AxisMessage() | messages.MouseMotionMessage():
                return _convert_axis(message, at_ns)
            case messages.FocusMessage():
                return inputs.FocusChanged(at_ns, message.focused)
            case messages.CommandEcho() if message.number in self._questions:
                return self._questions.pop(message.number)(at_ns)
        return None

    def _convert_key(self, message: messages.KeyMessage, at_ns: int) -> inputs.Input:
        """Convert a key message; a cause that is not one of a press or of a release is replaced by "finger".

        The study's own page never sends such a cause.
        """
        stamp_ns = min(message.stamp, at_ns)
        if not message.down:
            release_cause: inputs.KeyReleaseCause = "finger"
            if message.cause == "focus_loss":
                release_cause = "focus_loss"
            return inputs.KeyUp(stamp_ns, message.key, message.symbol, release_cause)
        self._remember_press(stamp_ns, message.key)
        cause = "finger" if message.cause == "focus_loss" else message.cause
        return inputs.KeyDown(stamp_ns, message.key, message.symbol, message.repeat, cause)

    def _remember_press(self, stamp_ns: int, key: str) -> None:
        """Remember a key press, and forget the oldest one beyond the limit."""
        self._keys_down[stamp_ns, key] = None
        if len(self._keys_down) > _MAX_REMEMBERED:
            oldest = next(iter(self._keys_down))
            del self._keys_down[oldest]
            self._forgotten_ns = max(self._forgotten_ns, oldest[0])

    def note_missed(self, message: messages.PageMessage, at_ns: int, now_ns: int) -> list[Event]:
        """Return a note about a key press that the log lacks, as it was made in another tab.

        Args:
            message: a message that is not later than the session's time.
            at_ns: the message's time in nanoseconds.
            now_ns: the session's time, which the note gets.

        Returns:
            The note; empty for a press that the log has, and for messages of other kinds.
        """
        if not isinstance(message, messages.KeyMessage) or not message.down:
            return []
        stamp_ns = min(message.stamp, at_ns)
        if stamp_ns <= self._forgotten_ns or (stamp_ns, message.key) in self._keys_down:
            return []
        return [Noted(now_ns, BROWSER_NOTE, f"not taken: {message.key} at {message.stamp} ns")]


def _convert_axis(message: messages.AxisMessage | messages.MouseMotionMessage, at_ns: int) -> inputs.AxisChanged:
    moved = message.value if isinstance(message, messages.AxisMessage) else float(message.pixels)
    return inputs.AxisChanged(min(message.stamp, at_ns), message.axis, moved)


_CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")


def clean_field_text(text: str) -> str:
    """Return a text without the control characters that a page's field removes, too."""
    return _CONTROL_CHARACTERS.sub("", text)


def get_display_times(message: messages.DisplayedMessage, at_ns: int) -> tuple[int, int]:
    """Return the times at which a picture was submitted and displayed, in order, neither later than the message."""
    flip_ns = min(message.flip, at_ns)
    return min(message.submit, flip_ns), flip_ns
