"""Inputs: everything that can reach a session from outside. Times are ns on the session's monotonic clock."""

from dataclasses import dataclass
from typing import Literal

PressCause = Literal[
    "finger",  # or what stands for one: a screen reader's click, a simulated participant
    "held_before_focus",  # it was down before this window had the focus
    "shortcut",  # of the system or the browser: Ctrl, Alt or Meta was down
]
KeyReleaseCause = Literal["finger", "focus_loss"]  # "focus_loss": the window lost the keyboard with the key down
PointerCause = Literal["finger", "held_before_focus", "cancelled"]  # "cancelled": a release that no finger made


@dataclass(frozen=True, slots=True)
class TimedInput:
    """Anything that reaches a session, with its time."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class KeyDown(TimedInput):
    """A key went down. ``key`` is our physical name; ``symbol`` what the toolkit says it types, "" if unknown."""

    key: str
    symbol: str = ""
    repeat: bool = False  # the system's auto-repeat, not a finger
    cause: PressCause = "finger"


@dataclass(frozen=True, slots=True)
class KeyUp(TimedInput):
    """A key came up."""

    key: str
    symbol: str = ""
    cause: KeyReleaseCause = "finger"


@dataclass(frozen=True, slots=True)
class TextInput(TimedInput):
    """The input method or the keyboard's layout made text; only while the screen wants text."""

    text: str


@dataclass(frozen=True, slots=True)
class PointerInput(TimedInput):
    """A mouse or a finger at (x, y), 0..1 of the drawn picture from its top left corner; in play, of the world's.

    ``target`` names the spot in which it went down ("option:2", "slider", "go_on"; "" for none).
    """

    x: float
    y: float
    target: str = ""
    along: float = 0.0  # 0..1 from the spot's start, in reading direction
    cause: PointerCause = "finger"


class PointerPressed(PointerInput):
    """A button or a finger went down."""

    __slots__ = ()


class PointerMoved(PointerInput):
    """The pointer moved while down."""

    __slots__ = ()


class PointerReleased(PointerInput):
    """The button or the finger came up."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class AxisChanged(TimedInput):
    """An axis of a gamepad is at another place: -1 to 1, 0 in its dead zone."""

    axis: str
    value: float


@dataclass(frozen=True, slots=True)
class Tick(TimedInput):
    """Time passed. The session asks for ticks through ``Session.next_tick_ns``."""


@dataclass(frozen=True, slots=True)
class ScreenShown(TimedInput):
    """The screen of ``Session.screen`` reached the display: handed over at submit, returned from the flip at flip.

    ``step`` says which step's picture it was, where that may be another than the latest: a browser shows a picture
    before the session knows of the key, and tells of it when the next key may be there already.
    """

    submit_ns: int
    flip_ns: int
    step: int | None = None  # None: the latest


@dataclass(frozen=True, slots=True)
class FocusChanged(TimedInput):
    """The window lost or found the keyboard."""

    focused: bool


@dataclass(frozen=True, slots=True)
class Stop(TimedInput):
    """The session must end now: the window was closed, a signal came, the disk is full, the world broke."""

    reason: Literal[
        "window_closed",
        "signal",
        "timed_out",
        "connection_lost",
        "disk_full",
        "world_error",
        "player_failed",
        "internal_error",
    ]
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ExperimenterCommand(TimedInput):
    """The experimenter asks for something, from their desk."""

    command: Literal["pause", "go_on", "abort", "note"]
    text: str = ""  # the note, or why


@dataclass(frozen=True, slots=True)
class ActivityInput(TimedInput):
    """Something that only the part that runs has a use for; a kind of activity adds what it says."""


Input = (
    KeyDown
    | KeyUp
    | TextInput
    | PointerInput
    | AxisChanged
    | Tick
    | ScreenShown
    | FocusChanged
    | ExperimenterCommand
    | ActivityInput
    | Stop
)
