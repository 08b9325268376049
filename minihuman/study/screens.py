"""Screens: what a participant should see now, as values. Windows draw them; the session only names them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

Mark = Literal["", "good", "bad", "neutral"]
Steers = Literal["", "person", "agent"]


@dataclass(frozen=True, slots=True)
class Script:
    """How a screen's words are written."""

    language: str = "en"
    rtl: bool = False  # from right to left
    fonts: tuple[str, ...] = ()  # files of faces that are asked first


@dataclass(frozen=True, slots=True)
class Button:
    """A spot to click; ``name`` is the target of the pointer's inputs."""

    name: str
    label: str
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class Pointed:
    """A label in a picture: at (x, y), 0..1 of the picture from its top left corner."""

    x: float
    y: float
    label: str


@dataclass(frozen=True, slots=True)
class TextScreen:
    """A few words to read: ready, feedback, rest, pause, questions about the session, the end."""

    wants_text: ClassVar[bool] = False
    wants_pointer: ClassVar[bool] = False
    title: str
    body: str
    prompt: str  # what to press to go on, "" when nothing does
    progress: str = ""  # "episode 3 of 10"
    keys: tuple[tuple[str, bool], ...] = ()  # keyboard check: key name, already pressed
    script: Script = Script()
    labels: tuple[tuple[str, str, str], ...] = ()  # key name, what its cap says, what stands above it


@dataclass(frozen=True, slots=True)
class BlankScreen:
    """Nothing, or a cross to look at."""

    wants_text: ClassVar[bool] = False
    wants_pointer: ClassVar[bool] = False
    cross: bool = False
    script: Script = Script()


@dataclass(frozen=True, slots=True, eq=False)
class PlayScreen:
    """The world's picture, with the mission above and the progress line below."""

    wants_text: ClassVar[bool] = False
    wants_pointer: ClassVar[bool] = False
    picture: NDArray[np.uint8]  # uint8[H, W, 3]
    mission: str
    progress: str
    legend: tuple[tuple[str, str], ...] = ()  # key, action name; empty unless keys are shown
    episode: int = 0
    step: int = 0
    script: Script = Script()
    mark: Mark = ""  # the last picture, held: how the episode ended
    said: str = ""  # beside the mark: what it was worth
    labels: tuple[tuple[str, str, str], ...] = ()  # key name, what its cap says, what stands above it
    steers: Steers = ""  # a frame in their colour says who does; "" where an agent never does
    steers_said: str = ""  # the same in words
    flash: Mark = ""  # the frame for a moment: a press was taken


@dataclass(frozen=True, slots=True, eq=False)
class PageScreen:
    """A page of a text, with a picture above it where it has one."""

    wants_text: ClassVar[bool] = False
    wants_pointer: ClassVar[bool] = True
    title: str
    body: str  # this page's part of the text
    page: int  # 1 for the first
    pages: int
    prompt: str
    buttons: tuple[Button, ...] = ()
    progress: str = ""  # "Page 1 of 3", "" where there is one
    picture: NDArray[np.uint8] | None = None  # uint8[H, W, 3]
    marks: tuple[Pointed, ...] = ()  # in the picture
    script: Script = Script()


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of which one or several are chosen; targets "option:0", "option:1", ..."""

    options: tuple[str, ...]
    chosen: frozenset[int]
    at: int  # the option that the keyboard is at
    many: bool = False


@dataclass(frozen=True, slots=True)
class Scale:
    """Points in a row with words at the ends, or at each; targets "option:0", ..."""

    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: int | None


@dataclass(frozen=True, slots=True)
class Slider:
    """A line with a mark that can be moved; target "slider"."""

    low: str
    high: str
    along: float | None  # 0..1; None: not set yet
    value: str  # "" where it is not to be shown
    ticks: int  # intervals drawn


@dataclass(frozen=True, slots=True)
class Entry:
    """A field to type in; target "field"."""

    text: str
    caret: int  # characters before it
    long: bool
    unit: str = ""


Item = Choices | Scale | Slider | Entry


@dataclass(frozen=True, slots=True)
class QuestionScreen:
    """One question and its answer so far."""

    wants_pointer: ClassVar[bool] = True
    title: str
    ask: str
    item: Item
    prompt: str
    buttons: tuple[Button, ...] = ()
    progress: str = ""  # "Question 2 of 6"
    note: str = ""  # why it cannot be gone on with
    script: Script = Script()

    @property
    def wants_text(self) -> bool:
        """Whether text is to come from the input method."""
        return isinstance(self.item, Entry)


@dataclass(frozen=True, slots=True, eq=False)
class KindScreen:
    """A screen that one kind of activity brings, which draws it; the kind adds what is to be seen.

    It is seen in windows by ``minihuman.windows.drawings``.
    """

    wants_text: ClassVar[bool] = False
    wants_pointer: ClassVar[bool] = False
    script: Script


@dataclass(frozen=True, slots=True, eq=False)
class PairScreen(KindScreen):
    """Two films side by side, of which one is to be preferred: at one step of both."""

    lefts: Sequence[NDArray[np.uint8]]  # uint8[H, W, 3] each; the last stands while the other side goes on
    rights: Sequence[NDArray[np.uint8]]  # drawn when they are asked for
    step: int  # 0 for the first picture of both; one more than the last while that stands at the end
    title: str
    prompt: str  # the keys and what they say
    progress: str
    period_ns: int = 0  # from a step's pictures on the display to the next step
    again: str = ""  # the key that begins anew
    pair: tuple[int, int] = (0, 0)  # which one it is

    @property
    def length(self) -> int:
        """How many steps the longer film has."""
        return max(len(self.lefts), len(self.rights))

    @property
    def left(self) -> NDArray[np.uint8]:
        """What is on the left now."""
        return self.lefts[min(self.step, len(self.lefts) - 1)]

    @property
    def right(self) -> NDArray[np.uint8]:
        """What is on the right now."""
        return self.rights[min(self.step, len(self.rights) - 1)]

    @property
    def along(self) -> float:
        """How far the films have come, 0..1."""
        return min(1.0, self.step / max(1, self.length - 1))


@dataclass(frozen=True, slots=True, eq=False)
class FilmScreen(KindScreen):
    """One picture of an episode that is gone through step by step."""

    pictures: Sequence[NDArray[np.uint8]]  # uint8[H, W, 3] each, drawn when it is asked for
    step: int
    prompt: str  # the keys and what they do
    progress: str
    back: str  # the keys to the step before and the next one
    forward: str
    film: tuple[int, int]  # which one it is


Screen = TextScreen | BlankScreen | PlayScreen | PageScreen | QuestionScreen | KindScreen
