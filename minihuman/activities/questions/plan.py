"""Plans of questionnaires."""

from typing import Literal

import msgspec

from minihuman.activities.questions.question import QuestionItemSpec, find_question_kind
from minihuman.errors import ProtocolError


class QuestionsPlan(msgspec.Struct, frozen=True):
    """The plan of a questionnaire: its questions in order, and what follows wrong answers."""

    title: str
    items: tuple[QuestionItemSpec, ...]
    tries: int = 1
    wrong: str = ""  # shown after wrong answers while tries are left; "" says it in the interface's words
    back_to: int | None = None  # the part to which wrong answers lead; None asks again at once
    failed: Literal["go_on", "end"] = "go_on"  # after the last try

    @property
    def has_text_fields(self) -> bool:
        """Return whether a question is answered by typing; kinds that are not installed do not count."""
        return any(_takes_text(question.kind) for question in self.items)


def _takes_text(kind_name: str) -> bool:
    """Return whether questions of a kind are answered by typing; False for a kind that is not installed."""
    try:
        return find_question_kind(kind_name).takes_text
    except ProtocolError:
        return False
