"""The motion of a captured mouse in a pyglet window on X11, from the X server's own events.

pyglet itself moves the pointer back to the window's middle at each event and ignores events there, so that it loses
motion that ends in the middle. Importing this module opens no display.
"""

from collections.abc import Callable
from typing import Any

Position = tuple[int, int]

_FAR = 4  # the pointer is moved back once it is farther from the middle than 1 / _FAR of the window's size


class MouseTracker:
    """Converts the pointer's positions to motions, and moves the pointer back to the middle before it reaches an edge.

    Args:
        warp: moves the pointer to a position in the window, and returns the number of the request that does so.
        size_px: returns the window's width and height.
    """

    def __init__(self, warp: Callable[[int, int], int], size_px: Callable[[], Position]) -> None:
        self._warp = warp
        self._size_px = size_px
        self._position: Position | None = None  # where the pointer was; None before the first event
        self._middle: Position = (0, 0)
        self._warp_serial: int | None = None  # of a request whose event has not come
        self.is_tracking = False

    def begin(self) -> None:
        """Move the pointer to the window's middle, and count motion from there."""
        self.is_tracking = True
        self._position = None
        self._centre_pointer()

    def end(self) -> None:
        """Stop counting motion; the pointer stays where it is."""
        self.is_tracking = False

    def _centre_pointer(self) -> None:
        width, height = self._size_px()
        self._middle = (width // 2, height // 2)
        self._warp_serial = self._warp(*self._middle)

    def follow(self, position: Position, serial: int) -> Position:
        """Return by how many pixels the mouse moved to the right and down since the last event.

        Args:
            position: the pointer's position that an event reports, from the window's top left corner.
            serial: the number of the last request that the server had handled at the event.
        """
        was_centred = self._warp_serial is not None and serial >= self._warp_serial
        if self._position is None and not was_centred:
            return 0, 0  # an event from before tracking began
        before = self._position
        if was_centred and (before is None or position == self._middle):
            before = self._middle
            self._warp_serial = None
        assert before is not None
        self._position = position
        width, height = self._size_px()
        x, y = position
        middle_x, middle_y = self._middle
        is_far = abs(x - middle_x) > width // _FAR or abs(y - middle_y) > height // _FAR
        if is_far and self._warp_serial is None:
            self._centre_pointer()
        return x - before[0], y - before[1]


def make_tracker(xlib: Any, display: Any, window: int, size_px: Callable[[], Position]) -> MouseTracker:
    """Return a tracker of the pointer in a window of an X server.

    Args:
        xlib: pyglet's bindings of Xlib.
        display: pyglet's connection to the server.
        window: the server's number of the window.
        size_px: returns the window's width and height.
    """

    def warp(x: int, y: int) -> int:
        serial = int(xlib.XNextRequest(display))
        xlib.XWarpPointer(display, 0, window, 0, 0, 0, 0, x, y)
        xlib.XFlush(display)
        return serial

    return MouseTracker(warp, size_px)
