"""Questions of kind ``text`` and ``long_text``: type a text of one line or of several."""

from collections.abc import Callable
from typing import Any

from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    QuestionItemSpec,
    QuestionKind,
    horizontal_step,
)
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import TextField


class TextDraft(AnswerDraft):
    """A draft answer of one line of text."""

    long = False

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._text = ""
        self._caret = 0

    def key(self, press: KeyDown) -> bool:
        """Move the caret or delete; the characters of other keys arrive through `type_text`."""
        before = self._text[: self._caret]
        after = self._text[self._caret :]
        match press.key:
            case "backspace":
                self._put(before[:-1], after)
            case "delete":
                self._put(before, after[1:])
            case "left" | "right":
                by = horizontal_step(press.key, rtl=self.rtl)
                self._caret = min(len(self._text), max(0, self._caret + by))
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
        """Insert the characters that the text accepts at the caret, as many as there is room for."""
        accepted = [c for c in text if self.accepts(c)]
        room = max(0, self.question.longest - len(self._text))
        self._put(self._text[: self._caret] + "".join(accepted[:room]), self._text[self._caret :])

    def accepts(self, character: str) -> bool:
        """Tell whether the text accepts a character."""
        return character.isprintable() or (self.long and character == "\n")

    def _put(self, before: str, after: str) -> None:
        self._text = before + after
        self._caret = len(before)

    @property
    def value(self) -> AnswerValue:
        """The text without surrounding blanks; None if it is empty."""
        return self.display_text or None

    @property
    def display_text(self) -> str:
        """The text as typed."""
        return self._text.strip()

    def widget(self) -> TextField:
        """Build the text field."""
        return TextField(self._text, self._caret, self.long, self.question.unit)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> str | None:
        """Type a number that could be an age, as an answer to any question."""
        if self._text:
            return None
        return str(18 + choose(50))


class LongTextDraft(TextDraft):
    """A draft answer of several lines of text."""

    long = True


TEXT = QuestionKind("text", TextDraft, "text", takes_text=True)
LONG_TEXT = QuestionKind("long_text", LongTextDraft, "text", takes_text=True)
