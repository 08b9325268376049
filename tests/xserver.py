"""A display of our own, and a keyboard on it: Xvfb, and key events that the X server itself makes (XTEST)."""

import os
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from Xlib import XK, X
from Xlib.display import Display
from Xlib.error import BadDrawable, BadWindow
from Xlib.ext import xinput, xtest
from Xlib.protocol import event, rq

from minihuman.experiment.keys import KEY_NAMES
from tests.counts import PATIENCE_S
from tests.machine import need
from tests.programs import running, stop

Size = tuple[int, int]

SCREEN_PX: Size = (1366, 768)
_DEBOUNCE_S = 0.004  # a keyboard's own; SDL takes a key that comes back within 2 ms for auto-repeat

# Our key names to the keysyms of a US keyboard, where they are not the name itself.
_KEYSYMS = {
    "enter": "Return",
    "escape": "Escape",
    "left": "Left",
    "right": "Right",
    "up": "Up",
    "down": "Down",
    "tab": "Tab",
    "backspace": "BackSpace",
    "insert": "Insert",
    "delete": "Delete",
    "home": "Home",
    "end": "End",
    "page_up": "Prior",
    "page_down": "Next",
    "left_bracket": "bracketleft",
    "right_bracket": "bracketright",
    "equals": "equal",
    "quote": "apostrophe",
    "left_shift": "Shift_L",
    "right_shift": "Shift_R",
    "left_ctrl": "Control_L",
    "right_ctrl": "Control_R",
    "left_alt": "Alt_L",
    "right_alt": "Alt_R",
    "caps_lock": "Caps_Lock",
    "num_lock": "Num_Lock",
    "kp_enter": "KP_Enter",
    "kp_plus": "KP_Add",
    "kp_minus": "KP_Subtract",
    "kp_multiply": "KP_Multiply",
    "kp_divide": "KP_Divide",
    "kp_period": "KP_Delete",
    "kp_0": "KP_Insert",
    "kp_1": "KP_End",
    "kp_2": "KP_Down",
    "kp_3": "KP_Next",
    "kp_4": "KP_Left",
    "kp_5": "KP_Begin",
    "kp_6": "KP_Right",
    "kp_7": "KP_Home",
    "kp_8": "KP_Up",
    "kp_9": "KP_Prior",
}


_MAPPING_S = 0.2  # until every program has the new symbols of keys


def _symbol_of(code_point: int) -> int:
    """The keysym of a code point: itself in Latin-1, else the Unicode one."""
    return code_point if code_point < 0x100 else 0x01000000 | code_point


@contextmanager
def xvfb(screen_px: Size = SCREEN_PX) -> Iterator[str]:
    """Run an X server on a free display; yields its name, ":12"."""
    program = need("xvfb")
    reading, writing = os.pipe()
    size = f"{screen_px[0]}x{screen_px[1]}x24"
    command = [program, "-displayfd", str(writing), "-screen", "0", size, "-nolisten", "tcp", "-noreset"]
    with running(command, pass_fds=(writing,), stderr=subprocess.DEVNULL) as server:
        os.close(writing)
        with os.fdopen(reading) as said:
            number = said.readline().strip()
        assert number, "Xvfb ended before it had a display"
        yield f":{number}"
        stop(server)


class _FakeDeviceKey(rq.Request):
    """XTEST's FakeInput with an event of a device, as XTestFakeDeviceKeyEvent makes it."""

    _request = rq.Struct(
        rq.Card8("opcode"),
        rq.Opcode(2),
        rq.RequestLength(),
        rq.Card8("event_type"),
        rq.Card8("detail"),
        rq.Pad(2),
        rq.Card32("time"),
        rq.Pad(23),
        rq.Card8("device"),
    )


class Typist:
    """Presses keys on a display, as a keyboard would, and looks at it."""

    def __init__(self, display: str) -> None:
        self._display = Display(display)
        self._root = self._display.screen().root
        self.sent: list[tuple[str, bool]] = []  # key, down
        self._released_s: dict[str, float] = {}
        self._places = {key: self.keycode(key) for key in KEY_NAMES}

    def press(self, key: str) -> None:
        time.sleep(max(0.0, self._released_s.get(key, 0.0) + _DEBOUNCE_S - time.monotonic()))
        self._fake(X.KeyPress, key)

    def release(self, key: str) -> None:
        self._fake(X.KeyRelease, key)
        self._released_s[key] = time.monotonic()

    def tap(self, *keys: str) -> None:
        """Press and release each key in turn, as fast as a keyboard can."""
        for key in keys:
            self.press(key)
            self.release(key)

    def _fake(self, kind: int, key: str) -> None:
        keycode = self.keycode(key)
        assert keycode, f"this keyboard has no key {key!r}"
        xtest.fake_input(self._display, kind, keycode)
        self._display.sync()
        self.sent.append((key, kind == X.KeyPress))

    def fake_second(self, key: str, *, down: bool) -> None:
        """Press or release a key of the second keyboard, the X server's own; XTEST's is the first."""
        _FakeDeviceKey(
            display=self._display.display,
            opcode=self._display.display.get_extension_major(xtest.extname),
            event_type=self._display.query_extension("XInputExtension").first_event + (1 if down else 2),
            detail=self.keycode(key),
            time=0,
            device=self._second_keyboard,
        )
        self._display.sync()

    @cached_property
    def _second_keyboard(self) -> int:
        devices = self._display.xinput_query_device(xinput.AllDevices).devices
        return next(int(device.deviceid) for device in devices if device.name == "Xvfb keyboard")

    def write(self, text: str) -> str:
        """Type as much of a text as there are keys that the keyboard does not use; return the rest.

        Each letter gets such a key, as by xdotool. A program looks a key up as it takes its press, so let it do so
        before the rest is written.
        """
        rest = text[len(self._spare_keycodes) :]
        text = text[: len(self._spare_keycodes)]
        keycodes = dict(zip(dict.fromkeys(text), self._spare_keycodes, strict=False))
        first = self._display.display.info.min_keycode
        mapping = self._display.get_keyboard_mapping(first, self._display.display.info.max_keycode - first + 1)
        for letter, keycode in keycodes.items():
            mapping[keycode - first] = [_symbol_of(ord(letter))] * len(mapping[0])
        self._display.change_keyboard_mapping(
            first, mapping
        )  # at once: at each change a window manager binds its keys anew
        self._display.sync()
        time.sleep(_MAPPING_S)
        for letter in text:
            for kind in (X.KeyPress, X.KeyRelease):
                xtest.fake_input(self._display, kind, keycodes[letter])
                self._display.sync()
            time.sleep(_DEBOUNCE_S)
        return rest

    @cached_property
    def _spare_keycodes(self) -> list[int]:
        """The numbers of keys that have no symbol, the highest first."""
        first = self._display.display.info.min_keycode
        count = self._display.display.info.max_keycode - first + 1
        mapping = self._display.get_keyboard_mapping(first, count)
        return [first + place for place in reversed(range(count)) if not any(mapping[place])]

    def point(self, title: str, x: float, y: float) -> None:
        """Move the mouse to (x, y), 0..1 of a window."""
        window = self._window(title)
        shape, place = window.get_geometry(), window.translate_coords(self._root, 0, 0)
        xtest.fake_input(
            self._display, X.MotionNotify, x=int(x * shape.width) - place.x, y=int(y * shape.height) - place.y
        )
        self._display.sync()

    def move(self, right_px: int, down_px: int) -> None:
        """Move the mouse from where it is, as a hand does."""
        xtest.fake_input(self._display, X.MotionNotify, detail=True, x=right_px, y=down_px)
        self._display.sync()

    def button(self, down: bool, number: int = 1) -> None:
        """Press or release a button of the mouse, the main one if it is not named; 4 and 5 are the wheel's."""
        xtest.fake_input(self._display, X.ButtonPress if down else X.ButtonRelease, number)
        self._display.sync()

    def tap_place(self, key: str) -> None:
        """Tap the key that is in this place on a US keyboard, whatever the layout says now."""
        for kind in (X.KeyPress, X.KeyRelease):
            xtest.fake_input(self._display, kind, self._places[key])
        self._display.sync()

    def set_layout(self, layout: str) -> None:
        """Change the keyboard's layout, for everybody."""
        subprocess.run(["setxkbmap", "-display", self._display.get_display_name(), layout], check=True)
        self._display.sync()

    def keycode(self, key: str) -> int:
        """The server's number for a key on a US keyboard; 0 if there is none."""
        keysym = XK.string_to_keysym(_KEYSYMS.get(key, key.upper() if key[:1] == "f" and key[1:].isdigit() else key))
        return int(self._display.keysym_to_keycode(keysym))

    def focus(self, title: str) -> None:
        """Give the keyboard to the window of that title, as soon as it shows something: before, it hears nothing."""
        window = self._window(title)
        deadline_s = time.monotonic() + PATIENCE_S
        while not any(self.stripes(title, (0.5,))):
            assert time.monotonic() < deadline_s, f"window {title!r} stayed black for {PATIENCE_S:.0f} s"
            time.sleep(0.02)
        self._display.set_input_focus(window, X.RevertToParent, X.CurrentTime)
        self._display.sync()

    def unfocus(self) -> None:
        """Take the keyboard from every window."""
        self._display.set_input_focus(X.NONE, X.RevertToParent, X.CurrentTime)
        self._display.sync()

    def ask_to_close(self, title: str) -> None:
        """What a window manager sends when the window's cross is clicked."""
        window = self._window(title)
        protocols = self._display.intern_atom("WM_PROTOCOLS")
        data = (32, [self._display.intern_atom("WM_DELETE_WINDOW"), X.CurrentTime, 0, 0, 0])
        window.send_event(event.ClientMessage(window=window, client_type=protocols, data=data))
        self._display.sync()

    def picture(self, title: str) -> NDArray[np.uint8]:
        """What the window of that title shows, uint8[H, W, 3]."""
        window = self._window(title)
        shape = window.get_geometry()
        raw = window.get_image(0, 0, shape.width, shape.height, X.ZPixmap, 0xFFFFFFFF).data
        return np.frombuffer(raw, np.uint8).reshape(shape.height, shape.width, 4)[..., 2::-1]

    def stripes(self, title: str, heights: Sequence[float]) -> bytes:
        """Two rows of pixels at each height (of the window's): enough to see that a picture changed, soon."""
        return self.watch(title, heights)()

    def watch(self, title: str, heights: Sequence[float]) -> Callable[[], bytes]:
        """Stripes of a window that stays as it is, a round trip each time: the window is looked for once."""
        window = self._window(title)
        shape = window.get_geometry()
        rows = [round(height * shape.height) for height in heights]
        return lambda: b"".join(window.get_image(0, row, shape.width, 2, X.ZPixmap, 0xFFFFFFFF).data for row in rows)

    def _window(self, title: str):
        """The newest visible window of that title; waits for it."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            for window in reversed(self._root.query_tree().children):
                with suppress(BadDrawable, BadWindow):  # one that went while the list was read
                    if self._title(window) == title and window.get_attributes().map_state == X.IsViewable:
                        return window
            time.sleep(0.02)
        raise AssertionError(f"no window {title!r} came up within {PATIENCE_S:.0f} s")

    def _title(self, window) -> str:
        name = window.get_full_text_property(self._display.intern_atom("_NET_WM_NAME"))
        return str(name or window.get_wm_name())

    def close(self) -> None:
        self._display.close()
