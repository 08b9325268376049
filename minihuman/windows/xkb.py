"""Where the keys of an X keyboard are: the XKB names of positions, by keycode.

A keycode is the server's private number; the name of a position ("AE01": row E, first key) is the same everywhere.
Structures and masks as in X11/extensions/XKBstr.h and XKB.h.
"""

import ctypes
from typing import Any

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


def positions(xlib: Any, display: Any) -> dict[int, str]:
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
