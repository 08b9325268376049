"""Inputs: everything that can reach a session from outside. Times are nanoseconds on the session's monotonic clock."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

# The fact "text_rules" of a session: a field's whole text is the answer as it is. Before, keys edited and trimmed it.
TEXT_RULES = "2"
# The fact "trial_rules" of a session: a pause that voids a trial is logged, and so is a sound that is reported when its
# trial should be over. Before, only the trial's end was logged.
TRIAL_RULES = "2"
# The fact "message_rules": as "text_rules", for messages to partners, which keys edited in later versions, too.
MESSAGE_RULES = "2"

PressCause = Literal[
    "finger",  # or a substitute, such as a screen reader's click or a simulated participant
    "held_before_focus",  # it was down before this window had the focus
    "shortcut",  # of the system or the browser: Ctrl, Alt or Meta was down
]
KeyReleaseCause = Literal["finger", "focus_loss"]  # "focus_loss": the window lost the keyboard with the key down
PointerCause = Literal["finger", "held_before_focus", "cancelled"]  # "cancelled": a release that no finger made


@dataclass(frozen=True, slots=True)
class TimedInput:
    """An input to a session, with its time."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class KeyDown(TimedInput):
    """A key went down.

    ``key`` is this package's name of the physical key; ``symbol`` is what it types according to the window toolkit, ""
    if unknown.
    """

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
    """The input method or the keyboard layout produced text; sent only while the screen accepts text."""

    text: str


MAX_FIELD_CHARACTERS = 4000  # of a text in a field, which a page sends in one message
TextChange = Literal[
    "typed",  # by the keyboard: inserted or deleted
    "pasted",
    "dropped",  # dragged into the field
    "composed",  # by an input method
    "replaced",  # by the browser's or the system's spelling correction
    "undone",  # or redone
    "script",  # by a program: a spelling extension, a dictation tool
]


@dataclass(frozen=True, slots=True)
class TextEdited(TimedInput):
    """The text in a field settled: its whole text after changes that began at ``began_ns``."""

    text: str
    changes: tuple[TextChange, ...] = ()  # how it was changed, each way once, in the order of `TextChange`
    keys: int = 0  # pressed in the field since the last input of this type
    began_ns: int = 0  # 0: at ``t_ns``
    field: str = ""  # the field's name, as the session may show another by now; "" for the field that it shows


@dataclass(frozen=True, slots=True)
class PointerInput(TimedInput):
    """A mouse or finger at (x, y), each 0 to 1 of the drawn picture from its top left corner.

    In play, the picture is the world's. ``target`` names the target in which the pointer went down ("option:2",
    "slider", "go_on"; "" for none).
    """

    x: float
    y: float
    target: str = ""
    along: float = 0.0  # 0 to 1 from the target's start, in reading direction
    cause: PointerCause = "finger"


class PointerPressed(PointerInput):
    """A mouse button was pressed or a finger touched the screen."""

    __slots__ = ()


class PointerMoved(PointerInput):
    """The pointer moved while down."""

    __slots__ = ()


class PointerReleased(PointerInput):
    """The mouse button or the finger was lifted."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class AxisChanged(TimedInput):
    """A gamepad axis moved to another value, -1 to 1, 0 in its dead zone, or the mouse moved by a number of pixels."""

    axis: str
    value: float


@dataclass(frozen=True, slots=True)
class Tick(TimedInput):
    """Time passed. The session requests ticks through ``SessionMachine.next_tick_ns``."""


@dataclass(frozen=True, slots=True)
class ScreenShown(TimedInput):
    """The screen of ``SessionMachine.screen`` reached the display.

    It was handed over at ``submit_ns`` and shown by the flip at ``flip_ns``. ``step`` is the step that the picture
    shows, if that may not be the latest: a browser shows a picture before the session receives the key that caused it,
    and reports the picture when a further key may already have arrived.
    """

    submit_ns: int
    flip_ns: int
    step: int | None = None  # None for the latest step


@dataclass(frozen=True, slots=True)
class FocusChanged(TimedInput):
    """The window lost or gained the keyboard focus."""

    focused: bool


@dataclass(frozen=True, slots=True)
class Stop(TimedInput):
    """The session must end now: the window was closed, a signal arrived, the disk is full, or the world failed.

    A server gives ``aborted`` for a page that sent more than its session can need.
    """

    reason: Literal[
        "aborted",
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
    """The experimenter sent a command."""

    command: Literal["pause", "go_on", "abort", "note"]
    text: str = ""  # the note, or the reason


@dataclass(frozen=True, slots=True)
class ActivityInput(TimedInput):
    """An input that only the running part handles; kinds of activity add fields."""


@dataclass(frozen=True, slots=True)
class SoundStarted(ActivityInput):
    """A sound of ``Activity.sound_cues`` began.

    The device was told to begin it at ``scheduled_ns``, and reports that it began at ``onset_ns``. Apart from a
    constant delay, 99 % of these onsets have an error below ``uncertainty_ns``.
    """

    cue: int
    scheduled_ns: int
    onset_ns: int
    uncertainty_ns: int


Input = (
    KeyDown
    | KeyUp
    | TextInput
    | TextEdited
    | PointerInput
    | AxisChanged
    | Tick
    | ScreenShown
    | FocusChanged
    | ExperimenterCommand
    | ActivityInput
    | Stop
)


_PRECEDING = (Stop, ScreenShown, TextInput, TextEdited, PointerInput)


def precedes_due_changes(happened: Input, facts: Mapping[str, str]) -> bool:
    """Return whether an input is processed before everything that is due by its time, rather than after it.

    Most inputs that are processed before it report something that has already happened, such as the display of a screen
    or the start of a sound.

    Args:
        happened: the input.
        facts: the facts of `SessionStarted`, which include "trial_rules", the version of the rules for trials.
    """
    if isinstance(happened, SoundStarted):
        return facts.get("trial_rules", "1") == TRIAL_RULES
    return isinstance(happened, _PRECEDING)
