"""When keys moved, by the X server: it stamps each event as it comes, whatever this process is busy with.

Its stamps are whole milliseconds of the clock that we use too (CLOCK_MONOTONIC), if server and session run on the same
machine; that is tried out once, by having the server stamp something. Structures as in X11/extensions/XInput2.h.
"""

import ctypes
import select
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from minihuman.windows.keys import from_xkb
from minihuman.windows.port import Clock
from minihuman.windows.xkb import positions

SERVER_TIME = "X server's event time, to 1 ms"
ON_RECEIPT = "on receipt: late by as long as a picture takes to draw"

_NS_PER_MS = 1_000_000
_TICKS = 1 << 32  # the server's milliseconds start again there, every 50 days
_OLDEST_MS = 60_000
_PATIENCE_S = 0.002  # the server tells us and the toolkit at once
_KEPT = 4096
_PROPERTY_NOTIFY, _GENERIC_EVENT = 28, 35
_RAW_KEY_PRESS, _RAW_KEY_RELEASE = 13, 14
_ALL_MASTER_DEVICES = 1
_KEY_REPEAT = 1 << 16
_PROPERTY_CHANGE_MASK = 1 << 22


class _Mask(ctypes.Structure):
    _fields_ = (("device", ctypes.c_int), ("length", ctypes.c_int), ("bits", ctypes.POINTER(ctypes.c_ubyte)))


class _Cookie(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("sent", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("extension", ctypes.c_int),
        ("kind", ctypes.c_int),
        ("number", ctypes.c_uint),
        ("data", ctypes.c_void_p),
    )


class _Raw(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("sent", ctypes.c_int),
        ("display", ctypes.c_void_p),
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
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("sent", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("atom", ctypes.c_ulong),
        ("time", ctypes.c_ulong),
        ("state", ctypes.c_int),
    )


class _Event(ctypes.Union):
    _fields_ = (("type", ctypes.c_int), ("cookie", _Cookie), ("property", _Property), ("pad", ctypes.c_long * 24))


def when_ns(server_ms: int, clock: Clock) -> int:
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
            raise OSError("no X server")
        self._root = self._x.XDefaultRootWindow(self._display)
        if not self._same_clock():
            self.close()
            raise OSError("the X server runs on another clock")

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


def server_time_is_ours() -> bool:
    """Whether there is an X server that stamps its events by our own clock."""
    try:
        _Server().close()
    except OSError:
        return False
    return True


class KeyTimes(_Server):
    """Hears of every key from the X server; tells of those only, when they moved, that a window was told of.

    Args:
        clock: the session's.

    Raises:
        OSError: if there is no such server, it does not speak XInput 2, or its clock is another than ours.
    """

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._moved: deque[tuple[str, bool, int]] = deque(maxlen=_KEPT)  # key, down, server's time
        self._positions = positions(self._x, self._display)
        self._line = self._x.XConnectionNumber(self._display)
        try:
            self._listen(ctypes.CDLL("libXi.so.6"))
        except OSError:
            self.close()
            raise

    def of(self, keys: Sequence[tuple[str, bool]]) -> list[int | None]:
        """When these keys moved (name, down), which a window told of in this order; None for one that is not found.

        Each is the latest such event before the next one's: what was typed elsewhere lies before, and is forgotten.
        """
        self._read()
        if keys and keys[-1] not in [(key, down) for key, down, _ in self._moved]:
            select.select([self._line], [], [], _PATIENCE_S)
            self._read()
        heard = list(self._moved)
        places: list[int | None] = []
        before = len(heard)
        for wanted in reversed(keys):
            place = next((place for place in range(before - 1, -1, -1) if heard[place][:2] == wanted), None)
            before = before if place is None else place
            places.append(place)
        last = max((place for place in places if place is not None), default=-1)
        self._moved = deque(heard[last + 1 :], maxlen=_KEPT)
        return [None if place is None else when_ns(heard[place][2], self._clock) for place in reversed(places)]

    def _listen(self, xi: Any) -> None:
        display, window = ctypes.c_void_p, ctypes.c_ulong
        xi.XIQueryVersion.argtypes = display, *[ctypes.POINTER(ctypes.c_int)] * 2
        xi.XISelectEvents.argtypes = display, window, ctypes.POINTER(_Mask), ctypes.c_int
        major, minor = ctypes.c_int(2), ctypes.c_int(2)
        if xi.XIQueryVersion(self._display, ctypes.byref(major), ctypes.byref(minor)) != 0:
            raise OSError("the X server does not speak XInput 2")
        bits = (ctypes.c_ubyte * 4)()
        for kind in (_RAW_KEY_PRESS, _RAW_KEY_RELEASE):
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
            if raw.kind in (_RAW_KEY_PRESS, _RAW_KEY_RELEASE) and not raw.flags & _KEY_REPEAT:
                key = from_xkb(self._positions.get(raw.detail, ""), raw.detail)
                self._moved.append((key, raw.kind == _RAW_KEY_PRESS, int(raw.time)))
            self._x.XFreeEventData(self._display, ctypes.byref(cookie))
