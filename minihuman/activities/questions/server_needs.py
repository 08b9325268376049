"""What in a part of questions needs a server: without one, a page has the screens that were found beforehand."""

from collections.abc import Iterator
from typing import Any

from minihuman.experiment.plan.session_plan import PlannedPart

_FINITE_KINDS = ("choice", "choices", "likert")  # whose answers are few enough for a screen each


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield what in a part of questions needs a server."""
    questions: tuple[Any, ...] = part.plan.items
    for question in questions:
        if question.kind not in _FINITE_KINDS:
            yield f"asks {question.name!r} of kind {question.kind!r}; a site asks {', '.join(_FINITE_KINDS)}"
        if question.only_if:
            yield f"asks {question.name!r} depending on an earlier answer (only_if)"
        if question.right is not None:
            yield f"knows the correct answer to {question.name!r}, which the page would have to hold"
