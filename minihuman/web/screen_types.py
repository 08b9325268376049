"""The fields of each kind of screen in the page; `page/messages.d.ts` is generated from here.

Fields that not every screen of a kind has are not required.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, NotRequired, TypedDict

from minihuman.experiment.machine.screens import AnswerWidget, ControlIndicator, OutcomeMark


@dataclass(frozen=True, slots=True)
class PageType:
    """An annotation that states the page's type of a field that the server itself does not inspect."""

    form: Any  # a type


class ScreenLocale(TypedDict):
    """The language, writing direction and theme of a screen."""

    language: str
    rtl: bool
    theme: NotRequired[Literal["light"]]


class ButtonValues(TypedDict):
    """A button; ``name`` is the target in the pointer's messages."""

    name: str
    label: str
    enabled: bool


class KeyValues(TypedDict):
    """A key of a drawn keyboard; lengths are multiples of one key's width."""

    x: float
    y: float
    width: float
    cap: str
    above: str
    pressed: bool


class TextValues(ScreenLocale):
    """A short text to read, with the keys to try if it has any."""

    kind: Literal["text"]
    title: str
    body: str
    prompt: str
    progress: str
    keys: list[KeyValues]
    wide: float
    high: float
    waits: bool


class BlankValues(ScreenLocale):
    """A blank screen, or one with a fixation cross."""

    kind: Literal["blank"]
    cross: bool


class PlayValues(ScreenLocale):
    """The texts around an episode's picture, and the picture itself while it is held.

    At other times the picture comes with the scene. Block kinds add their own fields through
    `ActivityKind.page_fields`.
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
    paragraphs: NotRequired[list[str]]  # of a mission with several: the first is above the picture, others beside it
    legend: list[tuple[str, str, str]]  # what a key's cap says, what stands above it, the action
    pointer: NotRequired[bool]
    axes: NotRequired[list[str]]  # of the mouse, which the page captures for them, and of sticks on a touch screen
    picture: NotRequired[int]


class PageValues(ScreenLocale):
    """A page of a text, with its picture above it if it has one."""

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
    """A screen of one activity kind, drawn by the module at ``module``; the kind adds its own fields."""

    kind: Literal["activity"]
    view: str
    module: str
    title: str
    prompt: str
    progress: str
    films: NotRequired[list[list[int]]]  # the numbers of the pictures of its films; -1 is still to come


ScreenValues = TextValues | BlankValues | PlayValues | PageValues | QuestionValues | ActivityValues
