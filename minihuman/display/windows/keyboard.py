"""The names of keys by their positions on the keyboard, from what each toolkit reports.

SDL reports USB positions (scancodes), X11 reports the names of positions through XKB, and pyglet on other systems
reports only symbols. A key that has no name here is named by its number, so that it still reaches the log. The meaning
of an X keycode depends on the server, while the name of a position ("AE01": row E, first key) is the same everywhere.
Structures and masks follow X11/extensions/XKBstr.h and XKB.h.
"""

import ctypes
from collections.abc import Mapping
from typing import Any

from minihuman.experiment.keys import DIGITS, FUNCTION, KEY_NAMES, LETTERS


def _number_names(first: int, names: tuple[str, ...]) -> dict[int, str]:
    """Return names by consecutive numbers, of which ``first`` is the first."""
    return {first + offset: name for offset, name in enumerate(names)}


# USB HID Usage Tables 1.5, page 0x07: what SDL calls a scancode.
_BY_SCANCODE: Mapping[int, str] = (
    _number_names(4, LETTERS)
    | _number_names(30, DIGITS)
    | _number_names(40, ("enter", "escape", "backspace", "tab", "space"))
    | _number_names(45, ("minus", "equals", "left_bracket", "right_bracket", "backslash"))
    | _number_names(51, ("semicolon", "quote", "grave", "comma", "period", "slash", "caps_lock"))
    | _number_names(58, FUNCTION)
    | _number_names(73, ("insert", "home", "page_up", "delete", "end", "page_down"))
    | _number_names(79, ("right", "left", "down", "up", "num_lock"))
    | _number_names(84, ("kp_divide", "kp_multiply", "kp_minus", "kp_plus", "kp_enter"))
    | _number_names(89, tuple(f"kp_{digit}" for digit in DIGITS))
    | {99: "kp_period"}
    | _number_names(224, ("left_ctrl", "left_shift", "left_alt"))
    | _number_names(228, ("right_ctrl", "right_shift", "right_alt"))
)


def _name_positions_of_row(letter: str, names: str) -> dict[str, str]:
    """Return the names of a row's keys by XKB's names of their positions, such as "AE01" for row E's first key."""
    return {f"A{letter}{number:02}": name for number, name in enumerate(names.split(), start=1)}


# XKB's names of positions (xkeyboard-config, keycodes/evdev): row A is the space bar's, E the digits'.
_BY_XKB: Mapping[str, str] = (
    _name_positions_of_row("E", "1 2 3 4 5 6 7 8 9 0 minus equals")
    | _name_positions_of_row("D", "q w e r t y u i o p left_bracket right_bracket")
    | _name_positions_of_row("C", "a s d f g h j k l semicolon quote")
    | _name_positions_of_row("B", "z x c v b n m comma period slash")
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
    """Return the key name of an SDL scancode; "scancode_50" for a key without a name."""
    return _BY_SCANCODE.get(scancode, f"scancode_{scancode}")


def key_to_scancode(key: str) -> int:
    """Return the SDL scancode of a key name.

    Raises:
        StopIteration: if no scancode has that name.
    """
    return next(scancode for scancode, name in _BY_SCANCODE.items() if name == key)


def key_from_xkb(position: str, keycode: int) -> str:
    """Return the key name of an XKB position; "keycode_94" for a key without a name."""
    return _BY_XKB.get(position, f"keycode_{keycode}")


def key_from_symbol(name: str) -> str:
    """Return the key name of a pyglet symbol by its place on a US keyboard; "symbol_plus" for a key without a name."""
    key = _BY_SYMBOL.get(name, name.lower())
    if key in KEY_NAMES:
        return key
    return f"symbol_{name.lower()}"


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
    """Return the X server's position ("AE01", "SPCE") of each keycode; {} if the server does not support XKB.

    Args:
        xlib: the loaded library libX11
        display: a pointer to the open ``Display``
    """
    opaque = ctypes.cast(display, ctypes.c_void_p)
    description = ctypes.POINTER(_Description)
    get_map = _declare_types(xlib.XkbGetMap, description, ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)
    get_names = _declare_types(xlib.XkbGetNames, ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, description)
    free = _declare_types(xlib.XkbFreeKeyboard, None, description, ctypes.c_uint, ctypes.c_int)
    keyboard_pointer = get_map(opaque, 0, _USE_CORE_KEYBOARD)
    if not keyboard_pointer:
        return {}
    try:
        if get_names(opaque, _KEY_NAMES_MASK, keyboard_pointer) != 0:
            return {}
        keyboard = keyboard_pointer.contents
        names = keyboard.names.contents.keys
        codes = range(keyboard.min_key_code, keyboard.max_key_code + 1)
        return {code: names[code].raw.rstrip(b"\0").decode("ascii") for code in codes if names[code].raw.strip(b"\0")}
    finally:
        free(keyboard_pointer, 0, 1)  # 1: all of it, whatever the mask of components


def _declare_types(function: Any, returns: Any, *takes: Any) -> Any:
    """Declare the types that a C function returns and takes, and return the function."""
    function.restype = returns
    function.argtypes = takes
    return function
