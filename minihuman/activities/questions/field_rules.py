"""The rules by which a page without a server judges a typed answer or a slider, and an example for each judgement."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from minihuman.activities.questions.free_text.draft import TextDraft
from minihuman.activities.questions.slider.draft import SliderDraft
from minihuman.experiment.machine.activity import AnswerField
from minihuman.experiment.machine.inputs import Input, PointerPressed, TextEdited

EMPTY = "empty"
FINE = "fine"


def describe_field(draft: TextDraft) -> AnswerField:
    """Describe a text field, so that a page without a server can judge and show any text in it."""
    examples = {
        judgement: (_make_text_input(""), _make_text_input(text)) for judgement, text in list_examples(draft).items()
    }
    return AnswerField(draft.question.name, judge_text(draft), describe_rules(draft), ("text", "caret"), examples)


def describe_slider(draft: SliderDraft) -> AnswerField:
    """Describe a slider, so that a page without a server can judge and show any position of its thumb.

    The page's ``fields.js`` moves the thumb by the same rules as the draft.
    """
    judgement = FINE
    if draft.value is None:
        judgement = EMPTY
    shown_texts: list[str] = []
    if draft.question.show_value:
        shown_texts = draft.list_texts()
    rules = {"n_steps": draft.n_steps, "rtl": draft.rtl, "shown_texts": shown_texts}
    return AnswerField(draft.question.name, judgement, rules, ("position", "value"), {FINE: (_touch_slider,)})


def _make_text_input(text: str) -> Callable[[int], Input]:
    """Return a function that takes a time in ns and returns the input that makes ``text`` a field's text."""
    return lambda t_ns: TextEdited(t_ns, text)


def _touch_slider(t_ns: int) -> Input:
    """Return the input of a press on the middle of a slider at a time in ns.

    The place on the screen is arbitrary.
    """
    return PointerPressed(t_ns, x=0.5, y=0.5, target="slider", along=0.5)


def judge_text(draft: TextDraft) -> str:
    """Return the judgement of a draft's text: `EMPTY`, `FINE`, or the key of the note that is shown for it."""
    if draft.display_text == "":
        return EMPTY
    if draft.error is None:
        return FINE
    return draft.error[0]


def describe_rules(draft: TextDraft) -> dict[str, Any]:
    """Return the settings on which `judge_text` depends, as JSON values; the page's ``answers.js`` judges by them."""
    question = draft.question
    return {
        "is_number": question.kind == "number",
        "language": draft.language,
        "longest": draft.longest,
        "required": question.required,
        "whole": question.whole,
        "minimum": question.minimum,
        "maximum": question.maximum,
    }


def list_examples(draft: TextDraft) -> dict[str, str]:
    """Return an example text, by judgement, for each judgement of a text that a draft's question can have.

    The draft's own text is the same afterwards as before.
    """
    original_text = draft.display_text
    examples: dict[str, str] = {}
    for text in _list_candidates(draft):
        draft.put_text(text)
        examples.setdefault(judge_text(draft), text)
    draft.put_text(original_text)
    return examples


def _list_candidates(draft: TextDraft) -> Iterator[str]:
    """Yield texts that together have every judgement: empty, blank, too long, numbers in and outside the range."""
    low = draft.question.minimum
    high = draft.question.maximum
    yield from ("", " ", "x", " " * (draft.longest + 1), "x" * (draft.longest + 1))
    for number in (math.ceil(low), math.floor(high), math.ceil(low) - 1, math.floor(high) + 1):
        yield str(number)
    yield from (repr(low), repr(high))
