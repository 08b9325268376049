"""Checks exclusion rules on answers: whether the question exists, and whether its kind allows the comparison."""

from collections.abc import Iterator, Sequence

import msgspec

from minihuman.activities.questions.question import (
    ANSWER_TYPES_WITH_CODES,
    QuestionItemSpec,
    find_question_kind,
    list_codes,
)
from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.model import ExclusionSpec, Protocol
from minihuman.experiment.protocol.specs import SHIPPED_FORMS, QuestionnaireSpec, apply_overrides, load_form
from minihuman.experiment.protocol.validation_errors import FieldError

_ORDERED = ("rating", "number")  # types of answers that can be compared with < and >
_ANSWER_FIELDS = ("is_one_of", "is_none_of", "is_missing")


def check_answer_exclusions(protocol: Protocol) -> Iterator[FieldError]:
    """Yield the errors of exclusion rules on answers, and of other rules that use a comparison meant for answers."""
    for number, rule in enumerate(protocol.exclusions):
        path = f"$.exclusions[{number}]"
        if rule.question:
            yield from _check_rule(protocol, rule, path)
            continue
        for field in _ANSWER_FIELDS:
            if getattr(rule, field):
                yield f"{path}.{field}", "compares an answer; use it with measure = 'answer:QUESTIONS.ITEM'"


def describe_answer_exclusion(rule: ExclusionSpec) -> str:
    """Describe the participants that a rule excludes: "whose answer to attention.colour is none of 'blue'"."""
    comparisons = []
    if rule.is_one_of:
        comparisons.append(f"is one of {', '.join(map(repr, rule.is_one_of))}")
    if rule.is_none_of:
        comparisons.append(f"is none of {', '.join(map(repr, rule.is_none_of))}")
    if rule.below is not None:
        comparisons.append(f"is below {rule.below:g}")
    if rule.above is not None:
        comparisons.append(f"is above {rule.above:g}")
    if rule.is_missing:
        comparisons.append("is missing")
    return f"whose answer to {rule.question} {' or '.join(comparisons)}"


def _check_rule(protocol: Protocol, rule: ExclusionSpec, path: str) -> Iterator[FieldError]:
    if rule.level != "participant":
        yield f"{path}.level", f"is {rule.level!r}, but an answer excludes a participant; use level = 'participant'"
    if rule.where:
        yield f"{path}.where", "is of trials, which an answer has none of; remove it"
    questions = _list_questions(protocol)
    question = questions.get(rule.question)
    if question is None:
        known = ", ".join(f"answer:{name}" for name in questions) or "no questions"
        yield f"{path}.measure", f"is {rule.measure!r}, which is not a question; there are {known}"
        return
    yield from _check_comparison(rule, question, path)


def _check_comparison(rule: ExclusionSpec, question: QuestionItemSpec, path: str) -> Iterator[FieldError]:
    """Yield an error for each comparison of a rule that the question's kind does not allow."""
    try:
        answer_type = find_question_kind(question.kind).answer_type
    except ProtocolError:  # the question's own check names it
        return
    measured = f"{rule.measure!r} is of kind {question.kind!r}"
    for field in ("below", "above"):
        if getattr(rule, field) is not None and answer_type not in _ORDERED:
            yield f"{path}.{field}", f"compares numbers, but {measured}; {_suggest_comparison(answer_type)}"
    for field in ("is_one_of", "is_none_of"):
        problem = _find_code_problem(getattr(rule, field), question, answer_type, measured)
        if problem:
            yield f"{path}.{field}", problem
    if rule.is_missing and question.required:
        yield f"{path}.is_missing", f"is true, but {rule.question} is required; set required = false in the question"


def _find_code_problem(
    codes: Sequence[str | float], question: QuestionItemSpec, answer_type: str, measured: str
) -> str:
    """Say why an answer can be none of the codes that a rule names; "" if it can.

    Args:
        codes: what the rule names.
        question: the question that is asked.
        answer_type: the type of its answers.
        measured: what the rule measures, and of which kind it is, for the sentence.
    """
    if codes and answer_type == "text":
        return f"compares codes, but {measured}; use is_missing, or ask a choice"
    if answer_type in ANSWER_TYPES_WITH_CODES:
        known = list_codes(question)
        unknown = [code for code in codes if code not in known]
        if unknown:
            return f"has {unknown[0]!r}, which is not an option's code; codes: {', '.join(map(repr, known))}"
    elif answer_type == "number":
        texts = [code for code in codes if isinstance(code, str)]
        if texts:
            return f"has {texts[0]!r}, but {measured}; give numbers"
    return ""


def _suggest_comparison(answer_type: str) -> str:
    """Return the advice for a rule that compares an answer without an order."""
    if answer_type == "text":
        return "use is_missing, or ask for a number"
    return "use is_one_of or is_none_of"


def _list_questions(protocol: Protocol) -> dict[str, QuestionItemSpec]:
    """Return the questions of all groups by the name of their answers, QUESTIONS.ITEM."""
    questions: dict[str, QuestionItemSpec] = {}
    for questionnaire in protocol.questions:
        for group in ("", *questionnaire.group_overrides):
            try:
                questionnaire_of_group = apply_overrides(questionnaire, group)
            except msgspec.ValidationError:  # the override's own check names it
                continue
            for item in _list_items(questionnaire_of_group, protocol.study.language):
                questions |= {f"{questionnaire.name}.{name}": item for name in item.asked}
    return questions


def _list_items(questionnaire: QuestionnaireSpec, language: str) -> tuple[QuestionItemSpec, ...]:
    """Return a questionnaire's items, including those of a shipped form; () if the form does not exist."""
    if not questionnaire.form:
        return questionnaire.items
    if questionnaire.form not in SHIPPED_FORMS:
        return ()
    try:
        return load_form(questionnaire.form, language).items
    except ProtocolError:  # not in this language: the form's own check says so
        return ()
