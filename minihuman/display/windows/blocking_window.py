"""The common part of windows on a real display, and the opening of a window by name.

Common to all toolkits are waiting for input until a deadline, auto-repeat of held keys on the session's clock (the same
on every toolkit and desktop), and the picture of a screen. Laboratories can register windows in the entry-point group
``minihuman.windows``.
"""

import abc
import unicodedata
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.screen import (
    compose_screen,
    find_spot,
    locate_in_picture,
    measure_along_spot,
    picture_size_px,
    repaint_screen,
)
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.desk_field import Clipboard, DeskField, OwnClipboard
from minihuman.display.windows.mouse_motion import MouseMotion
from minihuman.display.windows.window import Clock, Window
from minihuman.errors import WindowError
from minihuman.experiment.keys import MOUSE_AXES
from minihuman.experiment.machine.inputs import (
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerCause,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    PressCause,
    ScreenShown,
    TextInput,
)
from minihuman.experiment.machine.screens import ActivityScreen, PlayScreen, Screen, TextScreen
from minihuman.plugins import call_plugin, list_plugin_names

REPEAT_DELAY_NS = 500_000_000  # as on most desktops: after half a second, a key repeats 30 times a second
REPEAT_PERIOD_NS = 33_000_000


@dataclass(slots=True)
class _RepeatingKey:
    key: str
    symbol: str
    due_ns: int


class KeyRepeater:
    """Converts a toolkit's key events into presses, releases and repeats.

    The system's own auto-repeat, a press of a key that is already down, is dropped, since toolkits disagree on whether
    and how to report it. The key that was pressed last repeats until it is released or the window loses the focus.
    """

    def __init__(self) -> None:
        self._down: dict[str, str] = {}  # key -> symbol, the latest last
        self._repeating: _RepeatingKey | None = None

    def is_down(self, key: str) -> bool:
        """Return whether a key is down, so that another press of it is the system's auto-repeat."""
        return key in self._down

    def press(self, t_ns: int, key: str, symbol: str, cause: PressCause = "finger") -> list[KeyDown]:
        """Return the press of a key; [] if the key is already down. Only a press with the cause "finger" repeats."""
        if key in self._down:
            return []
        self._down[key] = symbol
        if cause == "finger":
            self._repeating = _RepeatingKey(key, symbol, t_ns + REPEAT_DELAY_NS)
        else:
            self._repeating = None
        return [KeyDown(t_ns, key, symbol, cause=cause)]

    def release(self, t_ns: int, key: str, symbol: str) -> list[KeyDown | KeyUp]:
        """Return the release of a key, after a press "held_before_focus" if the window never saw the press."""
        if self._repeating and self._repeating.key == key:
            self._repeating = None
        if self._down.pop(key, None) is None:  # 1 ns apart, since no two key events have the same time
            return [KeyDown(t_ns, key, symbol, cause="held_before_focus"), KeyUp(t_ns + 1, key, symbol)]
        return [KeyUp(t_ns, key, symbol)]

    def release_all(self, t_ns: int) -> list[KeyUp]:
        """Return a release of each key that is down, 1 ns apart, since a window without the focus sees no releases."""
        self._repeating = None
        keys = self._down
        self._down = {}
        return [
            KeyUp(t_ns + index, key, symbol, cause="focus_loss") for index, (key, symbol) in enumerate(keys.items())
        ]

    @property
    def next_repeat_ns(self) -> int | None:
        """The time in nanoseconds of the held key's next repeat; None if no key repeats."""
        if self._repeating is None:
            return None
        return self._repeating.due_ns

    def repeats(self, now_ns: int) -> list[KeyDown]:
        """Return the repeat that is due, [] if none is; a late loop gets one repeat instead of all that it missed."""
        repeating = self._repeating
        if repeating is None or now_ns < repeating.due_ns:
            return []
        is_late = now_ns - repeating.due_ns >= REPEAT_PERIOD_NS
        if is_late:
            repeating.due_ns = now_ns
        repeating.due_ns += REPEAT_PERIOD_NS
        return [KeyDown(now_ns, repeating.key, repeating.symbol, repeat=True)]


DEFAULT_SIZE_PX: Size = (1280, 720)
TITLE = "minihuman"
_FLIPS = 9  # the latest flips, from which the duration of the next one is estimated
_FRAME_NS = 16_666_667  # at 60 Hz: a view that moves is drawn for the next frame
_LONG_AGO_NS = -(1 << 62)  # before every event


class BlockingWindow(Window):
    """A window whose toolkit can wait for input.

    A subclass implements this class's abstract methods, and ``facts`` and ``close`` of `Window`.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._repeater = KeyRepeater()
        self._focused = False
        self._screen: Screen | None = None
        self._frame = np.zeros((0, 0, 3), np.uint8)  # what the display shows
        self._last_key_ns = _LONG_AGO_NS
        self._accepts = (False, False)  # text, pointer
        self._mouse_axes: tuple[str, ...] = ()  # for which the mouse is captured
        self._mouse_motion = MouseMotion()
        self._moving: PlayScreen | None = None  # the screen whose view is still moving
        self._moves_from_ns = 0
        self._pointer_at = (0.0, 0.0)  # where it was last while the button was down
        self._pressed_in: str | None = None  # the spot in which a mouse button is down
        self._flip_times_ns: deque[int] = deque(maxlen=_FLIPS)  # durations of flips of activities' own screens
        self._awaits_flip = False  # whether a frame is drawn but not due yet
        self._early_inputs: list[Input] = []  # inputs that arrived before it was due
        self._field = DeskField(self._open_clipboard())

    @property
    @abc.abstractmethod
    def size_px(self) -> Size:
        """The width and height of the drawn picture."""

    @abc.abstractmethod
    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        """Bring a frame uint8[H, W, 3] of the window's size to the display; return once it is displayed.

        Outside the box ``changed``, the frame is the same as at the last call.
        """

    @abc.abstractmethod
    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        """Wait until inputs arrive or the time is up (None: no limit); return the inputs with their times.

        The list can be empty before the time is up.
        """

    @abc.abstractmethod
    def _want(self, *, text: bool, pointer: bool) -> None:
        """Turn text input and the pointer on or off; while one is off, the toolkit does not report its events."""

    def _capture_mouse(self, captured: bool) -> None:
        """Hide the pointer and keep it in the window, so that only the mouse's motion counts; or release it again.

        Raises:
            WindowError: if the window's toolkit cannot do so.
        """
        raise WindowError(f"a {type(self).__name__} captures no mouse, which the protocol needs; use --window pygame")

    @abc.abstractmethod
    def post_key(self, key: str) -> None:
        """Put a press and a release of a key into the toolkit's queue, to measure delays; any thread can call this."""

    def _open_clipboard(self) -> Clipboard:
        """Return the system's clipboard, or one inside this window if the toolkit does not reach the system's."""
        return OwnClipboard()

    @property
    def picture_px(self) -> Size:
        """The width and height in pixels of the largest picture of a world that fits the window."""
        return picture_size_px(self.size_px)

    def show(self, screen: Screen) -> ScreenShown:
        """Draw and display a screen; return the times at which it was submitted and the flip returned."""
        return self.show_after(screen, lambda: None)

    def show_after(self, screen: Screen, await_log: Callable[[], None]) -> ScreenShown:
        """Draw a screen, wait until ``await_log`` returns, and display the screen; return its times.

        A moving screen continues to move while the window waits for input.

        Raises:
            LogError: if ``await_log`` raises it; the display does not change then.
        """
        if isinstance(screen, PlayScreen) and screen.motion:
            self._moving = screen
        else:
            self._moving = None
        self._moves_from_ns = self._clock()
        if self._moving is not None:
            return self._draw_and_flip(self._draw_motion(self._moving), await_log)
        return self._draw_and_flip(self._field.open(screen), await_log)

    def _draw_motion(self, moving: PlayScreen) -> PlayScreen:
        """Return a moving screen as it looks one frame from now; if the motion is over then, end it."""
        assert moving.motion is not None
        share = (self._clock() + _FRAME_NS - self._moves_from_ns) / moving.motion.lasts_ns
        if share < 1:
            return replace(moving, picture=moving.motion.draw(share), motion=None)
        self._moving = None
        return moving

    def _draw_and_flip(self, screen: Screen, await_log: Callable[[], None]) -> ScreenShown:
        """Draw a screen, wait until its events are in the log, and display it; return its times.

        Before that, accept the kinds of input that the screen takes, and capture the mouse or give it back.
        """
        width, height = self.size_px
        if self._frame.shape[:2] != (height, width):
            self._screen = None
            self._frame = np.empty((height, width, 3), np.uint8)
        changed = repaint_screen(self._frame, self._screen, screen)
        self._screen = screen
        if self._accepts != (screen.accepts_text, screen.accepts_pointer):
            self._accepts = (screen.accepts_text, screen.accepts_pointer)
            self._pressed_in = None
            self._want(text=screen.accepts_text, pointer=screen.accepts_pointer)
        axes = screen.axes if isinstance(screen, PlayScreen) else ()
        mouse_axes = tuple(axis for axis in axes if axis in MOUSE_AXES)
        if self._mouse_axes != mouse_axes:
            self._mouse_axes = mouse_axes
            self._mouse_motion.forget()
            self._capture_mouse(bool(mouse_axes))
        try:
            await_log()
        except BaseException:
            self._screen = None  # never shown: the next is drawn anew
            self._frame = self._frame[:0]
            raise
        if isinstance(screen, ActivityScreen) and screen.due_ns is not None:
            self._await_flip(screen.due_ns)
        submit_ns = self._clock()
        self._flip(self._frame, changed)
        flip_ns = self._clock()
        if isinstance(screen, ActivityScreen):
            self._flip_times_ns.append(flip_ns - submit_ns)
        return ScreenShown(t_ns=flip_ns, submit_ns=submit_ns, flip_ns=flip_ns)

    def _await_flip(self, due_ns: int) -> None:
        """Wait until a frame must be handed to the display to appear there at ``due_ns``; keep inputs for `wait`.

        A flip that waits for the display's refresh shows the frame at the next one, so handing it over half a period
        early leads to the refresh nearest to ``due_ns``. Other flips are taken to last as long as the latest ones.
        """
        lead_ns = self.refresh_period_ns // 2
        if not lead_ns and self._flip_times_ns:
            lead_ns = sorted(self._flip_times_ns)[len(self._flip_times_ns) // 2]
        hand_over_ns = due_ns - lead_ns
        while (remaining_ns := hand_over_ns - self._clock()) > 0:
            self._awaits_flip = True
            self._early_inputs += self._arrived(remaining_ns)
        self._awaits_flip = False

    @cached_property
    def refresh_period_ns(self) -> int:
        """The time between two refreshes of a display for which flips wait; 0 if they return at once."""
        facts = self.facts()
        try:
            refresh_hz = float(facts.get("refresh_hz_reported", ""))
        except ValueError:
            return 0
        if facts.get("vsync") != "on" or refresh_hz <= 0:
            return 0
        return round(1e9 / refresh_hz)

    def _repaint(self) -> None:
        """Display the whole current screen again, after it was covered or the window's size changed."""
        if self._screen is None or self._awaits_flip:  # a screen that is not due yet must not be seen
            return
        width, height = self.size_px
        self._frame = compose_screen(self._screen, (width, height))
        self._flip(self._frame, (0, 0, width, height))

    def wait(self, until_ns: int | None) -> list[Input]:
        """Wait until inputs arrive or the clock reaches ``until_ns``, and return the inputs, [] if there are none."""
        if self._early_inputs:
            arrived = self._early_inputs
            self._early_inputs = []
            return arrived
        while True:
            if self._field.has_waiting and (waiting := self._edit_field(())):
                return waiting
            due_times = (until_ns, self._repeater.next_repeat_ns, self._field.due_ns, self._mouse_motion.due_ns)
            due_ns = min((t for t in due_times if t is not None), default=None)
            timeout_ns = None
            if due_ns is not None:
                timeout_ns = max(0, due_ns - self._clock())
            if self._moving is not None:
                timeout_ns = _FRAME_NS // 2
            arrived = self._edit_field(self._arrived(timeout_ns))
            if arrived:
                return arrived
            if self._moving is not None:
                self._draw_and_flip(self._draw_motion(self._moving), lambda: None)
            now_ns = self._clock()
            is_over = until_ns is not None and now_ns >= until_ns
            if due_inputs := self._list_due(now_ns, is_over=is_over):
                return due_inputs
            if is_over:
                return []

    def _list_due(self, now_ns: int, *, is_over: bool) -> list[Input]:
        """Return the inputs that are due at a time: a key's repeat, a field's text, or the mouse's motion.

        If the wait for inputs ends (``is_over``), motion is returned even if it is not due yet.
        """
        if repeats := self._edit_field(self._repeater.repeats(now_ns)):
            return repeats
        if self._field.due_ns is not None and now_ns >= self._field.due_ns:
            return self._field.report_text(now_ns)
        return self._mouse_motion.report(now_ns, is_needed=is_over)

    def _edit_field(self, arrived: Sequence[Input]) -> list[Input]:
        """Apply inputs to the field on the screen, and show the field; return the inputs that are for the session."""
        remaining = self._field.apply_inputs(arrived, self.size_px)
        if not self._field.is_active:
            return remaining
        view = self._field.show_current()
        if view != self._screen:
            self._draw_and_flip(view, lambda: None)
        return remaining

    def _key(self, down: bool, key: str, symbol: str, t_ns: int, cause: PressCause = "finger") -> list[Input]:
        """Convert a key event to inputs, at least a nanosecond later than the previous key event."""
        t_ns = max(t_ns, self._last_key_ns + 1)
        if down:
            return self._note_key_times(self._repeater.press(t_ns, key, symbol, cause))
        return self._note_key_times(self._repeater.release(t_ns, key, symbol))

    def _note_key_times(self, inputs: Sequence[KeyDown | KeyUp]) -> list[Input]:
        """Record the time of the last of some key inputs, and return them as a list of inputs."""
        if inputs:
            self._last_key_ns = inputs[-1].t_ns
        return [*inputs]

    def _find_held_keys(self) -> Sequence[str]:
        """Return the keys that were down when the window got the focus; none if the toolkit cannot know."""
        return ()

    def _typed(self, text: str) -> list[Input]:
        """Convert typed text to inputs, without control characters, which arrive as keys.

        A field that the window edits keeps joiners and no-break spaces, which are text, too.
        """
        if self._field.is_active:
            printable = "".join(letter for letter in text if unicodedata.category(letter) != "Cc")
        else:
            printable = "".join(letter for letter in text if letter.isprintable())
        if printable and self._accepts[0]:
            return [TextInput(self._clock(), printable)]
        return []

    def _convert_button(
        self,
        kind: type[PointerPressed | PointerMoved | PointerReleased],
        x: float,
        y: float,
        t_ns: int,
        cause: PointerCause = "finger",
    ) -> list[Input]:
        """Convert an event of the main mouse button to inputs; [] if the screen has no use for it.

        The point (x, y) is in shares of the screen's width and height, from its top left corner.
        """
        _, accepts_pointer = self._accepts
        if not accepts_pointer or self._screen is None:
            return []
        is_press = kind is PointerPressed
        is_button_down = self._pressed_in is not None
        if is_press == is_button_down:  # a second press, or a move or release whose press was not seen
            return []
        if isinstance(self._screen, PlayScreen):
            return self._convert_press_in_world(self._screen, kind, x, y, t_ns, cause)
        if self._pressed_in is None:
            target, along = find_spot(self._screen, self.size_px, x, y)
        else:
            target = self._pressed_in
            along = measure_along_spot(self._screen, self.size_px, self._pressed_in, x)
        self._pressed_in = None if kind is PointerReleased else target
        self._pointer_at = (x, y)
        return [kind(t_ns, x, y, target, along, cause)]

    def _convert_press_in_world(
        self,
        screen: PlayScreen,
        kind: type[PointerPressed | PointerMoved | PointerReleased],
        x: float,
        y: float,
        t_ns: int,
        cause: PointerCause,
    ) -> list[Input]:
        """Convert an event of the main mouse button while a world is shown: only presses in its picture are inputs."""
        if kind is not PointerMoved:  # a release ends a press that began on an earlier screen
            self._pressed_in = None
        position = locate_in_picture(screen, self.size_px, x, y)
        if kind is not PointerPressed or position is None:
            return []
        return [kind(t_ns, *position, "picture", cause=cause)]

    def _move_mouse(self, right_px: int, down_px: int, t_ns: int) -> list[Input]:
        """Convert a motion of the captured mouse, in pixels, to inputs of the screen's axes; [] without the focus."""
        if not self._focused:
            return []
        motion_px = {"mouse_x": right_px, "mouse_y": down_px}
        return self._mouse_motion.add({axis: motion_px[axis] for axis in self._mouse_axes}, t_ns)

    def _focus(self, t_ns: int, focused: bool) -> list[Input]:
        """Convert a focus event to inputs; repeated events of the same kind are ignored."""
        if focused == self._focused:
            return []
        self._focused = focused
        self._mouse_motion.forget()
        if focused:
            presses = [self._key(True, key, "", t_ns, "held_before_focus") for key in self._find_held_keys()]
            return [FocusChanged(t_ns, True), *chain.from_iterable(presses)]
        released = self._note_key_times(self._repeater.release_all(max(t_ns, self._last_key_ns + 1)))
        if self._pressed_in is not None:
            released += self._convert_button(PointerReleased, *self._pointer_at, t_ns, "cancelled")
        return [*released, FocusChanged(t_ns, False)]


WINDOW_GROUP = "minihuman.windows"
AUTO_WINDOW = "auto"
_OPENING = TextScreen("", "One moment, please.", "")  # shown while worlds and the log are prepared, for 1 or 2 s
_FIRST_CHOICE = ("pygame", "pyglet")  # pygame identifies keys by position on every system


def list_windows() -> tuple[str, ...]:
    """Return the names of the registered windows, in the order in which "auto" tries them."""
    installed = set(list_plugin_names(WINDOW_GROUP))
    first = tuple(name for name in _FIRST_CHOICE if name in installed)
    return first + tuple(sorted(installed.difference(first)))


def open_window(name: str, clock: Clock, *, fullscreen: bool = False, size_px: Size = DEFAULT_SIZE_PX) -> Window:
    """Open the window with a name; "auto" opens the first window that works.

    Raises:
        WindowError: if the name is unknown, or no window can be opened here.
    """
    if name != AUTO_WINDOW:
        return _open(name, clock, fullscreen=fullscreen, size_px=size_px)
    refusals = []
    for candidate in list_windows():
        try:
            return _open(candidate, clock, fullscreen=fullscreen, size_px=size_px)
        except WindowError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]
    raise WindowError(
        f"no window is registered under {WINDOW_GROUP!r}; "
        "reinstall minihuman with `pip install --force-reinstall .` in its folder"
    )


def _open(name: str, clock: Clock, *, fullscreen: bool, size_px: Size) -> Window:
    """Open the window with a name, and show that it is opening; raise WindowError if it is unknown or cannot open."""
    if name not in list_windows():
        raise WindowError(f"unknown window {name!r}; use one of {', '.join((AUTO_WINDOW, *list_windows()))}")
    window = call_plugin(
        WINDOW_GROUP,
        name,
        Window,  # type: ignore[type-abstract]
        WindowError,
        clock,
        noun="window",
        fullscreen=fullscreen,
        size_px=size_px,
    )
    window.show(_OPENING)
    return window
