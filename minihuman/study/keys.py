"""Our names for physical keys: the one vocabulary of protocol, log and figure.

A name says where a key is, not what it types: "1" is the digit row's first key on every layout.
"""

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
KEYS_IN_WORDS = f"0 to 9, a to z, f1 to f12, kp_0 to kp_9, {', '.join((*ARROWS, *EDITING, *PUNCTUATION, *MODIFIERS))}"
RESERVED = frozenset(
    {"escape", "enter", "f8", "f9", "f12"}
)  # the session's own: quit question, go on, pause, and the abort chord f9+f12
