"""What in a part of questions needs a server: without one, a page has the screens that were found beforehand."""

from collections.abc import Iterator
from typing import Any

from minihuman.activities.questions.question import QuestionItemSpec, QuestionKind, find_question_kind
from minihuman.experiment.plan.session_plan import PlannedPart
from minihuman.plugins import QUESTION_GROUP, list_plugin_names


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield a clause for each property of a part of questions that needs a server, such as "asks 'age' of kind 'file'".

    A page without a server cannot let the further course depend on an answer that it judges itself.
    """
    questions: tuple[Any, ...] = part.plan.items
    judged = {question.name: question for question in questions if find_question_kind(question.kind).is_judged_by_page}
    for question in questions:
        kind = find_question_kind(question.kind)
        if kind.find_server_needs is None:
            possible_kinds = ", ".join(_list_kinds_of_sites())
            yield f"asks {question.name!r} of kind {question.kind!r}; a site asks {possible_kinds}"
        else:
            yield from kind.find_server_needs(question)
        for name in question.only_if or ():
            if name in judged:
                yield f"asks {question.name!r} depending on the {_describe_answer(judged[name])} {name!r} (only_if)"
        if question.right is not None and question.name in judged:
            yield f"has a correct answer to {question.name!r}, a {_describe_answer(question)}"


def _describe_answer(question: QuestionItemSpec) -> str:
    """Return a noun for the answer to a question: "typed answer", or the kind's name, such as "slider"."""
    kind: QuestionKind = find_question_kind(question.kind)
    if kind.takes_text:
        return "typed answer"
    return kind.name


def _list_kinds_of_sites() -> list[str]:
    """Return the names of the built-in kinds that a page without a server can ask."""
    names = list_plugin_names(QUESTION_GROUP, built_in=True)
    return [name for name in names if find_question_kind(name).find_server_needs is not None]
