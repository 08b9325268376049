"""Questions of kind ``choice`` and ``choices``: select one or several options from a vertical list."""

from collections.abc import Callable
from typing import Any

from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    Click,
    ItemErrors,
    QuestionItemSpec,
    QuestionKind,
    needs_no_server,
    parse_digit,
    parse_option,
)
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import OptionList


class ChoiceDraft(AnswerDraft):
    """A draft answer that selects one option."""

    many = False

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._chosen: frozenset[int] = frozenset()
        self._cursor = 0

    def key(self, press: KeyDown) -> bool:
        """Move the cursor with up and down, or select with a digit or the space bar; return False for any other key."""
        digit = parse_digit(press.key)
        if 1 <= digit <= len(self.question.options):
            self._choose(digit - 1)
        elif press.key in ("up", "down"):
            self._move_cursor(1 if press.key == "down" else -1)
            if not self.many:
                self._choose(self._cursor)
        elif press.key == "space" and not press.repeat:
            self._choose(self._cursor)
        else:
            return False
        return True

    def _move_cursor(self, step: int) -> None:
        """Move the cursor by 1 or -1, from the last option to the first and back.

        In a question with one choice and none yet, down leaves the cursor at the first option.
        """
        is_untouched = not self._chosen and not self.many
        if is_untouched and step > 0:
            return
        self._cursor = (self._cursor + step) % len(self.question.options)

    def point_at(self, target: str, along: float, *, down: bool) -> None:
        """Select the option that ``target`` names when the pointer is pressed on it; ``along`` is not used."""
        option = parse_option(target)
        if down and option is not None and option < len(self.question.options):
            self._choose(option)

    def _choose(self, option: int) -> None:
        """Select an option instead of any other; in a question with several choices, toggle it."""
        self._cursor = option
        if self.many:
            self._chosen = self._chosen ^ {option}
        else:
            self._chosen = frozenset({option})

    @property
    def value(self) -> AnswerValue:
        """Return the code of the selected option; None if there is none."""
        return next(iter(self._codes), None)

    @property
    def _codes(self) -> list[str | int]:
        return [self.question.all_codes[option] for option in sorted(self._chosen)]

    @property
    def display_text(self) -> str:
        """Return the texts of the selected options in their order, separated by semicolons; "" if none is selected."""
        return "; ".join(self.question.options[option] for option in sorted(self._chosen))

    def widget(self) -> OptionList:
        """Build the list of options."""
        return OptionList(self.question.options, tuple(sorted(self._chosen)), self._cursor, self.many)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | None:
        """Click on the right option if the participant attends and one is right, otherwise on a random option.

        Args:
            choose: returns a random index below its argument.
            attends: returns whether the participant attends to the question.

        Returns:
            The click; None if an option is selected already.
        """
        if self._chosen:
            return None
        option = None
        if self.question.right is not None and attends():
            codes = enumerate(self.question.all_codes)
            option = next((index for index, code in codes if code in self.question.right_answers), None)
        if option is None:
            option = choose(len(self.question.options))
        return Click(f"option:{option}")


class ChoicesDraft(ChoiceDraft):
    """A draft answer that selects any number of options."""

    many = True

    @property
    def value(self) -> AnswerValue:
        """Return the codes of the selected options in their order; None if a required answer has none."""
        if self._chosen or not self.question.required:
            return self._codes
        return None


def _check(question: QuestionItemSpec) -> ItemErrors:
    if len(question.options) < 2:
        yield "options", f"has {len(question.options)}; a choice is of two or more"


CHOICE = QuestionKind(
    "choice",
    ChoiceDraft,
    "code",
    _check,
    item_fields=("options", "codes"),
    example={"options": ("left", "right")},
    find_server_needs=needs_no_server,
)
CHOICES = QuestionKind(
    "choices",
    ChoicesDraft,
    "codes",
    _check,
    item_fields=("options", "codes"),
    example={"options": ("cat", "dog", "none"), "codes": ("C", "D", "N")},
    find_server_needs=needs_no_server,
)
