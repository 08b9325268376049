"""Inputs: everything that can reach a session from outside. Times are ns on the session's monotonic clock."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class KeyDown:
    """A key went down. ``key`` is our physical name; ``symbol`` what the toolkit says it types, "" if unknown."""

    t_ns: int
    key: str
    symbol: str = ""
    repeat: bool = False  # the system's auto-repeat, not a finger


@dataclass(frozen=True, slots=True)
class KeyUp:
    """A key came up."""

    t_ns: int
    key: str
    symbol: str = ""


@dataclass(frozen=True, slots=True)
class Typed:
    """The input method or the keyboard's layout made text; only while the screen wants text."""

    t_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class PointerPressed:
    """A mouse button or a finger went down at (x, y), 0..1 of the drawn picture from its top left corner.

    ``target`` names the spot that was hit ("option:2", "slider", "go_on"; "" for none), ``along`` where inside it.
    """

    t_ns: int
    x: float
    y: float
    target: str = ""
    along: float = 0.0  # 0..1 from the spot's start, as text runs


@dataclass(frozen=True, slots=True)
class PointerMoved:
    """The pointer moved with a button down; ``target`` is the spot in which it went down."""

    t_ns: int
    x: float
    y: float
    target: str = ""
    along: float = 0.0


@dataclass(frozen=True, slots=True)
class PointerReleased:
    """The button or the finger came up; ``target`` is the spot in which it went down."""

    t_ns: int
    x: float
    y: float
    target: str = ""
    along: float = 0.0


@dataclass(frozen=True, slots=True)
class Tick:
    """Time passed. The session asks for ticks through ``Session.next_tick_ns``."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class Shown:
    """The screen of ``Session.screen`` reached the display: handed over at submit, returned from the flip at flip.

    ``step`` says which step's picture it was, where that may be another than the latest: a browser shows a picture
    before the session knows of the key, and tells of it when the next key may be there already.
    """

    t_ns: int
    submit_ns: int
    flip_ns: int
    step: int | None = None  # None: the latest


@dataclass(frozen=True, slots=True)
class FocusChanged:
    """The window lost or found the keyboard."""

    t_ns: int
    focused: bool


@dataclass(frozen=True, slots=True)
class Stop:
    """The session must end now: the window was closed, a signal came, the disk is full, the world broke."""

    t_ns: int
    reason: Literal[
        "window_closed", "signal", "timed_out", "connection_lost", "disk_full", "world_error", "internal_error"
    ]
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Asked:
    """The experimenter asks for something, from their desk."""

    t_ns: int
    what: Literal["pause", "go_on", "abort", "note"]
    text: str = ""  # the note, or why


@dataclass(frozen=True, slots=True)
class ForPart:
    """Something that only the part that runs has a use for; a kind of activity adds what it says."""

    t_ns: int


Pointer = PointerPressed | PointerMoved | PointerReleased
Input = KeyDown | KeyUp | Typed | Pointer | Tick | Shown | FocusChanged | Asked | ForPart | Stop
