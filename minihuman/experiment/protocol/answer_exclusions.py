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
    """Return a clause on whom a rule on an answer excludes: "whose answer to attention.colour is missing"."""
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
        names = ", ".join(f"answer:{name}" for name in questions) or "no questions"
        yield f"{path}.measure", f"is {rule.measure!r}, which is not a question; there are {names}"
        return
    yield from _check_comparison(rule, question, path)


def _check_comparison(rule: ExclusionSpec, question: QuestionItemSpec, path: str) -> Iterator[FieldError]:
    """Yield an error for each comparison of a rule that the question's kind does not allow."""
    try:
        answer_type = find_question_kind(question.kind).answer_type
    except ProtocolError:  # the question's own check reports it
        return
    measure_and_kind = f"{rule.measure!r} is of kind {question.kind!r}"
    for field in ("below", "above"):
        if getattr(rule, field) is not None and answer_type not in _ORDERED:
            yield f"{path}.{field}", f"compares numbers, but {measure_and_kind}; {_suggest_comparison(answer_type)}"
    for field in ("is_one_of", "is_none_of"):
        problem = _describe_impossible_code(getattr(rule, field), question, answer_type, measure_and_kind)
        if problem:
            yield f"{path}.{field}", problem
    if rule.is_missing and question.required:
        yield f"{path}.is_missing", f"is true, but {rule.question} is required; set required = false in the question"


def _describe_impossible_code(
    codes: Sequence[str | float], question: QuestionItemSpec, answer_type: str, measure_and_kind: str
) -> str:
    """Return why a question cannot have one of the answers with which a rule compares it; "" if it can have all.

    Args:
        codes: the answers in the rule: codes of options, or numbers.
        question: the question.
        answer_type: the type of the question's answers.
        measure_and_kind: a clause with the rule's measure and the question's kind, for the description.
    """
    if codes and answer_type == "text":
        return f"compares codes, but {measure_and_kind}; use is_missing, or ask a choice"
    if answer_type in ANSWER_TYPES_WITH_CODES:
        option_codes = list_codes(question)
        unknown = [code for code in codes if code not in option_codes]
        if unknown:
            return f"has {unknown[0]!r}, which is not an option's code; codes: {', '.join(map(repr, option_codes))}"
    elif answer_type == "number":
        texts = [code for code in codes if isinstance(code, str)]
        if texts:
            return f"has {texts[0]!r}, but {measure_and_kind}; give numbers"
    return ""


def _suggest_comparison(answer_type: str) -> str:
    """Return the advice for a rule that compares a text, or an option without an order, as if it were a number."""
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
            except msgspec.ValidationError:  # the override's own check reports it
                continue
            for item in _list_items(questionnaire_of_group, protocol.study.language):
                questions |= {f"{questionnaire.name}.{name}": item for name in item.asked}
    return questions


def _list_items(questionnaire: QuestionnaireSpec, language: str) -> tuple[QuestionItemSpec, ...]:
    """Return a questionnaire's items, or those of its shipped form; () if the form does not exist in the language."""
    if not questionnaire.form:
        return questionnaire.items
    if questionnaire.form not in SHIPPED_FORMS:
        return ()
    try:
        return load_form(questionnaire.form, language).items
    except ProtocolError:  # not in this language, which the form's own check reports
        return ()
