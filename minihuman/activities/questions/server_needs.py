"""What in a part of questions needs a server: without one, a page has the screens that were found beforehand."""

from collections.abc import Iterator
from typing import Any

from minihuman.experiment.plan.session_plan import PlannedPart

_FINITE_KINDS = ("choice", "choices", "likert")  # whose answers are few enough for a screen each
_TYPED_KINDS = ("number", "text", "long_text")  # whose texts a page judges itself


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield what in a part of questions needs a server."""
    questions: tuple[Any, ...] = part.plan.items
    known = (*_FINITE_KINDS, *_TYPED_KINDS)
    typed = {question.name for question in questions if question.kind in _TYPED_KINDS}
    for question in questions:
        if question.kind not in known:
            yield f"asks {question.name!r} of kind {question.kind!r}; a site asks {', '.join(known)}"
        for name in question.only_if or ():
            if name in typed:
                yield f"asks {question.name!r} depending on the typed answer {name!r} (only_if)"
        if question.right is not None and question.name in typed:
            yield f"has a correct answer to {question.name!r}, which is typed"
