"""Questions of kind ``likert``: choose a point on a rating scale, once or for each statement of a matrix."""

from collections.abc import Callable
from typing import Any

import msgspec

from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    Click,
    ItemErrors,
    QuestionItemSpec,
    QuestionKind,
    horizontal_step,
    needs_no_server,
    parse_digit,
    parse_option,
)
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import RatingMatrix, RatingScale


class LikertDraft(AnswerDraft):
    """A draft answer that selects one point of a rating scale."""

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._n_points = len(question.options) or question.points
        self._chosen: int | None = None

    def key(self, press: KeyDown) -> bool:
        """Move the selection with left and right, or select with a digit; return False for any other key."""
        if (digit := parse_digit(press.key)) and digit <= self._n_points:
            self._chosen = digit - 1
        elif step := horizontal_step(press.key, rtl=self.rtl):
            last_point = self._n_points - 1
            if self._chosen is None:
                self._chosen = last_point // 2  # the middle
            else:
                self._chosen = min(last_point, max(0, self._chosen + step))
        else:
            return False
        return True

    def point_at(self, target: str, along: float, *, down: bool) -> None:
        """Select the point that ``target`` names when the pointer is pressed on it; ``along`` is not used."""
        point = parse_option(target)
        if down and point is not None and point < self._n_points:
            self._chosen = point

    @property
    def value(self) -> AnswerValue:
        """Return the selected point's code, or its number from 1 without codes; None if none is selected."""
        if self._chosen is None:
            return None
        return self.question.all_codes[self._chosen]

    @property
    def display_text(self) -> str:
        """Return the label of the selected point, or its number without labels; "" if none is selected."""
        if self._chosen is None:
            return ""
        return self._labels[self._chosen]

    @property
    def _labels(self) -> tuple[str, ...]:
        """Return the label of each point: the question's options, or numbers from 1."""
        return self.question.options or tuple(str(point + 1) for point in range(self._n_points))

    def widget(self) -> RatingScale:
        """Build the rating scale."""
        return RatingScale(self._labels, self.question.low, self.question.high, self._chosen)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | None:
        """Return a click on a random point; None once a point is selected."""
        if self._chosen is None:
            return Click(f"option:{choose(self._n_points)}")
        return None


class MatrixDraft(LikertDraft):
    """A draft answer that selects a point in each of several rows; the keyboard acts on one row at a time."""

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self._rows: list[int | None] = [None] * len(question.asked)
        self._row = 0

    def key(self, press: KeyDown) -> bool:
        """Change the row with up and down, or select a point of the present row; return False for any other key.

        A digit also moves to the next row.
        """
        row_step = {"up": -1, "down": 1}.get(press.key, 0)
        if row_step == 0:
            self._chosen = self._rows[self._row]
            if not super().key(press):
                return False
            self._rows[self._row] = self._chosen
            if parse_digit(press.key):
                row_step = 1
        self._row = min(len(self._rows) - 1, max(0, self._row + row_step))
        return True

    def point_at(self, target: str, along: float, *, down: bool) -> None:
        """Select the point that ``target`` names when the pointer is pressed on it; points are numbered row by row."""
        number = parse_option(target)
        if down and number is not None and number < len(self._rows) * self._n_points:
            self._row, point = divmod(number, self._n_points)
            self._rows[self._row] = point

    @property
    def value(self) -> AnswerValue:
        """Return the codes of the selected points in the order of the rows, with "" for a row without one."""
        codes = self.question.all_codes
        return ["" if point is None else codes[point] for point in self._rows]

    @property
    def display_text(self) -> str:
        """Return the labels or numbers of the rows' selected points, with commas between, and "" for a row without."""
        return ", ".join(map(self._find_label, self._rows))

    def _find_label(self, point: int | None) -> str:
        """Return the label of a row's selected point; "" for a row without one."""
        if point is None:
            return ""
        return self._labels[point]

    @property
    def answers(self) -> tuple[tuple[str, AnswerValue, str], ...]:
        """Return the name, code and label to log for each statement; without a point, code None and label ""."""
        codes = self.question.all_codes
        return tuple(
            (name, None if point is None else codes[point], self._find_label(point))
            for name, point in zip(self.question.asked, self._rows, strict=True)
        )

    def widget(self) -> RatingMatrix:  # type: ignore[override]
        """Build the rating matrix."""
        question = self.question
        rows = tuple((question.statements or {}).values())
        return RatingMatrix(rows, self._labels, question.low, question.high, tuple(self._rows), self._row)

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | None:
        """Return a click on a random point in the first row that has none; None once every row has one."""
        if None not in self._rows:
            return None
        return Click(f"option:{self._rows.index(None) * self._n_points + choose(self._n_points)}")

    @property
    def error(self) -> tuple[str, dict[str, Any]] | None:
        """Return the note that a required answer lacks a point in some row; None if there is nothing to note."""
        if self.question.required and None in self._rows:
            return ("note.required", {})
        return None


def _build(question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> LikertDraft:
    kind = MatrixDraft if question.statements else LikertDraft
    return kind(question, settings, rtl=rtl, language=language)


_MAX_STATEMENTS = 8  # that fit a screen
_MAX_POINTS = 11


def _check_scale(question: QuestionItemSpec) -> ItemErrors:
    """Yield the errors of a rating scale or matrix in a protocol."""
    if question.statements is not msgspec.UNSET and not 2 <= len(question.statements) <= _MAX_STATEMENTS:
        yield "statements", f"has {len(question.statements)}; give 2 to {_MAX_STATEMENTS}, each its name = its text"
    n_points = len(question.options) or question.points
    if not 2 <= n_points <= _MAX_POINTS:
        yield "points", f"is {n_points}; use 2 to {_MAX_POINTS}"


LIKERT = QuestionKind(
    "likert",
    _build,
    "rating",
    _check_scale,
    item_fields=("options", "codes", "low", "high", "points", "statements"),
    has_statements=True,
    find_server_needs=needs_no_server,
)
