"""A pyglet window that reports key positions and shows finished pictures, for pyglet 1.5 and 2.

Importing this module opens pyglet's connection to the display, so ``pyglet_window`` imports it only to open a window.
"""

import ctypes
from typing import Any

import numpy as np
import pyglet
import pyglet.window
from numpy.typing import NDArray
from pyglet import gl

from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.keyboard import key_from_symbol, key_from_xkb, read_key_positions
from minihuman.display.windows.pyglet_mouse import MouseTracker, make_tracker
from minihuman.experiment.keys import MODIFIERS

ON_X11 = pyglet.compat_platform.startswith("linux")
if ON_X11:
    from pyglet.libs.x11 import xlib

# Keysyms of X11/keysymdef.h
_SHIFT_L = 0xFFE1
_HYPER_R = 0xFFEE
_ISO_LOCK = 0xFE01
_ISO_LEVEL5_LOCK = 0xFE13
_MODE_SWITCH = 0xFF7E
_NUM_LOCK = 0xFF7F
_SHORTCUT_STATE = 1 << 2 | 1 << 3 | 1 << 6  # Control, Mod1 (Alt) and Mod4 (Meta); AltGr is Mod5
_SHORTCUT_MODIFIERS = (
    pyglet.window.key.MOD_CTRL
    | pyglet.window.key.MOD_ALT
    | pyglet.window.key.MOD_COMMAND
    | pyglet.window.key.MOD_WINDOWS
)
_GRABS = (1, 2)  # focus modes NotifyGrab and NotifyUngrab: a window manager takes the keyboard, and gives it back

EVENT_HANDLED = pyglet.event.EVENT_HANDLED


def find_screen() -> Any:
    """Return the screen on which windows open."""
    if hasattr(pyglet, "canvas"):  # pyglet 1.5
        return pyglet.canvas.get_display().get_default_screen()
    return pyglet.display.get_display().get_default_screen()


def _is_modifier(keysym: int) -> bool:
    """Return whether a key is Shift, Control, Meta, a lock or another modifier, as in X11/keysymdef.h and Xutil.h."""
    is_plain_modifier = _SHIFT_L <= keysym <= _HYPER_R
    is_iso_modifier = _ISO_LOCK <= keysym <= _ISO_LEVEL5_LOCK
    return is_plain_modifier or is_iso_modifier or keysym in (_MODE_SWITCH, _NUM_LOCK)


def _is_grab(event: Any) -> bool:
    """Return whether a focus event only means that a window manager reads the rest of a shortcut."""
    return ON_X11 and event.type in (xlib.FocusIn, xlib.FocusOut) and event.xfocus.mode in _GRABS


class PygletNativeWindow(pyglet.window.Window):  # type: ignore[misc]  # pyglet 1.5 has no types
    """A pyglet window that also dispatches ``on_key(down, key, symbol, server_ms, is_shortcut)`` with our key names.

    On X11, the key and its time are read from the X event, before pyglet reduces the key to a symbol and drops what it
    takes for auto-repeat. On other systems, only pyglet's symbol is known, and ``server_ms`` is None.
    """

    _enable_event_queue = False  # deliver at once and in order, as pyglet's own event loop has it

    def __init__(self, title: str, size_px: Size | None) -> None:
        """Open a window of a size, at most as large as the screen; None opens a full screen."""
        self._positions: dict[int, str] = {}
        self._tracker: MouseTracker | None = None  # None where pyglet's own events report motion
        self.accepts_text = False
        self._is_key_reported = False  # of the key event that pyglet looks at now
        self.button_ms: int | None = None  # the server's time of the last event of a mouse button
        screen = find_screen()
        settings: dict[str, Any] = {"fullscreen": True, "screen": screen}
        if size_px is not None:
            width = min(size_px[0], screen.width)
            height = min(size_px[1], screen.height)
            settings = {"width": width, "height": height, "resizable": True}
        super().__init__(caption=title, vsync=True, **settings)
        if ON_X11:
            self._positions = read_key_positions(xlib._lib, self.display._display)
            self._tracker = make_tracker(xlib, self.display._display, self._window, self.get_size)
        self._frame_size: Size | None = None
        self._texture = gl.GLuint()
        self._framebuffer = gl.GLuint()

    # Keys on X11

    def dispatch_platform_event(self, event: Any) -> None:
        """Handle key events of the window; pyglet handles other events and the text that keys produce."""
        if _is_grab(event) or self._follow_mouse(event, is_reported=False):
            return
        self._is_key_reported = self._report_x11_key(event)
        if not self._is_key_reported or self.accepts_text:
            super().dispatch_platform_event(event)
        self._is_key_reported = False

    def dispatch_platform_event_view(self, event: Any) -> None:
        """Handle key events of the window's inner area; pyglet handles other events and the text that keys produce."""
        if self._follow_mouse(event, is_reported=True):
            return
        self._is_key_reported = self._report_x11_key(event)
        if not self._is_key_reported or self.accepts_text:
            super().dispatch_platform_event_view(event)
        self._is_key_reported = False

    def _report_x11_key(self, event: Any) -> bool:
        """Dispatch the key of an X event by its position; return False if the event is not about a key.

        For an event of a mouse button, record its time.
        """
        if ON_X11 and event.type in (xlib.ButtonPress, xlib.ButtonRelease):
            self.button_ms = event.xbutton.time
        if not ON_X11 or event.type not in (xlib.KeyPress, xlib.KeyRelease):
            return False
        keycode = event.xkey.keycode
        keysym = xlib.KeySym()
        text = ctypes.create_string_buffer(32)
        xlib.XLookupString(event.xkey, text, len(text), ctypes.byref(keysym), None)
        symbol = xlib.XKeysymToString(keysym.value) or b""
        key = key_from_xkb(self._positions.get(keycode, ""), keycode)
        is_shortcut = bool(event.xkey.state & _SHORTCUT_STATE) and not _is_modifier(keysym.value)
        down = event.type == xlib.KeyPress
        name = symbol.decode("ascii", "replace")
        self.dispatch_event("on_key", down, key, name, event.xkey.time, is_shortcut)
        return True

    # A captured mouse

    def capture_mouse(self, captured: bool) -> None:
        """Hide the pointer, keep it in the window and dispatch its motion; or, if not ``captured``, release it."""
        self.set_exclusive_mouse(captured)
        self.track_mouse(captured)

    def track_mouse(self, tracked: bool) -> None:
        """Start or stop following a captured mouse; it is not followed while another window has the focus."""
        if self._tracker is not None and tracked:
            self._tracker.begin()
        elif self._tracker is not None:
            self._tracker.end()

    def _follow_mouse(self, event: Any, *, is_reported: bool) -> bool:
        """Dispatch the motion of a captured mouse; return False for other events.

        Args:
            event: the X server's event.
            is_reported: whether to dispatch the motion: only for events of the inner area, which the outer window
                repeats while a button is down.
        """
        if self._tracker is None or not self._tracker.is_tracking or event.type != xlib.MotionNotify:
            return False
        if is_reported:
            motion = event.xmotion
            right_px, down_px = self._tracker.follow((motion.x, motion.y), motion.serial)
            self.dispatch_event("on_captured_motion", right_px, down_px, motion.time)
        return True

    def on_mouse_motion(self, x: int, y: int, dx: int, dy: int) -> None:
        """Report the motion that pyglet sees, on systems without an X server."""
        if self._tracker is None:
            self.dispatch_event("on_captured_motion", dx, -dy, None)  # pyglet counts from the bottom

    def on_mouse_drag(self, x: int, y: int, dx: int, dy: int, buttons: int, modifiers: int) -> None:
        """Report motion with a button down as motion."""
        self.on_mouse_motion(x, y, dx, dy)

    # Keys elsewhere

    def on_key_press(self, symbol: int, modifiers: int) -> bool:
        """Report the pressed key; pyglet's own handler would close the window at Escape."""
        return self._report_symbol(True, symbol, modifiers)

    def on_key_release(self, symbol: int, modifiers: int) -> bool:
        """Report the released key."""
        return self._report_symbol(False, symbol, modifiers)

    def _report_symbol(self, down: bool, symbol: int, modifiers: int) -> bool:
        """Dispatch a key by pyglet's symbol, unless it was dispatched by its position; return ``EVENT_HANDLED``."""
        if self._is_key_reported:
            return bool(EVENT_HANDLED)
        name = pyglet.window.key.symbol_string(symbol)
        key = key_from_symbol(name)
        is_shortcut = bool(modifiers & _SHORTCUT_MODIFIERS) and key not in MODIFIERS and not name.endswith("COMMAND")
        self.dispatch_event("on_key", down, key, name, None, is_shortcut)
        return bool(EVENT_HANDLED)

    @property
    def x11_window(self) -> int | None:
        """The X server's id of the window; None on other systems."""
        if not ON_X11:
            return None
        return int(self._window)

    # Pictures

    def present(self, frame: NDArray[np.uint8], changed: Box) -> None:
        """Show a frame uint8[H, W, 3] of the framebuffer's size, changed only in a box; return once it is displayed.

        A copy between framebuffers needs no shader and turns the picture upright, in the OpenGL of either pyglet
        version.
        """
        height, width = frame.shape[:2]
        self.switch_to()
        if self._frame_size != (width, height):
            self._make_texture(width, height)
        left, top, box_width, box_height = changed
        box = np.ascontiguousarray(frame[top : top + box_height, left : left + box_width])
        pixels = box.ctypes.data_as(ctypes.c_void_p)
        gl.glTexSubImage2D(
            gl.GL_TEXTURE_2D, 0, left, top, box_width, box_height, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, pixels
        )
        gl.glBlitFramebuffer(0, 0, width, height, 0, height, width, 0, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)
        self.flip()
        gl.glFinish()  # a flip only queues the frame

    def _make_texture(self, width: int, height: int) -> None:
        """Replace the texture by one for frames of a width and height in pixels, and bind it for reading."""
        for delete, name in ((gl.glDeleteFramebuffers, self._framebuffer), (gl.glDeleteTextures, self._texture)):
            delete(1, ctypes.byref(name))  # OpenGL ignores the name 0, which both have at first
        texture, framebuffer = self._texture, self._framebuffer = gl.GLuint(), gl.GLuint()
        gl.glGenTextures(1, ctypes.byref(texture))
        gl.glBindTexture(gl.GL_TEXTURE_2D, texture)
        gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MIN_FILTER, gl.GL_NEAREST)
        gl.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 1)
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, gl.GL_RGB8, width, height, 0, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, None)
        gl.glGenFramebuffers(1, ctypes.byref(framebuffer))
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, framebuffer)
        gl.glFramebufferTexture2D(gl.GL_READ_FRAMEBUFFER, gl.GL_COLOR_ATTACHMENT0, gl.GL_TEXTURE_2D, texture, 0)
        self._frame_size = (width, height)

    def renderer(self) -> str:
        """Return OpenGL's name of the renderer."""
        return (ctypes.cast(gl.glGetString(gl.GL_RENDERER), ctypes.c_char_p).value or b"unknown").decode()

    def refresh_hz(self) -> str:
        """Return the refresh rate that the display reports; "unknown" if it reports none."""
        mode = self.screen.get_mode()
        if mode is not None and mode.rate:
            return str(mode.rate)
        return "unknown"


PygletNativeWindow.register_event_type("on_key")
PygletNativeWindow.register_event_type("on_captured_motion")
