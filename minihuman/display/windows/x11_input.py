"""The X server's record of key and mouse-button events: their times, and whether the window had the focus.

The X server stamps each event when it occurs, even while this process is busy. Its stamps are whole milliseconds of
CLOCK_MONOTONIC, the session's clock, if the server and the session run on the same machine. This is checked once, by
requesting a stamp from the server. Structures and masks follow X11/extensions/XInput2.h.
"""

import ctypes
import select
import time
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from minihuman.display.windows.keyboard import key_from_xkb, read_key_positions
from minihuman.display.windows.window import Clock

SERVER_TIME = "X server's event time, to 1 ms"
ON_RECEIPT = "on receipt: late by as long as a picture takes to draw"

_NS_PER_MS = 1_000_000
_TICKS = 1 << 32  # the server's milliseconds start again at 0 after so many, every 50 days
_OLDEST_MS = 60_000  # an older stamp cannot be correct
_EVENT_TIMEOUT_S = 0.002  # the server tells us and the toolkit at once
_MAX_KEY_TIMES = 4096
_MAX_PRESSES = 64  # of one key
_LEAST_KEYCODE = 8
_KEYCODES = 256
_FOCUS_IN = 9
_FOCUS_OUT = 10
_PROPERTY_NOTIFY = 28
_MAPPING_NOTIFY = 34
_GENERIC_EVENT = 35
_ALT_GRAPH_KEYSYMS = (0xFE03, 0xFF7E)  # ISO_Level3_Shift, Mode_switch
_FOCUS_DETAILS_OF_OTHERS = (2, 5, 6, 7)  # Inferior, Pointer, PointerRoot, DetailNone: the window's focus stays
_FOCUS_CHANGE_MASK = 1 << 21
_RAW_PRESSES = (13, 15)  # of a key, of a button
_RAW_RELEASES = (14, 16)
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


class _Focus(ctypes.Structure):
    _fields_ = (
        *_EVENT_HEAD,
        ("window", ctypes.c_ulong),
        ("mode", ctypes.c_int),
        ("detail", ctypes.c_int),
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
    _fields_ = (
        ("type", ctypes.c_int),
        ("cookie", _Cookie),
        ("property", _Property),
        ("focus", _Focus),
        ("pad", ctypes.c_long * 24),
    )


def convert_server_time(server_ms: int, clock: Clock) -> int:
    """Return the session time in nanoseconds of an event that the X server stamped with a time in milliseconds.

    It is never early, and at most a millisecond late. For a stamp that cannot be correct (in the future, or over a
    minute old), return the present time.
    """
    now_ns = clock()
    monotonic_ns = time.monotonic_ns()
    age_ms = (monotonic_ns // _NS_PER_MS - server_ms) % _TICKS
    if age_ms > _OLDEST_MS:
        return now_ns
    # The event happened within the millisecond that the stamp names; the end of that millisecond is never early.
    stamped_ns = monotonic_ns - monotonic_ns % _NS_PER_MS - age_ms * _NS_PER_MS
    return now_ns - max(0, monotonic_ns - stamped_ns - _NS_PER_MS)


class _Server:
    """A separate connection to an X server that uses the same clock as the session.

    Raises:
        OSError: if there is no such server, or it uses another clock.
    """

    def __init__(self) -> None:
        self._x = ctypes.CDLL("libX11.so.6")
        self._declare_functions()
        self._display = ctypes.c_void_p(self._x.XOpenDisplay(None))
        if not self._display:
            raise OSError("no X server is available")
        self._root = self._x.XDefaultRootWindow(self._display)
        if not self._has_session_clock():
            self.close()
            raise OSError(
                "the X server's clock is not this machine's, so it cannot time key presses; "
                "use an X server on this machine"
            )

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        if self._display:
            self._x.XCloseDisplay(self._display)
            self._display = ctypes.c_void_p()

    def _declare_functions(self) -> None:
        """Declare the types of the functions of Xlib that are called."""
        display = ctypes.c_void_p
        window = ctypes.c_ulong
        event = ctypes.POINTER(_Event)
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
            ("XRefreshKeyboardMapping", ctypes.c_int, event),
            ("XkbKeycodeToKeysym", ctypes.c_ulong, display, ctypes.c_ubyte, ctypes.c_int, ctypes.c_int),
            ("XQueryKeymap", ctypes.c_int, display, ctypes.POINTER(ctypes.c_ubyte)),
            ("XGetInputFocus", ctypes.c_int, display, ctypes.POINTER(window), ctypes.POINTER(ctypes.c_int)),
        )  # fmt: skip
        for name, returns, *takes in functions:
            function = self._x[name]  # a new object, so that declarations elsewhere in this process stay as they are
            function.restype = returns
            function.argtypes = takes
            setattr(self._x, name, function)

    def _has_session_clock(self) -> bool:
        """Return whether the server's stamp of an event lies between the session's times before and after it."""
        window = self._x.XCreateSimpleWindow(self._display, self._root, 0, 0, 1, 1, 0, 0, 0)  # 1 x 1 px, never shown
        self._x.XSelectInput(self._display, window, _PROPERTY_CHANGE_MASK)
        atom = self._x.XInternAtom(self._display, b"MINIHUMAN_TIME", 0)
        before_ms = time.monotonic_ns() // _NS_PER_MS
        self._x.XChangeProperty(self._display, window, atom, atom, 8, 0, b"", 0)  # no bytes, but it causes an event
        event = _Event()
        while event.type != _PROPERTY_NOTIFY:
            self._x.XNextEvent(self._display, ctypes.byref(event))
        after_ms = time.monotonic_ns() // _NS_PER_MS
        self._x.XDestroyWindow(self._display, window)
        return bool((event.property.time - before_ms) % _TICKS <= after_ms - before_ms)


def has_shared_clock() -> bool:
    """Return whether there is an X server that stamps events with the session's clock."""
    try:
        _Server().close()
    except OSError:
        return False
    return True


@dataclass(slots=True)
class _Move:
    """A press or release of a key or of the main mouse button."""

    key: str
    down: bool
    server_ms: int
    is_in_window: bool  # the window had the focus; False too of a press that was still down when the focus came


class KeyMove(NamedTuple):
    """The time of a key's press or release, and whether it was made in the window.

    The fields are None and True if the server does not report the event.
    """

    t_ns: int | None
    is_in_window: bool


def _match_moves(keys: Sequence[tuple[str, bool]], recorded: Sequence[_Move]) -> list[int | None]:
    """Return the index in the record of each key event (name, down); None if the record does not have it.

    Each is the latest matching event before that of the following key event.
    """
    newest_first: list[int | None] = []
    end = len(recorded)
    for key_move in reversed(keys):
        index = _find_last_move(key_move, recorded[:end])
        if index is not None:
            end = index
        newest_first.append(index)
    return newest_first[::-1]


def _find_last_move(key_move: tuple[str, bool], recorded: Sequence[_Move]) -> int | None:
    """Return the index of the latest recorded press or release that matches a key event; None if there is none."""
    for index in range(len(recorded) - 1, -1, -1):
        if (recorded[index].key, recorded[index].down) == key_move:
            return index
    return None


class X11InputRecord(_Server):
    """A record of the events of keys and the main mouse button, with whether the window had the focus at each.

    The server sends these events, and the window's focus changes, in the order in which they happened.

    Args:
        clock: the session's clock
        window: the X server's id of the window

    Raises:
        OSError: if there is no such server, it does not support XInput 2, or it uses another clock.
    """

    def __init__(self, clock: Clock, window: int) -> None:
        super().__init__()
        self._clock = clock
        self._moves: deque[_Move] = deque(maxlen=_MAX_KEY_TIMES)  # that no window has received yet
        self._presses: dict[str, deque[_Move]] = defaultdict(lambda: deque(maxlen=_MAX_PRESSES))
        self._down: set[str] = set()
        self._focused = False
        self._focus_is_new = False
        self._positions = read_key_positions(self._x, self._display)
        self._socket_fd = self._x.XConnectionNumber(self._display)
        try:
            self._select_raw_events(ctypes.CDLL("libXi.so.6"))
        except OSError:
            self.close()
            raise
        self._watch_focus(window)

    def find_moves(self, keys: Sequence[tuple[str, bool]]) -> list[KeyMove]:
        """Return the recorded time of key events (name, down), given in the order in which a window received them.

        Each is the latest matching event before that of the following one; earlier events were typed in other windows
        and are discarded. For a press that the toolkit invented, the record of the key's last press is used.
        """
        self._read_events()
        if keys and keys[-1] not in [(move.key, move.down) for move in self._moves]:
            self._wait_for_events()
        recorded = list(self._moves)
        matches = _match_moves(keys, recorded)
        last = max((index for index in matches if index is not None), default=-1)
        self._moves = deque(recorded[last + 1 :], maxlen=_MAX_KEY_TIMES)
        moves: list[KeyMove] = []
        for (key, down), index in zip(keys, matches, strict=True):
            if index is None:
                moves.append(self._describe_unrecorded(key, down))
            else:
                moves.append(self._describe_recorded(recorded[index]))
        return moves

    def _describe_recorded(self, move: _Move) -> KeyMove:
        return KeyMove(convert_server_time(move.server_ms, self._clock), move.is_in_window)

    def _describe_unrecorded(self, key: str, down: bool) -> KeyMove:
        """Return the record of an event that the server does not report, according to the last press of its key."""
        presses = self._presses.get(key)
        if down and presses:
            return KeyMove(None, presses[-1].is_in_window)
        return KeyMove(None, True)

    def is_press_in_window(self, key: str, server_ms: int) -> bool:
        """Return whether a press that a window received at a time of the server was made while it had the focus.

        A repeat counts like the first press. A press that the server did not report counts as made in the window.
        """
        self._read_events()
        if not any(move.server_ms == server_ms for move in self._presses[key]):
            self._wait_for_events()
        for press in reversed(self._presses[key]):
            elapsed_ms = (server_ms - press.server_ms) % _TICKS
            is_earlier = elapsed_ms < _TICKS // 2  # times start again at 0
            if is_earlier:
                return press.is_in_window
        return True

    @property
    def is_focused(self) -> bool:
        """Whether the window has the focus."""
        self._read_events()
        return self._focused

    @property
    def has_alt_graph(self) -> bool:
        """Whether the right Alt key types letters on the current layout, so that it does not make shortcuts."""
        self._read_events()
        codes = {name: code for code, name in self._positions.items()}
        keycode = 0
        for name in ("LVL3", "ALGR", "RALT"):  # the last that exists; "LVL3" is no real key and types AltGr everywhere
            keycode = codes.get(name, keycode)
        # of the first layout, without Shift
        return self._x.XkbKeycodeToKeysym(self._display, keycode, 0, 0) in _ALT_GRAPH_KEYSYMS

    def is_down(self, key: str) -> bool:
        """Return whether a key is down, regardless of the window in which it was pressed."""
        self._read_events()
        return key in self._down

    def find_held_keys(self) -> list[str]:
        """Return the keys that were down when the window got the focus and are still down."""
        self._read_events()
        if not self._focus_is_new:
            self._wait_for_events()
        self._focus_is_new = False
        return [key for key in sorted(self._down) if key != MAIN_BUTTON and not self._presses[key][-1].is_in_window]

    def _select_raw_events(self, xi: Any) -> None:
        """Ask the X server for the raw presses and releases of all keyboards and mice.

        Raises:
            OSError: if the server does not support XInput 2.
        """
        display = ctypes.c_void_p
        window = ctypes.c_ulong
        xi.XIQueryVersion.argtypes = display, *[ctypes.POINTER(ctypes.c_int)] * 2
        xi.XISelectEvents.argtypes = display, window, ctypes.POINTER(_Mask), ctypes.c_int
        major = ctypes.c_int(2)
        minor = ctypes.c_int(2)
        if xi.XIQueryVersion(self._display, ctypes.byref(major), ctypes.byref(minor)) != 0:
            raise OSError("the X server does not support XInput 2")
        bits = (ctypes.c_ubyte * 4)()
        for kind in (*_RAW_PRESSES, *_RAW_RELEASES):
            byte, bit = divmod(kind, 8)
            bits[byte] |= 1 << bit
        mask = _Mask(_ALL_MASTER_DEVICES, len(bits), ctypes.cast(bits, ctypes.POINTER(ctypes.c_ubyte)))
        xi.XISelectEvents(self._display, self._root, ctypes.byref(mask), 1)
        self._x.XFlush(self._display)

    def _watch_focus(self, window: int) -> None:
        """Record focus changes of a window from now on; keys that are down now count as pressed before the focus."""
        self._x.XSelectInput(self._display, window, _FOCUS_CHANGE_MASK)
        keys_down = (ctypes.c_ubyte * (_KEYCODES // 8))()
        self._x.XQueryKeymap(self._display, keys_down)
        focus = ctypes.c_ulong()
        revert_to = ctypes.c_int()
        self._x.XGetInputFocus(self._display, ctypes.byref(focus), ctypes.byref(revert_to))
        self._focused = focus.value == window
        now_ms = time.monotonic_ns() // _NS_PER_MS % _TICKS
        for keycode in range(_LEAST_KEYCODE, _KEYCODES):
            byte, bit = divmod(keycode, 8)
            if keys_down[byte] & (1 << bit):
                self._add_move(_Move(self._name_key(keycode), True, now_ms, is_in_window=False))  # True: it is down

    def _name_key(self, keycode: int) -> str:
        return key_from_xkb(self._positions.get(keycode, ""), keycode)

    def _wait_for_events(self) -> None:
        """Wait briefly for the server, which can report an event to the toolkit before it reports it here."""
        select.select([self._socket_fd], [], [], _EVENT_TIMEOUT_S)
        self._read_events()

    def _read_events(self) -> None:
        """Record all events that have arrived."""
        event = _Event()
        while self._x.XPending(self._display):
            self._x.XNextEvent(self._display, ctypes.byref(event))
            if event.type in (_FOCUS_IN, _FOCUS_OUT):
                self._change_focus(event.focus)
                continue
            if event.type == _MAPPING_NOTIFY:  # another layout
                self._x.XRefreshKeyboardMapping(ctypes.byref(event))
            cookie: Any = event.cookie
            if event.type != _GENERIC_EVENT or not self._x.XGetEventData(self._display, ctypes.byref(cookie)):
                continue
            raw = ctypes.cast(cookie.data, ctypes.POINTER(_Raw)).contents
            name = self._name_raw_event(raw)
            if name is not None:
                self._add_move(_Move(name, raw.kind in _RAW_PRESSES, int(raw.time), self._focused))
            self._x.XFreeEventData(self._display, ctypes.byref(cookie))

    def _name_raw_event(self, raw: "_Raw") -> str | None:
        """Return the name of an event's key or "main_button"; None for a repeat or another button."""
        if raw.kind in (_RAW_PRESSES[0], _RAW_RELEASES[0]):
            if raw.flags & _KEY_REPEAT:
                return None
            return self._name_key(raw.detail)
        if raw.detail == 1:  # the number of the main button
            return MAIN_BUTTON
        return None

    def _change_focus(self, event: "_Focus") -> None:
        """Record whether the window got or lost the focus; keys that are down when it gets it were pressed elsewhere.

        A window manager that grabs the keyboard takes the focus, too, and the keys typed then are its own.
        """
        if event.detail in _FOCUS_DETAILS_OF_OTHERS:
            return
        self._focused = self._focus_is_new = event.type == _FOCUS_IN
        if self._focused:
            for key in self._down:
                self._presses[key][-1].is_in_window = False

    def _add_move(self, move: _Move) -> None:
        """Record a press or a release."""
        self._moves.append(move)
        if move.down:
            self._presses[move.key].append(move)
            self._down.add(move.key)
        else:
            self._down.discard(move.key)
