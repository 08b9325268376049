"""What windows on a real display have in common: a deadline to block until, auto-repeat, the picture of a screen."""

import abc
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from minihuman.study.inputs import FocusChanged, Input, PointerMoved, PointerPressed, PointerReleased, Shown, Typed
from minihuman.study.screens import Screen
from minihuman.windows.compose import Box, Size, along_spot, compose, picture_size_px, repaint, spot_at
from minihuman.windows.held import HeldKeys
from minihuman.windows.port import Clock, Window

DEFAULT_SIZE_PX: Size = (1280, 720)
TITLE = "minihuman"


class BlockingWindow(Window):
    """A window whose toolkit can block for input; a toolkit adds three methods and the port's last two."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._held = HeldKeys()
        self._focused = False
        self._shown: Screen | None = None
        self._frame = np.zeros((0, 0, 3), np.uint8)  # what the display shows
        self._last_key_ns = -(1 << 62)
        self._wanted = (False, False)  # text, pointer
        self._pressed_in: str | None = None  # the spot in which a mouse button is down

    @property
    @abc.abstractmethod
    def size_px(self) -> Size:
        """Width and height of what is drawn."""

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
        """Turn the input method on or off, show or hide the pointer; text and pointer are told of only while wanted."""

    @abc.abstractmethod
    def post_key(self, key: str) -> None:
        """Put a press and a release of a key into the toolkit's queue; from any thread, to measure with."""

    @property
    def picture_px(self) -> Size:
        """The largest picture of a world there is room for."""
        return picture_size_px(self.size_px)

    def show(self, screen: Screen) -> Shown:
        """Draw a screen, flip, and say when it was submitted and when the flip returned."""
        return self.show_after(screen, lambda: None)

    def show_after(self, screen: Screen, written: Callable[[], None]) -> Shown:
        """Draw a screen, wait for ``written``, and flip.

        Raises:
            LogError: as ``written`` does; the display stays as it is.
        """
        width, height = self.size_px
        if self._frame.shape[:2] != (height, width):
            self._shown, self._frame = None, np.empty((height, width, 3), np.uint8)
        changed = repaint(self._frame, self._shown, screen)
        self._shown = screen
        if self._wanted != (screen.wants_text, screen.wants_pointer):
            self._wanted, self._pressed_in = (screen.wants_text, screen.wants_pointer), None
            self._want(text=screen.wants_text, pointer=screen.wants_pointer)
        try:
            written()
        except BaseException:
            self._shown, self._frame = (
                None,
                self._frame[:0],
            )  # what was drawn is not what is shown: the next is drawn anew
            raise
        submit_ns = self._clock()
        self._flip(self._frame, changed)
        flip_ns = self._clock()
        return Shown(t_ns=flip_ns, submit_ns=submit_ns, flip_ns=flip_ns)

    def _repaint(self) -> None:
        """Bring what is shown to the display once more, all of it: it was covered, or the window has another size."""
        if self._shown is None:
            return
        width, height = self.size_px
        self._frame = compose(self._shown, (width, height))
        self._flip(self._frame, (0, 0, width, height))

    def wait(self, until_ns: int | None) -> list[Input]:
        """Block until an input comes or the clock reaches ``until_ns``; what has arrived is returned even so."""
        while True:
            due_ns = min((t for t in (until_ns, self._held.next_repeat_ns) if t is not None), default=None)
            arrived = self._arrived(None if due_ns is None else max(0, due_ns - self._clock()))
            if arrived:
                return arrived
            now_ns = self._clock()
            if repeats := self._held.repeats(now_ns):
                return list(repeats)
            if until_ns is not None and now_ns >= until_ns:
                return []

    def _key(self, down: bool, key: str, symbol: str, t_ns: int) -> list[Input]:
        """What a word about a key amounts to. Its stamp is after that of the key before, by a nanosecond at least."""
        t_ns = self._last_key_ns = max(t_ns, self._last_key_ns + 1)
        return [*(self._held.press if down else self._held.release)(t_ns, key, symbol)]

    def _typed(self, text: str) -> list[Input]:
        """What a word about text amounts to: control characters are keys, and told of as such."""
        said = "".join(letter for letter in text if letter.isprintable())
        return [Typed(self._clock(), said)] if said and self._wanted[0] else []

    def _pointer(self, kind: type[PointerPressed | PointerMoved | PointerReleased], x: float, y: float) -> list[Input]:
        """What a word about the main mouse button amounts to, at (x, y), 0..1 of the picture from its top left."""
        if not self._wanted[1] or self._shown is None or (kind is PointerPressed) != (self._pressed_in is None):
            return []
        if self._pressed_in is None:
            target, along = spot_at(self._shown, self.size_px, x, y)
        else:
            target, along = self._pressed_in, along_spot(self._shown, self.size_px, self._pressed_in, x)
        self._pressed_in = None if kind is PointerReleased else target
        return [kind(self._clock(), x, y, target, along)]

    def _focus(self, t_ns: int, focused: bool) -> list[Input]:
        """What a word about the focus amounts to: toolkits say the same thing twice, and "lost" before any was had."""
        if focused == self._focused:
            return []
        self._focused = focused
        if not focused:
            self._held.forget()
        return [FocusChanged(t_ns, focused)]
