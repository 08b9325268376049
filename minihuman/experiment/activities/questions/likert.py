"""Questions of kind ``likert``: a point on a rating scale."""

from collections.abc import Callable
from typing import Any

from minihuman.experiment.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    Click,
    ItemErrors,
    QuestionItemSpec,
    QuestionKind,
    horizontal_step,
    parse_digit,
    parse_option,
)
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import RatingScale


class LikertDraft(AnswerDraft):
    """A point in a row."""

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._n_points = len(question.options) or question.points
        self._chosen: int | None = None

    def key(self, press: KeyDown) -> bool:
        """Left and right move, a digit chooses."""
        if (digit := parse_digit(press.key)) and digit <= self._n_points:
            self._chosen = digit - 1
        elif by := horizontal_step(press.key, rtl=self.rtl):
            middle = (self._n_points - 1) // 2
            now = self._chosen
            self._chosen = middle if now is None else min(self._n_points - 1, max(0, now + by))
        else:
            return False
        return True

    def point_at(self, target: str, along: float, *, down: bool) -> None:
        """Choose the point that was hit."""
        number = parse_option(target)
        if down and number is not None and number < self._n_points:
            self._chosen = number

    @property
    def value(self) -> AnswerValue:
        """The point's code, 1 for the first unless the protocol says otherwise."""
        return None if self._chosen is None else self.question.all_codes[self._chosen]

    @property
    def display_text(self) -> str:
        """The point's words, or its number."""
        return "" if self._chosen is None else self._labels[self._chosen]

    @property
    def _labels(self) -> tuple[str, ...]:
        return self.question.options or tuple(str(number + 1) for number in range(self._n_points))

    def widget(self) -> RatingScale:
        """The points."""
        return RatingScale(self._labels, self.question.low, self.question.high, self._chosen)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | None:
        """Any point."""
        return Click(f"option:{choose(self._n_points)}") if self._chosen is None else None


def _check(item: QuestionItemSpec) -> ItemErrors:
    if not 2 <= (n_points := len(item.options) or item.points) <= 11:
        yield "points", f"is {n_points}; use 2 to 11"


LIKERT = QuestionKind("likert", LikertDraft, "rating", _check)
