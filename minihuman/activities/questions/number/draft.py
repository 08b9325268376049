"""Questions of kind ``number``: type a number as the participant's language writes it."""

import math
import re
import unicodedata
from collections.abc import Callable
from typing import Any

from minihuman.activities.questions.free_text.draft import ADULT_AGE, N_SIMULATED_AGES, TextDraft
from minihuman.activities.questions.question import AnswerValue, QuestionKind, check_range, needs_no_server

NUMBER_RULES = "2"  # the fact "number_rules" of a session; a log without it was recorded under the first rules
_DECIMAL_MARKS = {"en": ".", "ja": ".", "zh": ".", "de": ",", "es": ",", "fr": ","}
# characters that stand for an ASCII mark
_SAME = str.maketrans("\N{MINUS SIGN}\N{FULLWIDTH HYPHEN-MINUS}\N{FULLWIDTH FULL STOP}\N{FULLWIDTH COMMA}", "--.,")
_NUMBER = re.compile(r"-?(\d+(?:[.,]\d+)*|[.,]\d+)[.,]?")  # digits with marks between, before or after them
_GROUPED = re.compile(r"-?[1-9]\d{0,2}(?:[.,]\d{3})+")  # as thousands are, whatever the marks mean


def _plain_character(character: str) -> str:
    """Return the ASCII form of a digit, minus sign, point or comma of any script."""
    digit = unicodedata.decimal(character, None)
    if digit is None:
        return character.translate(_SAME)
    return str(digit)


def parse_number(text: str, language: str, *, is_whole: bool = False) -> float | None:
    """Parse a number as a language writes it; return None if the text is no number or could mean two numbers.

    A mark before exactly three digits may separate thousands or decimals. The language decides: "1,000" is 1000 in
    English. The text is ambiguous if the language's decimal mark is unknown, or if the mark is the language's decimal
    mark and either precedes "000" or the number must be whole.
    """
    plain = "".join(map(_plain_character, text.strip())).replace("\N{ARABIC THOUSANDS SEPARATOR}", "")
    if "\N{ARABIC DECIMAL SEPARATOR}" in plain:
        plain = plain.replace(",", "").replace("\N{ARABIC DECIMAL SEPARATOR}", ".")
        if re.fullmatch(r"-?\d*\.\d+", plain):
            return float(plain)
        return None
    if not _NUMBER.fullmatch(plain):
        return None
    marks = [character for character in plain if character in ".,"]
    if not marks:
        return float(plain)
    if len(marks) > 1:
        return _parse_many_marks(plain, marks)
    if _GROUPED.fullmatch(plain):
        return _parse_ambiguous(plain, marks[0], _DECIMAL_MARKS.get(language), is_whole=is_whole)
    return float(plain.replace(marks[0], "."))


def _parse_many_marks(plain: str, marks: list[str]) -> float | None:
    """Parse a number with two or more marks; return None if they are not placed as in a number.

    Equal marks all separate thousands. Otherwise the last is the decimal mark, and all others separate thousands.

    Args:
        plain: the text, with ASCII digits and marks.
        marks: each point and comma of the text, in order.
    """
    last_mark = marks[-1]
    if len(set(marks)) == 1:
        if _GROUPED.fullmatch(plain):
            return float(plain.replace(last_mark, ""))
        return None
    thousands_mark = "," if last_mark == "." else "."
    if not re.fullmatch(rf"-?\d{{1,3}}(?:\{thousands_mark}\d{{3}})+\{last_mark}\d*", plain):
        return None
    return float(plain.replace(thousands_mark, "").replace(last_mark, "."))


def _parse_ambiguous(plain: str, mark: str, decimal_mark: str | None, *, is_whole: bool) -> float | None:
    """Parse a number whose only mark precedes exactly three digits; return None if it could mean two numbers.

    Args:
        plain: the text, with ASCII digits and marks.
        mark: its mark, a point or comma.
        decimal_mark: the decimal mark of the participant's language; None if it is unknown.
        is_whole: whether the number must be whole.
    """
    if decimal_mark is None:
        return None
    if mark != decimal_mark:
        return float(plain.replace(mark, ""))
    if is_whole or plain.endswith("000"):
        return None
    return float(plain.replace(mark, "."))


class NumberDraft(TextDraft):
    """A draft answer that is a typed number."""

    def accepts(self, character: str) -> bool:
        """Return whether a number may contain a character; old rules allow only ASCII digits and marks."""
        if self.language is None:
            return character in "0123456789-.,"
        marks = "\N{ARABIC DECIMAL SEPARATOR}\N{ARABIC THOUSANDS SEPARATOR}"
        return character.isprintable() and _plain_character(character) in f"0123456789-.,{marks}"

    @property
    def value(self) -> AnswerValue:
        """Return the number, as an integer if the question asks for a whole one; None if the text is not valid."""
        number = self._parse_text(self.display_text)
        if number is None or not math.isfinite(number):  # more digits than a number holds
            return None
        if self.question.whole:
            if number == int(number):
                return int(number)
            return None
        return number

    def _parse_text(self, text: str) -> float | None:
        """Parse the typed text as the session's language writes numbers; None if it is not a number."""
        if self.language is not None:
            return parse_number(text, self.language, is_whole=self.question.whole)
        try:
            return float(text.replace(",", "."))
        except ValueError:
            return None

    @property
    def error(self) -> tuple[str, dict[str, Any]] | None:
        """Return the note that the answer is missing, not a number or out of range; None if it is valid.

        The note is a text's key and its fields.
        """
        question = self.question
        number = self.value
        if not self.display_text.strip():
            return super().error
        if number is None:
            return "note.whole_number" if question.whole else "note.number", {}
        assert isinstance(number, int | float)
        if not question.minimum <= number <= question.maximum:
            return "note.range", {
                "minimum": _format_number(question.minimum),
                "maximum": _format_number(question.maximum),
            }
        return None

    def simulate(self, choose: Callable[[int], int], attends: Callable[[], bool]) -> str | None:
        """Return a random number within the range, as text to type, from 18 up if the range allows it.

        None means that a number is there already.
        """
        if self.display_text:
            return None
        low = math.ceil(self.question.minimum)
        high = math.floor(self.question.maximum)
        if low <= ADULT_AGE <= high:
            low = ADULT_AGE
        return str(low + choose(max(1, min(N_SIMULATED_AGES, high - low + 1))))


def _format_number(number: float) -> str:
    """Format a number with up to 9 decimals, without an exponent or trailing zeros."""
    return f"{number:.9f}".rstrip("0").rstrip(".")


NUMBER = QuestionKind(
    "number",
    NumberDraft,
    "number",
    check_range,
    item_fields=("minimum", "maximum", "whole", "unit"),
    takes_text=True,
    find_server_needs=needs_no_server,
    is_judged_by_page=True,
)
