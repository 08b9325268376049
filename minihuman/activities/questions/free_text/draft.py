"""Questions of kind ``text`` and ``long_text``: type a text of one line or of several."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    QuestionItemSpec,
    QuestionKind,
    horizontal_step,
    needs_no_server,
)
from minihuman.experiment.machine.inputs import MAX_FIELD_CHARACTERS, KeyDown
from minihuman.experiment.machine.screens import TextField

ADULT_AGE = 18  # the least number that a simulated participant types, as most questions ask for an age
N_SIMULATED_AGES = 50  # a simulated participant types one of so many numbers, from `ADULT_AGE` on


class TextDraft(AnswerDraft):
    """A draft answer of one line of text."""

    long = False

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._text = ""
        self._caret = 0

    def key(self, press: KeyDown) -> bool:
        """Handle a key that moves the caret, deletes or begins a line; return False for any other key.

        Typed characters arrive through `type_text`. A window with a native field edits the text itself and passes none
        of these keys on.
        """
        before = self._text[: self._caret]
        after = self._text[self._caret :]
        match press.key:
            case "backspace":
                self._put(before[:-1], after)
            case "delete":
                self._put(before, after[1:])
            case "left" | "right":
                step = horizontal_step(press.key, rtl=self.rtl)
                self._caret = min(len(self._text), max(0, self._caret + step))
            case "home":
                self._caret = 0
            case "end":
                self._caret = len(self._text)
            case "enter" | "kp_enter" if self.long:
                self.type_text("\n")
            case _:
                return False
        return True

    def type_text(self, text: str) -> None:
        """Insert the accepted characters of a typed text at the caret, as many as there is room for."""
        accepted = [character for character in text if self.accepts(character)]
        n_free = max(0, self.longest - len(self._text))
        self._put(self._text[: self._caret] + "".join(accepted[:n_free]), self._text[self._caret :])

    def put_text(self, text: str) -> bool:
        """Replace the whole text and return True; return False if the session edits the text by keys."""
        if not self.has_native_field:
            return False
        self._put(text, "")
        return True

    @property
    def longest(self) -> int:
        """Return the largest number of characters that the text may have."""
        if self.has_native_field:
            return min(self.question.longest, MAX_FIELD_CHARACTERS)
        return self.question.longest

    def accepts(self, character: str) -> bool:
        """Return whether the text may contain a character; only a long text may contain line breaks."""
        return character.isprintable() or (self.long and character == "\n")

    def _put(self, before: str, after: str) -> None:
        """Set the text to two parts, with the caret between them."""
        self._text = before + after
        self._caret = len(before)

    @property
    def value(self) -> AnswerValue:
        """Return the text; None if it is empty or blank."""
        if not self._text.strip():
            return None
        return self.display_text

    @property
    def display_text(self) -> str:
        """Return the text, without surrounding blanks unless it comes from a native field."""
        if self.has_native_field:
            return self._text
        return self._text.strip()

    @property
    def error(self) -> tuple[str, dict[str, Any]] | None:
        """Return the note that the answer is missing or too long, as a text's key and its fields; None if valid."""
        if self.has_native_field and len(self._text) > self.longest:
            return "note.too_long", {"longest": self.longest}
        return super().error

    def widget(self) -> TextField:
        """Build the text field."""
        field = TextField(self._text, self._caret, self.long, self.question.unit)
        if not self.has_native_field:
            return field
        note = self.limit_note.replace("{longest}", str(self.longest))
        return replace(field, native=True, name=self.question.name, longest=self.longest, limit_note=note)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> str | None:
        """Return a number that could be an adult's age, as text to type for any question; None once a text is there."""
        if self._text:
            return None
        return str(ADULT_AGE + choose(N_SIMULATED_AGES))


class LongTextDraft(TextDraft):
    """A draft answer of several lines of text."""

    long = True


TEXT = QuestionKind(
    "text",
    TextDraft,
    "text",
    item_fields=("longest",),
    takes_text=True,
    find_server_needs=needs_no_server,
    is_judged_by_page=True,
)
LONG_TEXT = QuestionKind(
    "long_text",
    LongTextDraft,
    "text",
    item_fields=("longest",),
    takes_text=True,
    find_server_needs=needs_no_server,
    is_judged_by_page=True,
)
