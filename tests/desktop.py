"""A desktop: an X server with a window manager (openbox), and what people do with windows there."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from Xlib import X
from Xlib.display import Display
from Xlib.error import BadWindow
from Xlib.protocol import event

from tests.machine import need
from tests.programs import running, stop
from tests.xserver import xvfb

_PATIENCE_S = 30.0
_ICONIC = 3  # ICCCM 4.1.4


@contextmanager
def desktop() -> Iterator["Desktop"]:
    """Run an X server with a window manager on it."""
    program = need("openbox")
    with (
        xvfb() as name,
        running([program], env={**os.environ, "DISPLAY": name}, stderr=subprocess.DEVNULL) as manager,
    ):
        desk = Desktop(name)
        yield desk
        desk.close()
        stop(manager)


class Desktop:
    """Asks the window manager, as a task bar or a shortcut would, and looks at the whole screen."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._display = Display(name)
        self._root = self._display.screen().root
        self._wait_for(lambda: self._root.get_full_property(self._atom("_NET_SUPPORTING_WM_CHECK"), X.AnyPropertyType))

    def close(self) -> None:
        self._display.close()

    def picture(self) -> NDArray[np.uint8]:
        """The whole screen, uint8[H, W, 3]."""
        shape = self._root.get_geometry()
        raw = self._root.get_image(0, 0, shape.width, shape.height, X.ZPixmap, 0xFFFFFFFF).data
        return np.frombuffer(raw, np.uint8).reshape(shape.height, shape.width, 4)[..., 2::-1]

    def inside(self, title: str) -> NDArray[np.uint8]:
        """What the screen shows where the window of that title is."""
        window = self._window(title)
        shape, place = window.get_geometry(), window.translate_coords(self._root, 0, 0)
        return self.picture()[-place.y : -place.y + shape.height, -place.x : -place.x + shape.width]

    def minimise(self, title: str) -> None:
        self._tell(title, "WM_CHANGE_STATE", _ICONIC)

    def restore(self, title: str) -> None:
        self._window(title).map()
        self._tell(title, "_NET_ACTIVE_WINDOW", 2, X.CurrentTime)

    def move(self, title: str, x: int, y: int) -> None:
        self._window(title).configure(x=x, y=y)
        self._display.sync()

    def resize(self, title: str, width: int, height: int) -> None:
        self._window(title).configure(width=width, height=height)
        self._display.sync()

    def full_screen(self, title: str, wanted: bool) -> None:
        self._tell(title, "_NET_WM_STATE", int(wanted), self._atom("_NET_WM_STATE_FULLSCREEN"))

    @contextmanager
    def covered(self) -> Iterator[None]:
        """Put a white window over everything for a while."""
        shape = self._root.get_geometry()
        over = self._root.create_window(
            0, 0, shape.width, shape.height, 0, X.CopyFromParent, override_redirect=1, background_pixel=0xFFFFFF
        )
        over.map()
        self._display.sync()
        yield
        over.destroy()
        self._display.sync()

    def _tell(self, title: str, message: str, *data: int) -> None:
        self._tell_of(self._window(title), message, *data)

    def minimise_window(self, number: int) -> None:
        """Minimise the window that has this number with the X server."""
        self._tell_of(self._display.create_resource_object("window", number), "WM_CHANGE_STATE", _ICONIC)

    def restore_window(self, number: int) -> None:
        window = self._display.create_resource_object("window", number)
        window.map()
        self._tell_of(window, "_NET_ACTIVE_WINDOW", 2, X.CurrentTime)

    def _tell_of(self, window, message: str, *data: int) -> None:
        values = (32, [*data, *(0 for _ in range(5 - len(data)))])
        told = event.ClientMessage(window=window, client_type=self._atom(message), data=values)
        self._root.send_event(told, event_mask=X.SubstructureRedirectMask | X.SubstructureNotifyMask)
        self._display.sync()

    def find(self, part_of_title: str) -> int:
        """Return the X server's number of the window with these words in its title, which may change."""
        return self._wait_for(
            lambda: [window.id for window in self._managed() if part_of_title in self._title(window)]
        )[0]

    def _window(self, title: str):
        found = self._wait_for(lambda: [window for window in self._managed() if self._title(window) == title])
        return found[0]

    def _managed(self):
        listed = self._root.get_full_property(self._atom("_NET_CLIENT_LIST"), X.AnyPropertyType)
        return [self._display.create_resource_object("window", number) for number in (listed.value if listed else ())]

    def _title(self, window) -> str:
        try:
            return str(window.get_full_text_property(self._atom("_NET_WM_NAME")) or window.get_wm_name())
        except BadWindow:  # it went while the list was read
            return ""

    def _atom(self, name: str) -> int:
        return int(self._display.intern_atom(name))

    def _wait_for(self, look):
        deadline_s = time.monotonic() + _PATIENCE_S
        while not (found := look()):
            assert time.monotonic() < deadline_s, f"nothing came for {_PATIENCE_S:.0f} s"
            time.sleep(0.02)
        return found
