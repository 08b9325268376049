"""Questions of kind ``choice`` and ``choices``: one or several of some options, below each other."""

from collections.abc import Callable
from typing import Any

from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    Click,
    ItemErrors,
    QuestionItemSpec,
    QuestionKind,
    parse_digit,
    parse_option,
)
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import OptionList


class ChoiceDraft(AnswerDraft):
    """One of the options."""

    many = False

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._chosen: frozenset[int] = frozenset()
        self._cursor = 0

    def key(self, press: KeyDown) -> bool:
        """Move with up and down; choose with a digit or the space bar."""
        n_options = len(self.question.options)
        if (digit := parse_digit(press.key)) and digit <= n_options:
            self._choose(digit - 1)
        elif press.key in ("up", "down"):
            by = 1 if press.key == "down" else -1
            untouched = not self._chosen and not self.many
            if untouched and by > 0:
                self._cursor = self._cursor
            else:
                self._cursor = (self._cursor + by) % n_options
            if not self.many:
                self._choose(self._cursor)
        elif press.key == "space" and not press.repeat:
            self._choose(self._cursor)
        else:
            return False
        return True

    def point_at(self, target: str, along: float, *, down: bool) -> None:
        """Choose the option that was hit."""
        number = parse_option(target)
        if down and number is not None and number < len(self.question.options):
            self._choose(number)

    def _choose(self, number: int) -> None:
        self._cursor = number
        self._chosen = self._chosen ^ {number} if self.many else frozenset({number})

    @property
    def value(self) -> AnswerValue:
        """The option's code."""
        return next(iter(self._codes), None)

    @property
    def _codes(self) -> list[str | int]:
        return [self.question.all_codes[number] for number in sorted(self._chosen)]

    @property
    def display_text(self) -> str:
        """The options' words."""
        return "; ".join(self.question.options[number] for number in sorted(self._chosen))

    def widget(self) -> OptionList:
        """Build the options."""
        return OptionList(self.question.options, tuple(sorted(self._chosen)), self._cursor, self.many)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | None:
        """Choose the right option, or any."""
        if self._chosen:
            return None
        right = None
        if self.question.right is not None and attends():
            codes = enumerate(self.question.all_codes)
            right = next((number for number, code in codes if code in self.question.right_answers), None)
        return Click(f"option:{choose(len(self.question.options)) if right is None else right}")


class ChoicesDraft(ChoiceDraft):
    """Several of the options."""

    many = True

    @property
    def value(self) -> AnswerValue:
        """The codes in the options' order."""
        if self._chosen or not self.question.required:
            return self._codes
        return None


def _check(item: QuestionItemSpec) -> ItemErrors:
    if len(item.options) < 2:
        yield "options", f"has {len(item.options)}; a choice is of two or more"


CHOICE = QuestionKind("choice", ChoiceDraft, "code", _check, example={"options": ("left", "right")})
CHOICES = QuestionKind(
    "choices", ChoicesDraft, "codes", _check, example={"options": ("cat", "dog", "none"), "codes": ("C", "D", "N")}
)
