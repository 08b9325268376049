"""Plans of questionnaires."""

from typing import Literal

import msgspec

from minihuman.activities.questions.question import QuestionItemSpec


class QuestionsPlan(msgspec.Struct, frozen=True):
    """The plan of a questionnaire: its questions in order, and what follows wrong answers."""

    title: str
    items: tuple[QuestionItemSpec, ...]
    tries: int = 1
    wrong: str = ""  # shown after wrong answers while tries are left; "" says it in the interface's words
    back_to: int | None = None  # the part to which wrong answers lead; None asks again at once
    failed: Literal["go_on", "end"] = "go_on"  # after the last try
