"""Questions of kind ``slider``: choose a number on a line, in steps."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    Click,
    QuestionItemSpec,
    QuestionKind,
    check_range,
    horizontal_step,
)
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import Slider

_DECIMALS = 9  # of a slider's numbers, so that sums of steps such as 0.1 have no rounding errors
_MOST_TICKS = 20  # intervals that are drawn on the line
_N_SIMULATED_POSITIONS = 21  # from one end of the line to the other


class SliderDraft(AnswerDraft):
    """A draft answer that is a position on the line.

    The line has no thumb until it is touched, so that no starting position suggests an answer.
    """

    def __init__(self, question: QuestionItemSpec, settings: Any, *, rtl: bool, language: str | None) -> None:
        super().__init__(question, settings, rtl=rtl, language=language)
        self.n_steps = max(1, round((question.maximum - question.minimum) / question.step))
        self._step: int | None = None  # from the minimum

    def key(self, press: KeyDown) -> bool:
        """Move the thumb: arrows by a step, page keys by a tenth of the line, home and end to its ends.

        The first arrow or page key sets the thumb to the middle. Return False for any other key.
        """
        tenth = max(1, self.n_steps // 10)
        moves = {"page_up": tenth, "page_down": -tenth, "up": 1, "down": -1}
        move = horizontal_step(press.key, rtl=self.rtl) or moves.get(press.key, 0)
        if move:
            if self._step is None:
                self._step = self.n_steps // 2
            else:
                self._step = min(self.n_steps, max(0, self._step + move))
        elif press.key == "home":
            self._step = 0
        elif press.key == "end":
            self._step = self.n_steps
        else:
            return False
        return True

    def point_at(self, target: str, along: float, *, down: bool) -> None:
        """Move the thumb to the pointer, which is at the share ``along`` of the line, from 0 at the minimum to 1."""
        if target == "slider":
            self._step = min(self.n_steps, max(0, math.floor(along * self.n_steps + 0.5)))

    @property
    def value(self) -> AnswerValue:
        """Return the number at the thumb; None before the line is touched."""
        if self._step is None:
            return None
        return self._number_at(self._step)

    def _number_at(self, step: int) -> int | float:
        """Return the number at a step from the minimum, as an integer if it is whole."""
        number = round(self.question.minimum + step * self.question.step, _DECIMALS)
        if number == int(number):
            return int(number)
        return number

    def list_texts(self) -> list[str]:
        """Return the text of each position of the thumb, from the minimum on."""
        return [f"{self._number_at(step):g}" for step in range(self.n_steps + 1)]

    @property
    def display_text(self) -> str:
        """Return the number at the thumb as text; "" before the line is touched."""
        if self.value is None:
            return ""
        return f"{self.value:g}"

    def widget(self) -> Slider:
        """Build the slider."""
        position = None if self._step is None else self._step / self.n_steps
        text = self.display_text if self.question.show_value else ""
        return Slider(self.question.low, self.question.high, position, text, min(self.n_steps, _MOST_TICKS))

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> Click | None:
        """Return a click on one of evenly spaced positions of the line, drawn at random; None once it has a thumb."""
        if self._step is None:
            return Click("slider", choose(_N_SIMULATED_POSITIONS) / (_N_SIMULATED_POSITIONS - 1))
        return None


_MAX_SITE_STEPS = 2_000  # of which a page without a server has a text each


def _find_server_needs(question: QuestionItemSpec) -> Iterator[str]:
    """Yield a clause if a slider has too many steps for a page without a server."""
    if (question.maximum - question.minimum) / question.step > _MAX_SITE_STEPS:
        yield f"asks {question.name!r} on a slider of more than {_MAX_SITE_STEPS} steps; give it a larger step"


SLIDER = QuestionKind(
    "slider",
    SliderDraft,
    "number",
    check_range,
    item_fields=("low", "high", "minimum", "maximum", "step", "show_value"),
    find_server_needs=_find_server_needs,
    is_judged_by_page=True,
)
