"""Names and labels of physical keys, shared by protocols, logs and figures.

A name says where a key is, not what it types: "1" is the first key of the digit row on every layout.
"""

from collections.abc import Mapping

DIGITS = tuple("1234567890")
LETTERS = tuple("abcdefghijklmnopqrstuvwxyz")
ARROWS = ("up", "down", "left", "right")
KEYPAD = (
    *(f"kp_{digit}" for digit in DIGITS),
    "kp_enter",
    "kp_plus",
    "kp_minus",
    "kp_multiply",
    "kp_divide",
    "kp_period",
)
FUNCTION = tuple(f"f{number}" for number in range(1, 13))
EDITING = (
    "space",
    "enter",
    "escape",
    "tab",
    "backspace",
    "insert",
    "delete",
    "home",
    "end",
    "page_up",
    "page_down",
)
PUNCTUATION = (
    "minus",
    "equals",
    "left_bracket",
    "right_bracket",
    "backslash",
    "semicolon",
    "quote",
    "grave",
    "comma",
    "period",
    "slash",
)
MODIFIERS = (
    "left_shift",
    "right_shift",
    "left_ctrl",
    "right_ctrl",
    "left_alt",
    "right_alt",
    "caps_lock",
    "num_lock",
)

KEY_NAMES = frozenset(DIGITS + LETTERS + ARROWS + KEYPAD + FUNCTION + EDITING + PUNCTUATION + MODIFIERS)
KEY_NAMES_TEXT = f"0 to 9, a to z, f1 to f12, kp_0 to kp_9, {', '.join((*ARROWS, *EDITING, *PUNCTUATION, *MODIFIERS))}"
RESERVED_KEYS = frozenset(
    {"escape", "enter", "f8", "f9", "f12"}
)  # the session's own: quit question, go on, pause, and the abort chord f9+f12

_LABELS: Mapping[str, str] = {
    "up": "↑",
    "down": "↓",
    "left": "←",
    "right": "→",
    "minus": "-",
    "equals": "=",
    "left_bracket": "[",
    "right_bracket": "]",
    "backslash": "\\",
    "semicolon": ";",
    "quote": "'",
    "grave": "`",
    "comma": ",",
    "period": ".",
    "slash": "/",
    "kp_plus": "+",
    "kp_minus": "-",
    "kp_multiply": "*",
    "kp_divide": "/",
    "kp_period": ".",
    "kp_enter": "Enter",
    "page_up": "Page up",
    "page_down": "Page down",
    "left_ctrl": "Ctrl",
    "right_ctrl": "Ctrl",
    "left_shift": "Shift",
    "right_shift": "Shift",
    "left_alt": "Alt",
    "right_alt": "Alt",
    "caps_lock": "Caps",
    "num_lock": "Num",
}


def key_label(key: str) -> str:
    """What is printed on a key of an English keyboard."""
    if key in _LABELS:
        return _LABELS[key]
    plain = key.removeprefix("kp_").replace("_", " ")
    return plain.upper() if len(plain) == 1 else plain.capitalize()


def key_caption(key: str) -> str:
    """What tells a key from another with the same label: "keypad", "left"; "" for most."""
    if key in KEYPAD:
        return "keypad"
    side, _, rest = key.partition("_")
    return side if rest in ("shift", "ctrl", "alt") else ""
