"""Screens: what a participant should see now, as values that windows and pages draw."""

import abc
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
    fonts: tuple[str, ...] = ()  # font files that are used before the built-in ones
    theme: str = "dark"  # "dark" for light text on a dark ground, or "light" for the opposite


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
    prompt: str  # which key leads on; "" if none does
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
    mark: OutcomeMark = ""  # how the episode ended, while its last picture is held
    score_text: str = ""  # the points that the episode earned, beside the mark
    labels: tuple[tuple[str, str, str], ...] = ()  # key name, what its cap says, what stands above it
    controller: ControlIndicator = ""  # who is in control, shown by a coloured frame; "" if no agent plays
    controller_text: str = ""  # the same as text
    flash: OutcomeMark = ""  # colours the frame for a moment after a rating
    accepts_pointer: bool = False  # whether a click in the picture is an action
    axes: tuple[str, ...] = ()  # axes of the mouse, which is captured for them, and of sticks that a page draws
    motion: Motion | None = None  # the movement of the view to this picture, which windows may leave out
    page_fields: Mapping[str, Any] = field(default_factory=dict)  # fields that the block's kind adds for a page


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
    progress: str = ""  # "Page 1 of 3"; "" if there is only one page
    picture: NDArray[np.uint8] | None = None  # uint8[H, W, 3]
    marks: tuple[PictureLabel, ...] = ()  # in the picture
    locale: TextLocale = TextLocale()


_MAX_DIGIT_KEY = 9  # options beyond it have no key of their own


class Widget(abc.ABC):
    """The answer controls of a question."""

    __slots__ = ()

    @property
    @abc.abstractmethod
    def description(self) -> str:
        """Return a text of the answers that the widget offers, for screen readers and language models."""

    def list_likely_inputs(self) -> Iterator[str]:
        """Yield the names of likely inputs, such as "key:1" or "point:option:0", likeliest first; none by default.

        A page receives the screens to which these inputs lead before the inputs happen.
        """
        yield from ()


def _number_lines(texts: Iterable[str]) -> str:
    """Return texts as lines that are numbered from 1."""
    return "\n".join(f"{number}. {text}" for number, text in enumerate(texts, 1))


def _append_end_texts(lines: str, low: str, high: str) -> str:
    """Return the numbered points of a scale as lines, followed by the texts at the scale's low and high end."""
    ends = f"{low} ... {high}"
    return f"{lines.strip()}\n\n{ends.strip()}"


def _list_option_inputs(count: int) -> Iterator[str]:
    """Yield the inputs that choose an option by its digit key or by a click, for the options that have a digit key."""
    for number in range(min(_MAX_DIGIT_KEY, count)):
        yield f"key:{number + 1}"
        yield f"point:option:{number}"


@dataclass(frozen=True, slots=True)
class OptionList(Widget):
    """A list of options of which one or several can be selected; targets are "option:0", "option:1", ..."""

    options: tuple[str, ...]
    chosen: tuple[int, ...]
    cursor: int  # the option that the keyboard is at
    many: bool = False

    @property
    def description(self) -> str:
        """Return the options, numbered from 1."""
        return _number_lines(self.options)

    def list_likely_inputs(self) -> Iterator[str]:
        """Yield the inputs that choose an option, and those that move the cursor."""
        yield from _list_option_inputs(len(self.options))
        yield from ("key:down", "key:up")


@dataclass(frozen=True, slots=True)
class RatingScale(Widget):
    """A row of points with labels at the ends or at each point; targets are "option:0", "option:1", ..."""

    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: int | None

    @property
    def description(self) -> str:
        """Return the points, numbered from 1, and the texts at the ends."""
        return _append_end_texts(_number_lines(self.points), self.low, self.high)

    def list_likely_inputs(self) -> Iterator[str]:
        """Yield the inputs that choose a point, and those that move to the next."""
        yield from _list_option_inputs(len(self.points))
        yield from ("key:right", "key:left")


@dataclass(frozen=True, slots=True)
class RatingMatrix(Widget):
    """A list of statements rated on the same scale; targets are "option:0", "option:1", ..., row by row."""

    rows: tuple[str, ...]
    points: tuple[str, ...]  # what each point says
    low: str
    high: str
    chosen: tuple[int | None, ...]  # by row
    cursor: int  # the row that the keyboard is at

    @property
    def description(self) -> str:
        """Return the points of each statement, numbered from 1 row by row, and the texts at the ends."""
        cells = [f"{row}: {point}" for row in self.rows for point in self.points]
        return _append_end_texts(_number_lines(cells), self.low, self.high)


@dataclass(frozen=True, slots=True)
class Slider(Widget):
    """A line with a movable thumb; the target is "slider"."""

    low: str
    high: str
    position: float | None  # 0..1; None: not set yet
    value: str  # "" where it is not to be shown
    ticks: int  # intervals drawn

    @property
    def description(self) -> str:
        """Return the texts at the two ends."""
        return f"{self.low} ... {self.high}"


@dataclass(frozen=True, slots=True)
class TextField(Widget):
    """A field to type in; the target is "field".

    For a ``native`` field the window uses a field of its own, which has caret and selection and reports whole texts.
    Otherwise the session edits the text by keys, as under the first text rules.
    """

    text: str
    caret: int  # characters before it
    long: bool
    unit: str = ""
    native: bool = False
    name: str = ""  # the item's name; "" if the field needs none
    longest: int = 0  # the largest number of characters; 0 for no limit
    limit_note: str = ""  # the note that is shown for a longer text

    @property
    def description(self) -> str:
        """Return the unit of what is typed; "" if it has none."""
        return self.unit


@dataclass(frozen=True, slots=True)
class CanvasShape:
    """A box or an ellipse on a `ShapeCanvas`; lengths are 0 to 1 of the canvas, from its top left corner.

    A shape with a target needs a label or an accessible name: without either, a screen reader says the target, and a
    language model reads an empty line.
    """

    x: float
    y: float
    width: float
    height: float
    label: str = ""
    target: str = ""  # "" if it cannot be clicked
    chosen: bool = False
    is_round: bool = False
    fill: str = ""  # a colour, "#rrggbb", which it keeps when chosen; "" for the theme's colour
    accessible_name: str = ""  # what screen readers and language models call it; "": its label
    has_box: bool = True  # False: its label alone, such as a caption, without a line around it

    def __post_init__(self) -> None:
        if self.fill and not _HEX_COLOUR.fullmatch(self.fill):
            raise ValueError(f"fill is {self.fill!r}; write a colour as '#aa3311'")

    @property
    def description(self) -> str:
        """Return the shape's name and, if it has a colour of its own, the colour."""
        return " ".join(filter(None, [self.accessible_name or self.label, self.fill]))


@dataclass(frozen=True, slots=True)
class ShapeCanvas(Widget):
    """A canvas of shapes, later ones in front, for questions that no other widget can show.

    In a window it is at most 1.16 times the screen's height wide, and 0.31 of the height high, or 0.51 if it is tall.
    In a page it is half of the window's height, at most 24 rem (384 px), and lower where that would be too wide.
    """

    shapes: tuple[CanvasShape, ...]
    aspect: float = 1.0  # width by height
    is_tall: bool = False  # the question above it then has room for two lines instead of six

    @property
    def description(self) -> str:
        """Return the shapes that can be clicked, numbered from 1."""
        return _number_lines(shape.description for shape in self.shapes if shape.target)

    def list_likely_inputs(self) -> Iterator[str]:
        """Yield a click on each shape that can be clicked."""
        yield from (f"point:{shape.target}" for shape in self.shapes if shape.target)


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
    note: str = ""  # why the answer is not accepted yet
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
        """Return the session time at which the screen is to be displayed; None for as soon as it is drawn."""
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
        """Return the index, in each film, of the picture that is shown; a shorter film keeps its last picture."""

    @property
    @abc.abstractmethod
    def identity(self) -> tuple[object, ...]:
        """Return the values that distinguish the screen from others; they do not depend on `shown_step`."""


Screen = TextScreen | BlankScreen | PlayScreen | PageScreen | QuestionScreen | ActivityScreen


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
