"""The fields of a screen as a page has it, kind by kind. `page/messages.d.ts` is generated from here.

What is not in every screen of a kind is not required.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, NotRequired, TypedDict

from minihuman.experiment.machine.screens import AnswerWidget, ControlIndicator, OutcomeMark


@dataclass(frozen=True, slots=True)
class PageType:
    """Says in an annotation what a page finds in a field that this side does not look into."""

    form: Any  # a type


class ScreenLocale(TypedDict):
    """How a screen's words are written."""

    language: str
    rtl: bool
    theme: NotRequired[Literal["light"]]


class ButtonValues(TypedDict):
    """A spot to click; ``name`` is the target of the pointer's messages."""

    name: str
    label: str
    enabled: bool


class KeyValues(TypedDict):
    """A key of a drawn keyboard; lengths are in widths of a key."""

    x: float
    y: float
    width: float
    cap: str
    above: str
    pressed: bool


class TextValues(ScreenLocale):
    """A few words to read."""

    kind: Literal["text"]
    title: str
    body: str
    prompt: str
    progress: str
    keys: list[KeyValues]
    wide: float
    high: float


class BlankValues(ScreenLocale):
    """Nothing, or a cross to look at."""

    kind: Literal["blank"]
    cross: bool


class PlayValues(ScreenLocale):
    """What is around an episode's picture; the picture itself only where it is held, since scenes have theirs.

    Kinds of block add fields of their own: `ActivityKind.page_fields`.
    """

    kind: Literal["play"]
    progress: str
    episode: int
    step: int
    mark: OutcomeMark
    score_text: str
    controller: ControlIndicator
    controller_text: str
    mission: str
    legend: list[tuple[str, str, str]]  # what a key's cap says, what stands above it, the action
    pointer: NotRequired[bool]
    picture: NotRequired[int]


class PageValues(ScreenLocale):
    """A page of a text, with a picture above it where it has one."""

    kind: Literal["page"]
    title: str
    body: str
    page: int
    prompt: str
    progress: str
    buttons: list[ButtonValues]
    picture: int | None
    marks: list[tuple[float, float, str]]


class QuestionValues(ScreenLocale):
    """One question and its answer so far."""

    kind: Literal["question"]
    title: str
    question: str
    prompt: str
    progress: str
    note: str
    item: Annotated[dict[str, Any], PageType(AnswerWidget)]
    buttons: list[ButtonValues]


class ActivityValues(ScreenLocale):
    """A screen of one kind of activity, which the module at that address draws; it has fields of its own."""

    kind: Literal["activity"]
    view: str
    module: str
    title: str
    prompt: str
    progress: str
    films: NotRequired[list[list[int]]]  # the numbers of the pictures of its films; -1 is still to come


ScreenValues = TextValues | BlankValues | PlayValues | PageValues | QuestionValues | ActivityValues
