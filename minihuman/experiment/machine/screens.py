"""Screens: what a participant should see now, as values. Windows and pages draw them."""

import abc
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.moved import forward_names

_HEX_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")

OutcomeMark = Literal["", "good", "bad", "neutral"]


ControlIndicator = Literal["", "person", "agent"]


@dataclass(frozen=True, slots=True)
class TextLocale:
    """The way in which a screen's words are written."""

    language: str = "en"
    rtl: bool = False  # from right to left
    fonts: tuple[str, ...] = ()  # files of faces that are asked first
    theme: str = "dark"  # or "light": light words on a dark ground, or dark on light


@dataclass(frozen=True, slots=True)
class Button:
    """A spot to click; ``name`` is the target of the pointer's inputs."""

    name: str
    label: str
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class PictureLabel:
    """A label in a picture: at (x, y), 0..1 of the picture from its top left corner."""

    x: float
    y: float
    label: str


@dataclass(frozen=True, slots=True)
class TextScreen:
    """A few words to read: ready, feedback, rest, pause, questions about the session, the end."""

    accepts_text: ClassVar[bool] = False
    accepts_pointer: ClassVar[bool] = False
    title: str
    body: str
    prompt: str  # what to press to go on, "" when nothing does
    progress: str = ""  # "episode 3 of 10"
    keys: tuple[tuple[str, bool], ...] = ()  # keyboard check: key name, already pressed
    locale: TextLocale = TextLocale()
    labels: tuple[tuple[str, str, str], ...] = ()  # key name, what its cap says, what stands above it


@dataclass(frozen=True, slots=True)
class BlankScreen:
    """Nothing, or a cross to look at."""

    accepts_text: ClassVar[bool] = False
    accepts_pointer: ClassVar[bool] = False
    cross: bool = False
    locale: TextLocale = TextLocale()


class Motion(NamedTuple):
    """A view that moves from one picture to the next."""

    lasts_ns: int
    draw: Callable[[float], NDArray[np.uint8]]  # at a share of the way, 0..1


@dataclass(frozen=True, slots=True, eq=False)
class PlayScreen:
    """The world's picture, with the mission above and the progress line below; target "picture"."""

    accepts_text: ClassVar[bool] = False
    picture: NDArray[np.uint8]  # uint8[H, W, 3]
    mission: str
    progress: str
    legend: tuple[tuple[str, str], ...] = ()  # key, action name; empty unless keys are shown
    episode: int = 0
    step: int = 0
    locale: TextLocale = TextLocale()
    mark: OutcomeMark = ""  # the last picture, held: how the episode ended
    score_text: str = ""  # beside the mark: what it was worth
    labels: tuple[tuple[str, str, str], ...] = ()  # key name, what its cap says, what stands above it
    controller: ControlIndicator = ""  # a frame in their colour says who does; "" where an agent never does
    controller_text: str = ""  # the same in words
    flash: OutcomeMark = ""  # the frame for a moment: a press was taken
    accepts_pointer: bool = False  # a click in the picture is an action
    motion: Motion | None = None  # how the view gets here; windows may leave it out
    page_fields: Mapping[str, Any] = field(default_factory=dict)  # what its kind of block adds for a page


@dataclass(frozen=True, slots=True, eq=False)
class PageScreen:
    """A page of a text, with a picture above it where it has one."""

    accepts_text: ClassVar[bool] = False
    accepts_pointer: ClassVar[bool] = True
    title: str
    body: str  # this page's part of the text
    page: int  # 1 for the first
    pages: int
    prompt: str
    buttons: tuple[Button, ...] = ()
    progress: str = ""  # "Page 1 of 3", "" where there is one
    picture: NDArray[np.uint8] | None = None  # uint8[H, W, 3]
    marks: tuple[PictureLabel, ...] = ()  # in the picture
    locale: TextLocale = TextLocale()


@dataclass(frozen=True, slots=True)
class OptionList:
    """Options of which one or several are chosen; targets "option:0", "option:1", ..."""

    options: tuple[str, ...]
    chosen: tuple[int, ...]
    cursor: int  # the option that the keyboard is at
    many: bool = False


@dataclass(frozen=True, slots=True)
class RatingScale:
    """Points in a row with words at the ends, or at each; targets "option:0", ..."""

    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: int | None


@dataclass(frozen=True, slots=True)
class RatingMatrix:
    """Statements below each other on the same scale; targets "option:0", ..., row by row."""

    rows: tuple[str, ...]
    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: tuple[int | None, ...]  # by row
    cursor: int  # the row that the keyboard is at


@dataclass(frozen=True, slots=True)
class Slider:
    """A line with a thumb that can be moved; target "slider"."""

    low: str
    high: str
    position: float | None  # 0..1; None: not set yet
    value: str  # "" where it is not to be shown
    ticks: int  # intervals drawn


@dataclass(frozen=True, slots=True)
class TextField:
    """A field to type in; target "field"."""

    text: str
    caret: int  # characters before it
    long: bool
    unit: str = ""


@dataclass(frozen=True, slots=True)
class CanvasShape:
    """A box or an ellipse of a `ShapeCanvas`: lengths are 0..1 of the canvas, from its top left corner."""

    x: float
    y: float
    width: float
    height: float
    label: str = ""
    target: str = ""  # "": it cannot be clicked
    chosen: bool = False
    is_round: bool = False
    fill: str = ""  # a colour, "#rrggbb", which it keeps when chosen; "": the theme's

    def __post_init__(self) -> None:
        if self.fill and not _HEX_COLOUR.fullmatch(self.fill):
            raise ValueError(f"fill is {self.fill!r}; write a colour as '#aa3311'")


@dataclass(frozen=True, slots=True)
class ShapeCanvas:
    """Shapes on a canvas, later ones in front: what a question of a plug-in's kind shows, if no other widget does."""

    shapes: tuple[CanvasShape, ...]
    aspect: float = 1.0  # width by height


AnswerWidget = OptionList | RatingScale | RatingMatrix | Slider | TextField | ShapeCanvas


@dataclass(frozen=True, slots=True)
class QuestionScreen:
    """One question and its answer so far."""

    accepts_pointer: ClassVar[bool] = True
    title: str
    question: str
    item: AnswerWidget
    prompt: str
    buttons: tuple[Button, ...] = ()
    progress: str = ""  # "Question 2 of 6"
    note: str = ""  # why it cannot be gone on with
    locale: TextLocale = TextLocale()

    @property
    def accepts_text(self) -> bool:
        """Whether text is to come from the input method."""
        return isinstance(self.item, TextField)


@dataclass(frozen=True, slots=True)
class PageView:
    """The view of a kind's own screen on a browser's page.

    Args:
        name: a word for it, by which style sheets know it.
        values: "module:function" that takes the screen and a function which numbers pictures; it returns JSON values.
        module: "package:file", a JavaScript module of the kind's folder. Its function ``draw`` takes those values, the
            message that they came in, and tools of the page; it returns the elements of the screen.
    """

    name: str
    values: str
    module: str


@dataclass(frozen=True, slots=True, eq=False)
class ActivityScreen:
    """A screen of one kind of activity, which adds what is to be seen.

    Its ``drawing``, "module:function", takes the screen and a size in pixels, and returns a
    `minihuman.display.drawing.sheet.Sheet`. Without a ``page_view`` the page shows that drawing.
    """

    drawing: ClassVar[str]
    page_view: ClassVar[PageView | None] = None
    accepts_text: ClassVar[bool] = False
    accepts_pointer: ClassVar[bool] = False
    locale: TextLocale


@dataclass(frozen=True, slots=True, eq=False)
class FilmsScreen(ActivityScreen, abc.ABC):
    """A screen of films, of which one picture each is seen at a time; the page has the others before they are."""

    @property
    @abc.abstractmethod
    def films(self) -> tuple[Sequence[NDArray[np.uint8]], ...]:
        """The films, side by side; each picture is drawn when it is asked for."""

    @property
    @abc.abstractmethod
    def shown_step(self) -> int:
        """The index of the pictures that are seen; of a shorter film the last one stands."""

    @property
    @abc.abstractmethod
    def identity(self) -> tuple[object, ...]:
        """The parts of the screen that tell it from another one, whatever its step."""


Screen = TextScreen | BlankScreen | PlayScreen | PageScreen | QuestionScreen | ActivityScreen


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
