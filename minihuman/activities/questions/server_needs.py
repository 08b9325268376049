"""What in a part of questions needs a server: without one, a page has the screens that were found beforehand."""

from collections.abc import Iterator
from typing import Any

from minihuman.experiment.plan.session_plan import PlannedPart

_FINITE_KINDS = ("choice", "choices", "likert")  # whose answers are few enough for a screen each
_OPEN_KINDS = ("number", "text", "long_text", "slider")  # whose answers a page judges itself
_MAX_SLIDER_STEPS = 2_000  # of which the page has a text each
_NOUNS = dict.fromkeys(("number", "text", "long_text"), "typed answer") | {"slider": "slider"}


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield what in a part of questions needs a server."""
    questions: tuple[Any, ...] = part.plan.items
    known = (*_FINITE_KINDS, *_OPEN_KINDS)
    kinds = {question.name: question.kind for question in questions if question.kind in _OPEN_KINDS}
    for question in questions:
        if question.kind not in known:
            yield f"asks {question.name!r} of kind {question.kind!r}; a site asks {', '.join(known)}"
        for name in question.only_if or ():
            if name in kinds:
                yield f"asks {question.name!r} depending on the {_NOUNS[kinds[name]]} {name!r} (only_if)"
        if question.right is not None and question.name in kinds:
            yield f"has a correct answer to {question.name!r}, a {_NOUNS[question.kind]}"
        if question.kind == "slider" and (question.maximum - question.minimum) / question.step > _MAX_SLIDER_STEPS:
            yield f"asks {question.name!r} on a slider of more than {_MAX_SLIDER_STEPS} steps; give it a larger step"
