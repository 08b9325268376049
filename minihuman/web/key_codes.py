"""Our names of physical keys by the browser's name (`KeyboardEvent.code`); a key without a name is `code_...`."""

from collections.abc import Mapping

from minihuman.experiment.keys import DIGITS, FUNCTION, LETTERS

KEY_CODES: Mapping[str, str] = (
    {f"Digit{digit}": digit for digit in DIGITS}
    | {f"Key{letter.upper()}": letter for letter in LETTERS}
    | {f"Numpad{digit}": f"kp_{digit}" for digit in DIGITS}
    | {name.upper(): name for name in FUNCTION}
    | {f"Arrow{name.capitalize()}": name for name in ("up", "down", "left", "right")}
    | {"NumpadEnter": "kp_enter", "NumpadAdd": "kp_plus", "NumpadSubtract": "kp_minus"}
    | {"NumpadMultiply": "kp_multiply", "NumpadDivide": "kp_divide", "NumpadDecimal": "kp_period"}
    | {"Space": "space", "Enter": "enter", "Escape": "escape", "Tab": "tab", "Backspace": "backspace"}
    | {"Insert": "insert", "Delete": "delete", "Home": "home", "End": "end"}
    | {"PageUp": "page_up", "PageDown": "page_down"}
    | {"Minus": "minus", "Equal": "equals", "BracketLeft": "left_bracket", "BracketRight": "right_bracket"}
    | {"Backslash": "backslash", "Semicolon": "semicolon", "Quote": "quote", "Backquote": "grave"}
    | {"Comma": "comma", "Period": "period", "Slash": "slash"}
    | {"ShiftLeft": "left_shift", "ShiftRight": "right_shift", "ControlLeft": "left_ctrl"}
    | {"ControlRight": "right_ctrl", "AltLeft": "left_alt", "AltRight": "right_alt"}
    | {"CapsLock": "caps_lock", "NumLock": "num_lock"}
)
