"""What is printed on keys."""

from collections.abc import Mapping

from minihuman.study.keys import KEYPAD

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


def label(key: str) -> str:
    """What is printed on a key of an English keyboard."""
    if key in _LABELS:
        return _LABELS[key]
    plain = key.removeprefix("kp_").replace("_", " ")
    return plain.upper() if len(plain) == 1 else plain.capitalize()


def caption_word(key: str) -> str:
    """What tells a key from another with the same label: "keypad", "left"; "" for most."""
    if key in KEYPAD:
        return "keypad"
    side, _, rest = key.partition("_")
    return side if rest in ("shift", "ctrl", "alt") else ""
