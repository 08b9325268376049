"""The window in pyglet 1.5 or 2, which identifies keys by position on X11 and by symbol on other systems."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.blocking_window import DEFAULT_SIZE_PX, TITLE, BlockingWindow
from minihuman.display.windows.window import Clock
from minihuman.display.windows.x11_input import (
    MAIN_BUTTON,
    ON_RECEIPT,
    SERVER_TIME,
    X11InputRecord,
    convert_server_time,
)
from minihuman.errors import WindowError
from minihuman.experiment.machine.inputs import (
    Input,
    PointerCause,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    PressCause,
    Stop,
)

if TYPE_CHECKING:
    from minihuman.display.windows.pyglet_native import PygletNativeWindow


_MAIN_BUTTON_BIT = 1  # of the main mouse button, in pyglet's number of the buttons that are down


class PygletWindow(BlockingWindow):
    """A pyglet window, or a full screen.

    Args:
        clock: the clock that stamps inputs and flips
        fullscreen: whether to use the full screen, which determines the size
        size_px: the width and height of a window, which is at most as large as the screen

    Raises:
        WindowError: if there is no display, or no display with OpenGL 3.
    """

    def __init__(self, clock: Clock, *, fullscreen: bool = False, size_px: Size = DEFAULT_SIZE_PX) -> None:
        super().__init__(clock)
        self._inputs: list[Input] = []
        self._to_repaint = False
        self._native: PygletNativeWindow | None = _open_native_window(fullscreen=fullscreen, size_px=size_px)
        self._record = _open_record(clock, self._native.x11_window)
        self._has_server_time = self._record is not None
        self._native.push_handlers(
            on_key=self._on_key,
            on_activate=lambda: self._on_focus(True),
            on_deactivate=lambda: self._on_focus(False),
            on_close=self._on_close,
            on_text=self._on_text,
            on_mouse_press=lambda x, y, button, modifiers: self._on_pointer(PointerPressed, x, y, button),
            on_captured_motion=self._on_motion,
            on_mouse_drag=lambda x, y, dx, dy, buttons, modifiers: self._on_pointer(PointerMoved, x, y, buttons),
            on_mouse_release=lambda x, y, button, modifiers: self._on_pointer(PointerReleased, x, y, button),
            on_expose=self._repaint_soon,
            on_show=self._repaint_soon,
            on_resize=lambda width, height: self._repaint_soon(),
        )
        if self._record is not None and self._record.is_focused:
            self._on_focus(True)  # pyglet's event came while the window opened, before there were handlers

    @property
    def _window(self) -> "PygletNativeWindow":
        if self._native is None:
            raise WindowError("the window is closed; open a new one")
        return self._native

    @property
    def size_px(self) -> Size:
        """The width and height of the drawn picture."""
        width, height = self._window.get_framebuffer_size()
        return int(width), int(height)

    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        self._window.present(frame, changed)

    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        """Wait for events of pyglet until the time is up (None: no limit), and return the inputs that they meant."""
        import pyglet

        if not self._inputs:
            timeout_s = None
            if timeout_ns is not None:
                timeout_s = timeout_ns * 1e-9
            pyglet.app.platform_event_loop.step(timeout_s)
        if self._to_repaint:
            self._to_repaint = False
            self._repaint()
        arrived = self._inputs
        self._inputs = []
        return arrived

    def _on_key(self, down: bool, key: str, symbol: str, server_ms: int | None, is_shortcut: bool) -> None:
        """Add the inputs of a key event.

        The cause of a press is "held_before_focus" if it was not made in this window, or else "shortcut" or "finger".
        """
        t_ns = self._convert_time(server_ms)
        if not down:
            self._inputs += self._key(False, key, symbol, t_ns)
        elif not self._repeater.is_down(key):  # else it is the system's auto-repeat
            cause: PressCause = "finger"
            if is_shortcut:
                cause = "shortcut"
            if not self._is_press_in_window(key, server_ms):
                cause = "held_before_focus"
            self._inputs += self._key(True, key, symbol, t_ns, cause)

    def _is_press_in_window(self, name: str, server_ms: int | None) -> bool:
        """Return whether a press was made in this window; True if the X server does not report it."""
        if self._record is None or server_ms is None:
            return True
        return self._record.is_press_in_window(name, server_ms)

    def _find_held_keys(self) -> Sequence[str]:
        if self._record:
            return self._record.find_held_keys()
        return ()

    def _convert_time(self, server_ms: int | None) -> int:
        """Return the session time of an event that the X server stamped; the present time if there is no stamp."""
        if server_ms is None or not self._has_server_time:
            return self._clock()
        return convert_server_time(server_ms, self._clock)

    def _on_text(self, text: str) -> None:
        self._inputs += self._typed(text)

    def _on_pointer(
        self, kind: type[PointerPressed | PointerMoved | PointerReleased], x: int, y: int, buttons: int
    ) -> None:
        """Add the inputs of an event of the main mouse button; x and y are in pixels from the lower left corner."""
        if buttons & _MAIN_BUTTON_BIT:
            width, height = self._window.get_size()
            button_ms = self._window.button_ms
            if kind is PointerMoved:
                button_ms = None
            cause: PointerCause = "finger"
            if kind is PointerPressed and not self._is_press_in_window(MAIN_BUTTON, button_ms):
                cause = "held_before_focus"
            share_x = (x + 0.5) / width
            share_y = 1 - (y + 0.5) / height  # pyglet counts y from the bottom
            self._inputs += self._convert_button(kind, share_x, share_y, self._convert_time(button_ms), cause)

    def _on_motion(self, right_px: int, down_px: int, server_ms: int | None) -> None:
        if self._mouse_axes:
            self._inputs += self._move_mouse(right_px, down_px, self._convert_time(server_ms))

    def _want(self, *, text: bool, pointer: bool) -> None:
        """Turn pyglet's events of typed text on or off, and show or hide the pointer."""
        self._window.accepts_text = text
        self._window.set_mouse_visible(pointer)

    def _capture_mouse(self, captured: bool) -> None:
        self._window.capture_mouse(captured)

    def _on_focus(self, focused: bool) -> None:
        if self._mouse_axes:
            self._window.track_mouse(focused)
        self._inputs += self._focus(self._clock(), focused)

    def _repaint_soon(self) -> None:
        self._to_repaint = True

    def _on_close(self) -> bool:
        self._inputs.append(Stop(self._clock(), "window_closed"))
        return True  # handled: pyglet is not to close it itself

    def post_key(self, key: str) -> None:
        """Put a press and a release of a key into pyglet's queue; any thread can call this."""
        import pyglet

        for down in (True, False):  # without a symbol or a time of the server, and not as a shortcut
            pyglet.app.platform_event_loop.post_event(self._window, "on_key", down, key, "", None, False)

    def facts(self) -> dict[str, str]:
        """Return facts for the log: toolkit, version, size, vsync, refresh rate, and how keys are timed and named."""
        import pyglet

        from minihuman.display.windows.pyglet_native import ON_X11

        window = self._window
        width, height = self.size_px
        return {
            "window": "pyglet",
            "window_version": f"pyglet {pyglet.version}",
            "window_driver": f"{pyglet.compat_platform}, {window.renderer()}",
            "window_size_px": f"{width}x{height}",
            "fullscreen": str(bool(window.fullscreen)).lower(),
            "vsync": "on" if window.vsync else "off",
            "refresh_hz_reported": window.refresh_hz(),
            "key_times": SERVER_TIME if self._has_server_time else ON_RECEIPT,
            "key_identity": "position (X11 keycode)" if ON_X11 else "symbol (US layout assumed)",
        }

    def close(self) -> None:
        """Close the window; a second call does nothing."""
        if self._native is not None:
            if self._record is not None:
                self._record.close()
            self._native.close()
            self._native = None


def _open_record(clock: Clock, window: int | None) -> X11InputRecord | None:
    """Return the X server's record of keys for the window; None if there is none."""
    if window is None:
        return None
    try:
        return X11InputRecord(clock, window)
    except OSError:
        return None


def _open_native_window(*, fullscreen: bool, size_px: Size) -> "PygletNativeWindow":
    """Open a pyglet window and start its event loop.

    Raises:
        WindowError: if pyglet is in headless mode or cannot open a window.
    """
    try:
        import pyglet

        if pyglet.options["headless"]:
            raise WindowError("pyglet is in headless mode, so it cannot open a window; use --window pygame")
        from minihuman.display.windows.pyglet_native import PygletNativeWindow

        if fullscreen:
            window = PygletNativeWindow(TITLE, None)
        else:
            window = PygletNativeWindow(TITLE, size_px)
        pyglet.app.platform_event_loop.start()
    except WindowError:
        raise
    except Exception as error:  # pyglet's own share no base, and the missing OpenGL library is an ImportError
        raise WindowError(
            f"pyglet cannot open a window here ({type(error).__name__}: {error}); log in to a desktop or set DISPLAY, "
            "or use `minihuman simulate` to play without a window"
        ) from error
    window.set_mouse_visible(False)
    return window
