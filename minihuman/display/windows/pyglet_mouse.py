"""The motion of a captured mouse in a pyglet window on X11, from the X server's own events.

pyglet itself puts the pointer back to the window's middle at each event, and drops a motion that ends there, which
loses some motion of a hand that shakes. Importing this module opens no display.
"""

from collections.abc import Callable
from typing import Any

Place = tuple[int, int]

_FAR = 4  # the pointer is put back once it is further from the middle than 1 / _FAR of the window's size


class MouseTracker:
    """Converts the pointer's places to motions, and puts it back to the window's middle before it reaches an edge.

    Args:
        warp: puts the pointer to a place in the window, and returns the number of the request that does so.
        size_px: returns the window's width and height.
    """

    def __init__(self, warp: Callable[[int, int], int], size_px: Callable[[], Place]) -> None:
        self._warp = warp
        self._size_px = size_px
        self._place: Place | None = None  # where the pointer was; None before the first event
        self._middle: Place = (0, 0)
        self._warp_serial: int | None = None  # of a request whose event has not come
        self.is_tracking = False

    def begin(self) -> None:
        """Put the pointer to the middle, and count motion from there."""
        self.is_tracking = True
        self._place = None
        self._put_back()

    def end(self) -> None:
        """Leave the pointer where it is."""
        self.is_tracking = False

    def _put_back(self) -> None:
        width, height = self._size_px()
        self._middle = (width // 2, height // 2)
        self._warp_serial = self._warp(*self._middle)

    def follow(self, place: Place, serial: int) -> Place:
        """Return by how many pixels the mouse was moved to the right and down, given the place that an event reports.

        Args:
            place: the pointer's place in the window, from its top left corner.
            serial: the number of the last request that the server had handled.
        """
        is_put_back = self._warp_serial is not None and serial >= self._warp_serial
        if self._place is None and not is_put_back:
            return 0, 0  # an event from before tracking began
        before = self._place
        if is_put_back and (before is None or place == self._middle):
            before = self._middle
            self._warp_serial = None
        assert before is not None
        self._place = place
        width, height = self._size_px()
        is_far = abs(place[0] - self._middle[0]) > width // _FAR or abs(place[1] - self._middle[1]) > height // _FAR
        if is_far and self._warp_serial is None:
            self._put_back()
        return place[0] - before[0], place[1] - before[1]


def make_tracker(xlib: Any, display: Any, window: int, size_px: Callable[[], Place]) -> MouseTracker:
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
