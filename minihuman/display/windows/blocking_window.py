"""Windows on a real display: what they have in common, and how one is opened by name.

Common are blocking until a deadline, auto-repeat made from held keys on the session's clock (the same on every toolkit
and desktop), and the picture of a screen. Labs register windows in the entry-point group ``minihuman.windows``.
"""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from minihuman.display.windows.window import Clock, Window
from minihuman.errors import WindowError
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
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.plugins import call_plugin, list_plugin_names

REPEAT_DELAY_NS = 500_000_000  # the usual desktop's: half a second, then 30 a second
REPEAT_PERIOD_NS = 33_000_000


@dataclass(slots=True)
class _RepeatingKey:
    key: str
    symbol: str
    due_ns: int


class KeyRepeater:
    """Turns what a toolkit says about keys into presses, releases and repeats.

    The system's own auto-repeat is a press of a key that is down already; it is dropped, since toolkits disagree on
    whether and how to show it. The key pressed last repeats until it, or the focus, goes.
    """

    def __init__(self) -> None:
        self._down: dict[str, str] = {}  # key -> symbol, the latest last
        self._repeating: _RepeatingKey | None = None

    def is_down(self, key: str) -> bool:
        """Whether a key is down, so that another press of it is the system's auto-repeat."""
        return key in self._down

    def press(self, t_ns: int, key: str, symbol: str, cause: PressCause = "finger") -> list[KeyDown]:
        """Press a key; [] if it is down already. What no finger pressed here repeats nothing."""
        if key in self._down:
            return []
        self._down[key] = symbol
        if cause == "finger":
            self._repeating = _RepeatingKey(key, symbol, t_ns + REPEAT_DELAY_NS)
        else:
            self._repeating = None
        return [KeyDown(t_ns, key, symbol, cause=cause)]

    def release(self, t_ns: int, key: str, symbol: str) -> list[KeyDown | KeyUp]:
        """Release a key; where its press was never seen, it was down before the focus, and that is said first."""
        if self._repeating and self._repeating.key == key:
            self._repeating = None
        if self._down.pop(key, None) is None:
            return [KeyDown(t_ns, key, symbol, cause="held_before_focus"), KeyUp(t_ns + 1, key, symbol)]
        return [KeyUp(t_ns, key, symbol)]

    def release_all(self, t_ns: int) -> list[KeyUp]:
        """Release every key as the focus goes: the release itself goes to another window."""
        self._repeating = None
        keys = self._down
        self._down = {}
        return [
            KeyUp(t_ns + place, key, symbol, cause="focus_loss") for place, (key, symbol) in enumerate(keys.items())
        ]

    @property
    def next_repeat_ns(self) -> int | None:
        """Return when the held key repeats next; None: no key is held."""
        if self._repeating is None:
            return None
        return self._repeating.due_ns

    def repeats(self, now_ns: int) -> list[KeyDown]:
        """Return the repeat that is due, if one is. A loop that came late gets one, not all that it missed."""
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
_FRAME_NS = 16_666_667  # at 60 Hz: a view that moves is drawn for the next frame


class BlockingWindow(Window):
    """A window whose toolkit can block for input; a toolkit adds three methods and the port's last two."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._repeater = KeyRepeater()
        self._focused = False
        self._screen: Screen | None = None
        self._frame = np.zeros((0, 0, 3), np.uint8)  # what the display shows
        self._last_key_ns = -(1 << 62)
        self._accepts = (False, False)  # text, pointer
        self._moving: PlayScreen | None = None  # whose view is still on its way
        self._moves_from_ns = 0
        self._pointer_at = (0.0, 0.0)  # where it was last while the button was down
        self._pressed_in: str | None = None  # the spot in which a mouse button is down

    @property
    @abc.abstractmethod
    def size_px(self) -> Size:
        """Return width and height of what is drawn."""

    @abc.abstractmethod
    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        """Bring uint8[H, W, 3] of the window's size to the display; return when it is there.

        Outside the box ``changed`` the frame is as it was at the last call.
        """

    @abc.abstractmethod
    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        """Block until something comes or time is up (None: for ever), and say what came, stamped; [] is no promise."""

    @abc.abstractmethod
    def _want(self, *, text: bool, pointer: bool) -> None:
        """Turn the input method on or off, show or hide the pointer; inputs come only while wanted."""

    @abc.abstractmethod
    def post_key(self, key: str) -> None:
        """Put a press and a release of a key into the toolkit's queue; from any thread, to measure with."""

    @property
    def picture_px(self) -> Size:
        """Return the largest picture of a world there is room for."""
        return picture_size_px(self.size_px)

    def show(self, screen: Screen) -> ScreenShown:
        """Draw a screen, flip, and say when it was submitted and when the flip returned."""
        return self.show_after(screen, lambda: None)

    def show_after(self, screen: Screen, await_log: Callable[[], None]) -> ScreenShown:
        """Draw a screen, wait for ``await_log``, and flip. One that moves goes on while the window waits for input.

        Raises:
            LogError: as ``await_log`` does; the display stays as it is.
        """
        if isinstance(screen, PlayScreen) and screen.motion:
            self._moving = screen
        else:
            self._moving = None
        self._moves_from_ns = self._clock()
        if self._moving is not None:
            return self._put(self._on_its_way(self._moving), await_log)
        return self._put(screen, await_log)

    def _on_its_way(self, moving: PlayScreen) -> PlayScreen:
        """Return a moving screen as it will be a frame from now; at the end, the screen itself."""
        assert moving.motion is not None
        share = (self._clock() + _FRAME_NS - self._moves_from_ns) / moving.motion.lasts_ns
        if share < 1:
            return replace(moving, picture=moving.motion.draw(share), motion=None)
        self._moving = None
        return moving

    def _put(self, screen: Screen, await_log: Callable[[], None]) -> ScreenShown:
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
        try:
            await_log()
        except BaseException:
            self._screen = None  # never shown: the next is drawn anew
            self._frame = self._frame[:0]
            raise
        submit_ns = self._clock()
        self._flip(self._frame, changed)
        flip_ns = self._clock()
        return ScreenShown(t_ns=flip_ns, submit_ns=submit_ns, flip_ns=flip_ns)

    def _repaint(self) -> None:
        """Bring what is shown to the display once more, all of it: it was covered, or the window has another size."""
        if self._screen is None:
            return
        width, height = self.size_px
        self._frame = compose_screen(self._screen, (width, height))
        self._flip(self._frame, (0, 0, width, height))

    def wait(self, until_ns: int | None) -> list[Input]:
        """Block until an input comes or the clock reaches ``until_ns``; what has arrived is returned even so."""
        while True:
            due_ns = min((t for t in (until_ns, self._repeater.next_repeat_ns) if t is not None), default=None)
            timeout_ns = None
            if due_ns is not None:
                timeout_ns = max(0, due_ns - self._clock())
            if self._moving is not None:
                timeout_ns = _FRAME_NS // 2
            arrived = self._arrived(timeout_ns)
            if arrived:
                return arrived
            if self._moving is not None:
                self._put(self._on_its_way(self._moving), lambda: None)
            now_ns = self._clock()
            if repeats := self._repeater.repeats(now_ns):
                return list(repeats)
            if until_ns is not None and now_ns >= until_ns:
                return []

    def _key(self, down: bool, key: str, symbol: str, t_ns: int, cause: PressCause = "finger") -> list[Input]:
        """Convert a key event to inputs. Its time is at least a nanosecond after that of the key before."""
        t_ns = max(t_ns, self._last_key_ns + 1)
        if down:
            return self._ordered(self._repeater.press(t_ns, key, symbol, cause))
        return self._ordered(self._repeater.release(t_ns, key, symbol))

    def _ordered(self, inputs: Sequence[KeyDown | KeyUp]) -> list[Input]:
        """Take note of the last key's time."""
        if inputs:
            self._last_key_ns = inputs[-1].t_ns
        return [*inputs]

    def _find_held_keys(self) -> Sequence[str]:
        """Find the keys that were down when the window got the focus; none where the toolkit cannot know."""
        return ()

    def _typed(self, text: str) -> list[Input]:
        """Convert typed text to inputs; control characters come as keys."""
        printable = "".join(letter for letter in text if letter.isprintable())
        if printable and self._accepts[0]:
            return [TextInput(self._clock(), printable)]
        return []

    def _pointer(
        self,
        kind: type[PointerPressed | PointerMoved | PointerReleased],
        x: float,
        y: float,
        t_ns: int,
        cause: PointerCause = "finger",
    ) -> list[Input]:
        """Convert an event of the main mouse button at (x, y), 0..1 of the picture from its top left."""
        if not self._accepts[1] or self._screen is None or (kind is PointerPressed) != (self._pressed_in is None):
            return []
        if isinstance(self._screen, PlayScreen):
            inside = locate_in_picture(self._screen, self.size_px, x, y)
            if kind is not PointerMoved:  # a press that led here is over
                self._pressed_in = None
            if kind is PointerPressed and inside:
                return [kind(t_ns, *inside, "picture", cause=cause)]
            return []
        if self._pressed_in is None:
            target, along = find_spot(self._screen, self.size_px, x, y)
        else:
            target = self._pressed_in
            along = measure_along_spot(self._screen, self.size_px, self._pressed_in, x)
        self._pressed_in = target
        if kind is PointerReleased:
            self._pressed_in = None
        self._pointer_at = (x, y)
        return [kind(t_ns, x, y, target, along, cause)]

    def _focus(self, t_ns: int, focused: bool) -> list[Input]:
        """Convert a focus event; toolkits repeat themselves, and report a loss before any gain."""
        if focused == self._focused:
            return []
        self._focused = focused
        if focused:
            presses = [self._key(True, key, "", t_ns, "held_before_focus") for key in self._find_held_keys()]
            return [FocusChanged(t_ns, True), *chain.from_iterable(presses)]
        released = self._ordered(self._repeater.release_all(max(t_ns, self._last_key_ns + 1)))
        if self._pressed_in is not None:
            released += self._pointer(PointerReleased, *self._pointer_at, t_ns, "cancelled")
        return [*released, FocusChanged(t_ns, False)]


WINDOW_GROUP = "minihuman.windows"
AUTO_WINDOW = "auto"
_OPENING = TextScreen("", "One moment, please.", "")  # worlds and log take a second or two to get ready
_FIRST_CHOICE = ("pygame", "pyglet")  # pygame knows every key by position, on every system


def list_windows() -> tuple[str, ...]:
    """List what can be asked for beside "auto", in the order in which auto tries them."""
    installed = set(list_plugin_names(WINDOW_GROUP))
    first = tuple(name for name in _FIRST_CHOICE if name in installed)
    return first + tuple(sorted(installed.difference(first)))


def open_window(name: str, clock: Clock, *, fullscreen: bool = False, size_px: Size = DEFAULT_SIZE_PX) -> Window:
    """Open a window by name; "auto" takes the first that opens.

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
