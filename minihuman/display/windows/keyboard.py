"""The keyboard: where a key is, from what each toolkit reports, and when it moved, by the X server.

SDL gives USB positions (scancodes), X11 gives positions by name through XKB, pyglet elsewhere gives only symbols. A key
without a name of ours is called after its number, so that it still reaches the log. An X keycode is the server's
private number; the name of a position ("AE01": row E, first key) is the same everywhere.

The X server stamps each event as it comes, whatever this process is busy with. Its stamps are whole milliseconds of
CLOCK_MONOTONIC, which we use too, if server and session run on the same machine; that is tested once, by having the
server stamp something. Structures and masks as in X11/extensions/XKBstr.h, XKB.h and XInput2.h.
"""

import ctypes
import select
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from minihuman.display.windows.window import Clock
from minihuman.experiment.keys import DIGITS, FUNCTION, KEY_NAMES, LETTERS


def _numbered(first: int, names: tuple[str, ...]) -> dict[int, str]:
    return {first + offset: name for offset, name in enumerate(names)}


# USB HID Usage Tables 1.5, page 0x07: what SDL calls a scancode.
_BY_SCANCODE: Mapping[int, str] = (
    _numbered(4, LETTERS)
    | _numbered(30, DIGITS)
    | _numbered(40, ("enter", "escape", "backspace", "tab", "space"))
    | _numbered(45, ("minus", "equals", "left_bracket", "right_bracket", "backslash"))
    | _numbered(51, ("semicolon", "quote", "grave", "comma", "period", "slash", "caps_lock"))
    | _numbered(58, FUNCTION)
    | _numbered(73, ("insert", "home", "page_up", "delete", "end", "page_down"))
    | _numbered(79, ("right", "left", "down", "up", "num_lock"))
    | _numbered(84, ("kp_divide", "kp_multiply", "kp_minus", "kp_plus", "kp_enter"))
    | _numbered(89, tuple(f"kp_{digit}" for digit in DIGITS))
    | {99: "kp_period"}
    | _numbered(224, ("left_ctrl", "left_shift", "left_alt"))
    | _numbered(228, ("right_ctrl", "right_shift", "right_alt"))
)


def _row(letter: str, names: str) -> dict[str, str]:
    return {f"A{letter}{number:02}": name for number, name in enumerate(names.split(), start=1)}


# XKB's names of positions (xkeyboard-config, keycodes/evdev): row A is the space bar's, E the digits'.
_BY_XKB: Mapping[str, str] = (
    _row("E", "1 2 3 4 5 6 7 8 9 0 minus equals")
    | _row("D", "q w e r t y u i o p left_bracket right_bracket")
    | _row("C", "a s d f g h j k l semicolon quote")
    | _row("B", "z x c v b n m comma period slash")
    | {f"FK{number:02}": f"f{number}" for number in range(1, 13)}
    | {f"KP{digit}": f"kp_{digit}" for digit in DIGITS}
    | {"KPEN": "kp_enter", "KPAD": "kp_plus", "KPSU": "kp_minus", "KPMU": "kp_multiply", "KPDV": "kp_divide"}
    | {"KPDL": "kp_period", "NMLK": "num_lock", "CAPS": "caps_lock", "TLDE": "grave", "BKSL": "backslash"}
    | {"SPCE": "space", "RTRN": "enter", "ESC": "escape", "TAB": "tab", "BKSP": "backspace"}
    | {"INS": "insert", "DELE": "delete", "HOME": "home", "END": "end", "PGUP": "page_up", "PGDN": "page_down"}
    | {"UP": "up", "DOWN": "down", "LEFT": "left", "RGHT": "right"}
    | {"LFSH": "left_shift", "RTSH": "right_shift", "LCTL": "left_ctrl", "RCTL": "right_ctrl"}
    | {"LALT": "left_alt", "RALT": "right_alt", "LVL3": "right_alt", "ALGR": "right_alt"}
)

# pyglet's names of symbols, where they are not ours in capitals.
_BY_SYMBOL: Mapping[str, str] = (
    {f"_{digit}": digit for digit in DIGITS}
    | {f"NUM_{digit}": f"kp_{digit}" for digit in DIGITS}
    | {"NUM_ENTER": "kp_enter", "NUM_ADD": "kp_plus", "NUM_SUBTRACT": "kp_minus", "NUM_MULTIPLY": "kp_multiply"}
    | {"NUM_DIVIDE": "kp_divide", "NUM_DECIMAL": "kp_period", "NUMLOCK": "num_lock", "CAPSLOCK": "caps_lock"}
    | {"NUM_END": "kp_1", "NUM_DOWN": "kp_2", "NUM_NEXT": "kp_3", "NUM_PAGE_DOWN": "kp_3", "NUM_LEFT": "kp_4"}
    | {"NUM_BEGIN": "kp_5", "NUM_RIGHT": "kp_6", "NUM_HOME": "kp_7", "NUM_UP": "kp_8", "NUM_PRIOR": "kp_9"}
    | {"NUM_PAGE_UP": "kp_9", "NUM_INSERT": "kp_0", "NUM_DELETE": "kp_period"}
    | {"RETURN": "enter", "PAGEUP": "page_up", "PAGEDOWN": "page_down", "EQUAL": "equals"}
    | {"BRACKETLEFT": "left_bracket", "BRACKETRIGHT": "right_bracket", "APOSTROPHE": "quote", "QUOTELEFT": "grave"}
    | {"LSHIFT": "left_shift", "RSHIFT": "right_shift", "LCTRL": "left_ctrl", "RCTRL": "right_ctrl"}
    | {"LALT": "left_alt", "RALT": "right_alt", "LOPTION": "left_alt", "ROPTION": "right_alt"}
)


def key_from_scancode(scancode: int) -> str:
    """Our name for an SDL scancode; "scancode_50" for one without."""
    return _BY_SCANCODE.get(scancode, f"scancode_{scancode}")


def key_to_scancode(key: str) -> int:
    """The SDL scancode of one of our names."""
    return next(scancode for scancode, name in _BY_SCANCODE.items() if name == key)


def key_from_xkb(position: str, keycode: int) -> str:
    """Our name for XKB's name of a position; "keycode_94" for one without."""
    return _BY_XKB.get(position, f"keycode_{keycode}")


def key_from_symbol(name: str) -> str:
    """Our name for a pyglet symbol, taken to sit where it sits on a US keyboard; "symbol_plus" for one without."""
    known = _BY_SYMBOL.get(name, name.lower())
    return known if known in KEY_NAMES else f"symbol_{name.lower()}"


_USE_CORE_KEYBOARD = 0x100
_KEY_NAMES_MASK = 1 << 9
_NAME_LENGTH = 4


class _Names(ctypes.Structure):
    _fields_ = (
        ("keycodes", ctypes.c_ulong),
        ("geometry", ctypes.c_ulong),
        ("symbols", ctypes.c_ulong),
        ("types", ctypes.c_ulong),
        ("compat", ctypes.c_ulong),
        ("vmods", ctypes.c_ulong * 16),
        ("indicators", ctypes.c_ulong * 32),
        ("groups", ctypes.c_ulong * 4),
        ("keys", ctypes.POINTER(ctypes.c_char * _NAME_LENGTH)),
    )


class _Description(ctypes.Structure):
    _fields_ = (
        ("display", ctypes.c_void_p),
        ("flags", ctypes.c_ushort),
        ("device_spec", ctypes.c_ushort),
        ("min_key_code", ctypes.c_ubyte),
        ("max_key_code", ctypes.c_ubyte),
        ("ctrls", ctypes.c_void_p),
        ("server", ctypes.c_void_p),
        ("map", ctypes.c_void_p),
        ("indicators", ctypes.c_void_p),
        ("names", ctypes.POINTER(_Names)),
    )


def read_key_positions(xlib: Any, display: Any) -> dict[int, str]:
    """Keycode to position name ("AE01", "SPCE"), asked of the X server; empty if it does not speak XKB.

    Args:
        xlib: the loaded libX11.
        display: a pointer to the open ``Display``.
    """
    opaque = ctypes.cast(display, ctypes.c_void_p)
    get_map = _function(xlib.XkbGetMap, ctypes.POINTER(_Description), ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)
    get_names = _function(xlib.XkbGetNames, ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.POINTER(_Description))
    free = _function(xlib.XkbFreeKeyboard, None, ctypes.POINTER(_Description), ctypes.c_uint, ctypes.c_int)
    described = get_map(opaque, 0, _USE_CORE_KEYBOARD)
    if not described:
        return {}
    try:
        if get_names(opaque, _KEY_NAMES_MASK, described) != 0:
            return {}
        keyboard = described.contents
        names = keyboard.names.contents.keys
        codes = range(keyboard.min_key_code, keyboard.max_key_code + 1)
        return {code: names[code].raw.rstrip(b"\0").decode("ascii") for code in codes if names[code].raw.strip(b"\0")}
    finally:
        free(described, 0, 1)


def _function(function: Any, returns: Any, *takes: Any) -> Any:
    function.restype = returns
    function.argtypes = takes
    return function


SERVER_TIME = "X server's event time, to 1 ms"
ON_RECEIPT = "on receipt: late by as long as a picture takes to draw"

_NS_PER_MS = 1_000_000
_TICKS = 1 << 32  # the server's milliseconds start again there, every 50 days
_OLDEST_MS = 60_000
_EVENT_TIMEOUT_S = 0.002  # the server tells us and the toolkit at once
_MAX_KEY_TIMES = 4096
_PROPERTY_NOTIFY, _GENERIC_EVENT = 28, 35
_RAW_PRESSES, _RAW_RELEASES = (13, 15), (14, 16)  # of a key, of a button
MAIN_BUTTON = "main_button"  # the mouse's, among the keys whose times are recorded
_ALL_MASTER_DEVICES = 1
_KEY_REPEAT = 1 << 16
_PROPERTY_CHANGE_MASK = 1 << 22


class _Mask(ctypes.Structure):
    _fields_ = (("device", ctypes.c_int), ("length", ctypes.c_int), ("bits", ctypes.POINTER(ctypes.c_ubyte)))


_EVENT_HEAD = (
    ("type", ctypes.c_int),
    ("serial", ctypes.c_ulong),
    ("sent", ctypes.c_int),
    ("display", ctypes.c_void_p),
)


class _Cookie(ctypes.Structure):
    _fields_ = (
        *_EVENT_HEAD,
        ("extension", ctypes.c_int),
        ("kind", ctypes.c_int),
        ("number", ctypes.c_uint),
        ("data", ctypes.c_void_p),
    )


class _Raw(ctypes.Structure):
    _fields_ = (
        *_EVENT_HEAD,
        ("extension", ctypes.c_int),
        ("kind", ctypes.c_int),
        ("time", ctypes.c_ulong),
        ("device", ctypes.c_int),
        ("source", ctypes.c_int),
        ("detail", ctypes.c_int),
        ("flags", ctypes.c_int),
    )


class _Property(ctypes.Structure):
    _fields_ = (
        *_EVENT_HEAD,
        ("window", ctypes.c_ulong),
        ("atom", ctypes.c_ulong),
        ("time", ctypes.c_ulong),
        ("state", ctypes.c_int),
    )


class _Event(ctypes.Union):
    _fields_ = (("type", ctypes.c_int), ("cookie", _Cookie), ("property", _Property), ("pad", ctypes.c_long * 24))


def convert_server_time(server_ms: int, clock: Clock) -> int:
    """The session's time of an event that the server stamped: never too early, late by a millisecond at most.

    A stamp that cannot be true (of the future, over a minute old) gives the time now.
    """
    now_ns, monotonic_ns = clock(), time.monotonic_ns()
    age_ms = (monotonic_ns // _NS_PER_MS - server_ms) % _TICKS
    if age_ms > _OLDEST_MS:
        return now_ns
    begun_ns = monotonic_ns - monotonic_ns % _NS_PER_MS - age_ms * _NS_PER_MS
    return now_ns - max(0, monotonic_ns - begun_ns - _NS_PER_MS)


class _Server:
    """A connection of our own to the X server, whose clock is ours.

    Raises:
        OSError: if there is no such server, or its clock is another.
    """

    def __init__(self) -> None:
        self._x = ctypes.CDLL("libX11.so.6")
        self._declare()
        self._display = ctypes.c_void_p(self._x.XOpenDisplay(None))
        if not self._display:
            raise OSError("no X server is available")
        self._root = self._x.XDefaultRootWindow(self._display)
        if not self._same_clock():
            self.close()
            raise OSError(
                "the X server's clock is not this machine's, so it cannot time key presses; "
                "use an X server on this machine"
            )

    def close(self) -> None:
        """Hang up; a second call does nothing."""
        if self._display:
            self._x.XCloseDisplay(self._display)
            self._display = ctypes.c_void_p()

    def _declare(self) -> None:
        display, window, event = ctypes.c_void_p, ctypes.c_ulong, ctypes.POINTER(_Event)
        functions: tuple[tuple[Any, ...], ...] = (
            ("XOpenDisplay", display, ctypes.c_char_p),
            ("XCloseDisplay", ctypes.c_int, display),
            ("XDefaultRootWindow", window, display),
            ("XConnectionNumber", ctypes.c_int, display),
            ("XPending", ctypes.c_int, display),
            ("XNextEvent", ctypes.c_int, display, event),
            ("XGetEventData", ctypes.c_int, display, ctypes.POINTER(_Cookie)),
            ("XFreeEventData", None, display, ctypes.POINTER(_Cookie)),
            ("XFlush", ctypes.c_int, display),
            ("XInternAtom", ctypes.c_ulong, display, ctypes.c_char_p, ctypes.c_int),
            ("XCreateSimpleWindow", window, display, window, *[ctypes.c_int] * 5, *[ctypes.c_ulong] * 2),
            ("XSelectInput", ctypes.c_int, display, window, ctypes.c_long),
            ("XChangeProperty", ctypes.c_int, display, window, *[ctypes.c_ulong] * 2, *[ctypes.c_int] * 2,
             ctypes.c_char_p, ctypes.c_int),
            ("XDestroyWindow", ctypes.c_int, display, window),
        )  # fmt: skip
        for name, returns, *takes in functions:
            function = self._x[name]  # a function object of our own: others in this process declare theirs
            function.restype, function.argtypes = returns, takes
            setattr(self._x, name, function)

    def _same_clock(self) -> bool:
        """Have the server stamp something, and see whether that is our time."""
        window = self._x.XCreateSimpleWindow(self._display, self._root, 0, 0, 1, 1, 0, 0, 0)
        self._x.XSelectInput(self._display, window, _PROPERTY_CHANGE_MASK)
        atom = self._x.XInternAtom(self._display, b"MINIHUMAN_TIME", 0)
        before_ms = time.monotonic_ns() // _NS_PER_MS
        self._x.XChangeProperty(self._display, window, atom, atom, 8, 0, b"", 0)
        event = _Event()
        while event.type != _PROPERTY_NOTIFY:
            self._x.XNextEvent(self._display, ctypes.byref(event))
        after_ms = time.monotonic_ns() // _NS_PER_MS
        self._x.XDestroyWindow(self._display, window)
        return bool((event.property.time - before_ms) % _TICKS <= after_ms - before_ms)


def has_shared_clock() -> bool:
    """Whether there is an X server that stamps its events by our own clock."""
    try:
        _Server().close()
    except OSError:
        return False
    return True


class X11KeyTimes(_Server):
    """Records each event of a key or the mouse's main button; reports the times of those that a window received.

    Args:
        clock: the session's.

    Raises:
        OSError: if there is no such server, it does not speak XInput 2, or its clock is another than ours.
    """

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._moved: deque[tuple[str, bool, int]] = deque(maxlen=_MAX_KEY_TIMES)  # key, down, server's time
        self._positions = read_key_positions(self._x, self._display)
        self._socket_fd = self._x.XConnectionNumber(self._display)
        try:
            self._listen(ctypes.CDLL("libXi.so.6"))
        except OSError:
            self.close()
            raise

    def of(self, keys: Sequence[tuple[str, bool]]) -> list[int | None]:
        """When these keys moved (name, down), in the order a window received them; None for one that is not found.

        Each is the latest such event before the next one's: what was typed elsewhere lies before, and is forgotten.
        """
        self._read()
        if keys and keys[-1] not in [(key, down) for key, down, _ in self._moved]:
            select.select([self._socket_fd], [], [], _EVENT_TIMEOUT_S)
            self._read()
        heard = list(self._moved)
        places: list[int | None] = []
        before = len(heard)
        for wanted in reversed(keys):
            place = next((place for place in range(before - 1, -1, -1) if heard[place][:2] == wanted), None)
            before = before if place is None else place
            places.append(place)
        last = max((place for place in places if place is not None), default=-1)
        self._moved = deque(heard[last + 1 :], maxlen=_MAX_KEY_TIMES)
        return [
            None if place is None else convert_server_time(heard[place][2], self._clock) for place in reversed(places)
        ]

    def _listen(self, xi: Any) -> None:
        display, window = ctypes.c_void_p, ctypes.c_ulong
        xi.XIQueryVersion.argtypes = display, *[ctypes.POINTER(ctypes.c_int)] * 2
        xi.XISelectEvents.argtypes = display, window, ctypes.POINTER(_Mask), ctypes.c_int
        major, minor = ctypes.c_int(2), ctypes.c_int(2)
        if xi.XIQueryVersion(self._display, ctypes.byref(major), ctypes.byref(minor)) != 0:
            raise OSError("the X server does not support XInput 2")
        bits = (ctypes.c_ubyte * 4)()
        for kind in (*_RAW_PRESSES, *_RAW_RELEASES):
            bits[kind // 8] |= 1 << kind % 8
        mask = _Mask(_ALL_MASTER_DEVICES, len(bits), ctypes.cast(bits, ctypes.POINTER(ctypes.c_ubyte)))
        xi.XISelectEvents(self._display, self._root, ctypes.byref(mask), 1)
        self._x.XFlush(self._display)

    def _read(self) -> None:
        """Take in what has come."""
        event = _Event()
        while self._x.XPending(self._display):
            self._x.XNextEvent(self._display, ctypes.byref(event))
            cookie: Any = event.cookie
            if event.type != _GENERIC_EVENT or not self._x.XGetEventData(self._display, ctypes.byref(cookie)):
                continue
            raw = ctypes.cast(cookie.data, ctypes.POINTER(_Raw)).contents
            is_key = raw.kind in (_RAW_PRESSES[0], _RAW_RELEASES[0])
            if raw.detail == 1 if not is_key else not raw.flags & _KEY_REPEAT:
                key = key_from_xkb(self._positions.get(raw.detail, ""), raw.detail) if is_key else MAIN_BUTTON
                self._moved.append((key, raw.kind in _RAW_PRESSES, int(raw.time)))
            self._x.XFreeEventData(self._display, ctypes.byref(cookie))
