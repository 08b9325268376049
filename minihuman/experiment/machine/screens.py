"""Screens: what a participant should see now, as values that windows and pages draw."""

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
    """The language and writing direction of a screen's texts."""

    language: str = "en"
    rtl: bool = False  # from right to left
    fonts: tuple[str, ...] = ()  # files of faces that are asked first
    theme: str = "dark"  # or "light": light words on a dark ground, or dark on light


@dataclass(frozen=True, slots=True)
class Button:
    """A button to click; ``name`` is the target of the pointer's inputs."""

    name: str
    label: str
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class PictureLabel:
    """A label in a picture at (x, y), each 0 to 1 of the picture from its top left corner."""

    x: float
    y: float
    label: str


@dataclass(frozen=True, slots=True)
class TextScreen:
    """A screen of a short text: ready, feedback, rest, pause, questions about the session, the end."""

    accepts_text: ClassVar[bool] = False
    accepts_pointer: ClassVar[bool] = False
    title: str
    body: str
    prompt: str  # what to press to go on, "" when nothing does
    progress: str = ""  # "episode 3 of 10"
    keys: tuple[tuple[str, bool], ...] = ()  # keyboard check: key name, already pressed
    locale: TextLocale = TextLocale()
    labels: tuple[tuple[str, str, str], ...] = ()  # key name, what its cap says, what stands above it
    waits: bool = False  # for something that comes by itself: a partner, an agent that learns


@dataclass(frozen=True, slots=True)
class BlankScreen:
    """An empty screen, or a fixation cross."""

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
    """The screen of play: the world's picture, the mission above and the progress line below; target "picture"."""

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
    axes: tuple[str, ...] = ()  # of the mouse, which is captured for them, and of sticks that a page draws
    motion: Motion | None = None  # how the view gets here; windows may leave it out
    page_fields: Mapping[str, Any] = field(default_factory=dict)  # what its kind of block adds for a page


@dataclass(frozen=True, slots=True, eq=False)
class PageScreen:
    """A screen of one page of a text, with an optional picture above it."""

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
    """A list of options of which one or several can be selected; targets are "option:0", "option:1", ..."""

    options: tuple[str, ...]
    chosen: tuple[int, ...]
    cursor: int  # the option that the keyboard is at
    many: bool = False


@dataclass(frozen=True, slots=True)
class RatingScale:
    """A row of points with labels at the ends or at each point; targets are "option:0", "option:1", ..."""

    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: int | None


@dataclass(frozen=True, slots=True)
class RatingMatrix:
    """A list of statements rated on the same scale; targets are "option:0", "option:1", ..., row by row."""

    rows: tuple[str, ...]
    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: tuple[int | None, ...]  # by row
    cursor: int  # the row that the keyboard is at


@dataclass(frozen=True, slots=True)
class Slider:
    """A line with a movable thumb; the target is "slider"."""

    low: str
    high: str
    position: float | None  # 0..1; None: not set yet
    value: str  # "" where it is not to be shown
    ticks: int  # intervals drawn


@dataclass(frozen=True, slots=True)
class TextField:
    """A field to type in; the target is "field".

    A window has a field of its own for a native one: it alone knows caret and selection, and reports whole texts. For
    any other, the session edits the text by keys, as sessions did that began under the first text rules.
    """

    text: str
    caret: int  # characters before it
    long: bool
    unit: str = ""
    native: bool = False
    name: str = ""  # the item's name; "" where nothing tells two fields apart
    longest: int = 0  # characters; 0: no limit
    limit_note: str = ""  # what is said about a text that is longer


@dataclass(frozen=True, slots=True)
class CanvasShape:
    """A box or an ellipse on a `ShapeCanvas`; lengths are 0 to 1 of the canvas, from its top left corner."""

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
    """A canvas of shapes, later ones in front, for questions of a plug-in's kind that no other widget can show."""

    shapes: tuple[CanvasShape, ...]
    aspect: float = 1.0  # width by height


AnswerWidget = OptionList | RatingScale | RatingMatrix | Slider | TextField | ShapeCanvas


@dataclass(frozen=True, slots=True)
class QuestionScreen:
    """A screen of one question and its answer so far."""

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
        """Return whether the screen accepts text from the input method."""
        return isinstance(self.item, TextField)


@dataclass(frozen=True, slots=True)
class PageView:
    """The view of a kind's own screen in a browser's page.

    Args:
        name: the name by which style sheets refer to the view.
        values: "module:function"; the function takes the screen and a function that numbers pictures, and returns JSON
            values.
        module: "package:file", a JavaScript module in the kind's folder. Its function ``draw`` takes those values, the
            message that contained them and the page's tools, and returns the elements of the screen.
    """

    name: str
    values: str
    module: str


@dataclass(frozen=True, slots=True, eq=False)
class ActivityScreen:
    """A screen of one kind of activity, which adds fields for its content.

    Its ``drawing``, "module:function", takes the screen and a size in pixels, and returns a
    `minihuman.display.drawing.sheet.Sheet`. Without a ``page_view`` the page shows that drawing.
    """

    drawing: ClassVar[str]
    page_view: ClassVar[PageView | None] = None
    accepts_text: ClassVar[bool] = False
    accepts_pointer: ClassVar[bool] = False
    locale: TextLocale

    @property
    def due_ns(self) -> int | None:
        """When the screen is to be on the display, in session time; None: as soon as it is drawn."""
        return None


@dataclass(frozen=True, slots=True, eq=False)
class FilmsScreen(ActivityScreen, abc.ABC):
    """A screen that shows one picture at a time of each of its films; the page receives later pictures in advance."""

    @property
    @abc.abstractmethod
    def films(self) -> tuple[Sequence[NDArray[np.uint8]], ...]:
        """Return the films, side by side; each picture is drawn when it is read."""

    @property
    @abc.abstractmethod
    def shown_step(self) -> int:
        """Return the index of the pictures that are shown; a shorter film keeps its last picture."""

    @property
    @abc.abstractmethod
    def identity(self) -> tuple[object, ...]:
        """Return the values that distinguish the screen from others, whatever its step."""


Screen = TextScreen | BlankScreen | PlayScreen | PageScreen | QuestionScreen | ActivityScreen


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
