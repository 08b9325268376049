"""Numbers typed as answers: read by the study's language, asked again where two readings are possible."""

import pytest

from minihuman.activities.questions.number.draft import parse_number
from minihuman.activities.questions.question import QuestionItemSpec, build_draft


@pytest.mark.parametrize(
    ("text", "language", "number"),
    [
        ("1,000", "en", 1000), ("1.000", "de", 1000), ("1,000", "zh", 1000), ("1,000,000", "de", 1_000_000),
        ("1.5", "en", 1.5), ("1,5", "de", 1.5), ("1,5", "en", 1.5), ("1.234", "en", 1.234), ("0.500", "en", 0.5),
        ("1,000.5", "en", 1000.5), ("1.000,5", "en", 1000.5), ("12345", "he", 12345), ("-3", "en", -3),
        ("\N{MINUS SIGN}5", "en", -5), ("\uff11\uff12\uff0e\uff15", "ja", 12.5), ("\u0664\u0662", "ar", 42),
        ("\u0661\u0662\u066b\u0665", "ar", 12.5),
        ("1.000", "en", None), ("1,000", "fr", None), ("1,000", "he", None), ("1,00,0", "en", None), ("-", "en", None),
    ],
)  # fmt: skip
def test_a_number_is_read_as_its_language_writes_it(text: str, language: str, number: float | None) -> None:
    assert parse_number(text, language) == number


def typed(text: str, language: str | None) -> tuple[object, object]:
    draft = build_draft(QuestionItemSpec("n", "number", "?", maximum=9e6), rtl=False, language=language)
    draft.type_text(text)
    return draft.value, draft.error


def test_what_is_ambiguous_is_asked_again() -> None:
    assert typed("1,000", "en") == (1000, None)
    assert typed("1.000", "en") == (None, ("note.whole_number", {}))


def test_a_log_without_the_fact_is_read_by_the_first_rules() -> None:
    assert typed("1,000", None) == (1, None)
    assert typed("\N{MINUS SIGN}5", None) == (5, None)
