"""Physical keys: their names and labels, for protocols, logs and figures, and default keys for a world's actions."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


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
KEY_NAMES_TEXT = (
    f"0 to 9, a to z, f1 to f12, kp_0 to kp_9, {', '.join((*ARROWS, *EDITING, *PUNCTUATION, *MODIFIERS))}; "
    "a gamepad's buttons pad_south, pad_up and so on"
)
PAD_BUTTONS = (  # of the standard layout (W3C Gamepad): "south" is Xbox's A, PlayStation's cross
    *("pad_south", "pad_east", "pad_west", "pad_north"),
    *("pad_left_shoulder", "pad_right_shoulder", "pad_left_trigger", "pad_right_trigger"),
    *("pad_left_stick", "pad_right_stick", "pad_up", "pad_down", "pad_left", "pad_right"),
    *("stick_up", "stick_down", "stick_left", "stick_right"),  # the left stick, more than halfway
)
PAD_AXES = ("pad_left_x", "pad_left_y", "pad_right_x", "pad_right_y", "pad_left_trigger", "pad_right_trigger")
MOUSE_AXES = ("mouse_x", "mouse_y")  # of a mouse that is captured: whole pixels, which add up from tick to tick
TOUCH_AXES = ("touch_left_x", "touch_left_y", "touch_right_x", "touch_right_y")  # of the sticks on a touch screen
AXES = PAD_AXES + MOUSE_AXES + TOUCH_AXES
PAD_DEAD_ZONE = 0.1  # of an axis; beyond it the logged number rises from 0
PAD_LEVELS = 128  # levels at which an axis is logged, in each direction
_PRESS_THRESHOLD = 0.5  # of an axis's value, beyond which its button goes down
_RELEASE_THRESHOLD = 0.4  # below it, so that the button does not flutter
BUTTON_NAMES = KEY_NAMES.union(PAD_BUTTONS)
# The session's own keys: the quit question, going on, the pause, and the abort chord f9+f12.
RESERVED_KEYS = frozenset({"escape", "enter", "f8", "f9", "f12"})

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
    **{
        f"pad_{place}": f"Pad {letter}"
        for place, letter in zip(("south", "east", "west", "north"), "ABXY", strict=True)
    },
    **{
        f"{device.lower()}_{way}": f"{device} {arrow}"
        for device in ("Pad", "Stick")
        for way, arrow in zip(ARROWS, "▲▼◀▶", strict=True)
    },
    **{
        f"pad_{side}_{part}": f"Pad {side[0].upper()}{number}"
        for side in ("left", "right")
        for number, part in enumerate(("shoulder", "trigger", "stick"), 1)
    },
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


def list_pad_inputs(names: Iterable[str]) -> list[str]:
    """Return the given names that are buttons or axes of a gamepad."""
    return [name for name in names if name in PAD_BUTTONS or name in PAD_AXES]


class PadAxes:
    """The axes of a gamepad as they are logged.

    Values within a dead zone count as 0, others are rounded to steps. The left stick also acts as four buttons.
    """

    def __init__(self) -> None:
        self._values: dict[str, float] = {}
        self._buttons: set[str] = set()

    @property
    def moved(self) -> list[str]:
        """Return the names of the axes that are not at rest."""
        return [axis for axis, value in self._values.items() if value]

    def move(self, axis: str, raw: float) -> tuple[float | None, list[tuple[str, bool]]]:
        """Move an axis; return its new value, None if unchanged, and the changed buttons, each with True for a press.

        Args:
            axis: one of `PAD_AXES`.
            raw: the axis's raw value from -1 to 1; right and down are positive.
        """
        level = _quantise_axis(raw)
        if level == self._values.get(axis, 0.0):
            return None, []
        self._values[axis] = level
        changed_buttons = []
        for button, direction in _find_axis_buttons(axis):
            was_down = button in self._buttons
            threshold = _RELEASE_THRESHOLD if was_down else _PRESS_THRESHOLD
            is_down = level * direction > threshold
            if is_down == was_down:
                continue
            if is_down:
                self._buttons.add(button)
            else:
                self._buttons.discard(button)
            changed_buttons.append((button, is_down))
        return level, changed_buttons


def _quantise_axis(raw: float) -> float:
    """Return a gamepad axis's raw value as it is logged: -1 to 1 in steps of 1 / `PAD_LEVELS`, 0 in the dead zone."""
    beyond_dead_zone = max(0.0, min(1.0, abs(raw)) - PAD_DEAD_ZONE) / (1.0 - PAD_DEAD_ZONE)
    level = round(beyond_dead_zone * PAD_LEVELS)
    if raw < 0:
        level = -level
    return level / PAD_LEVELS


def _find_axis_buttons(axis: str) -> tuple[tuple[str, int], ...]:
    """Return the buttons that a gamepad's axis presses, each with the sign of the axis values that press it."""
    match axis:
        case "pad_left_x":
            return ("stick_left", -1), ("stick_right", 1)
        case "pad_left_y":
            return ("stick_up", -1), ("stick_down", 1)
        case _ if axis in PAD_BUTTONS:
            return ((axis, 1),)
    return ()


def key_label(key: str) -> str:
    """Return the label of a key on an English keyboard or of a gamepad's button, such as "Enter" for "kp_enter"."""
    if key in _LABELS:
        return _LABELS[key]
    label = key.removeprefix("kp_").replace("_", " ")
    if len(label) == 1:
        return label.upper()
    return label.capitalize()


def key_caption(key: str) -> str:
    """Return the word that distinguishes a key from another with the same label, such as "keypad"; "" for most keys."""
    if key in KEYPAD:
        return "keypad"
    side, _, modifier = key.partition("_")
    if modifier in ("shift", "ctrl", "alt"):
        return side
    return ""


# The usual keys of the actions of Minigrid, Miniworld, the arcade and Gymnasium's classic worlds, and of the axes of a
# vector. The first of the keys that is free is used.
_USUAL_KEYS: Mapping[str, str] = {
    "left": "left",
    "turn_left": "left",
    "move_left": "left",
    "west": "left",
    "w": "left",
    "left_engine": "left",
    "right": "right",
    "turn_right": "right",
    "move_right": "right",
    "east": "right",
    "e": "right",
    "right_engine": "right",
    "forward": "up",
    "move_forward": "up",
    "up": "up",
    "move_up": "up",
    "north": "up",
    "n": "up",
    "main_engine": "up",
    "down": "down",
    "move_down": "down",
    "south": "down",
    "s": "down",
    "move_back": "down",
    "pickup": "page_up",
    "drop": "page_down",
    "toggle": "space",
    "interact": "space",
    "fire": "space",
    "do": "space",
    "done": "end",
    "axis_0_minus": "left",
    "axis_0_plus": "right",
    "axis_1_plus": "up",
    "axis_1_minus": "down",
    "axis_2_minus": "a",
    "axis_2_plus": "down d",  # a brake, where the accelerator has one direction
    "axis_3_plus": "w",
    "axis_3_minus": "s",
}
_OTHER_KEYS = (*DIGITS, *"qertyfghjklzxcvbnm")
_NOOPS = ("rest", "noop", "no-op", "no_op", "idle", "stay")
_MIN_PERIOD_MS = 1000 / 60
_MAX_PERIOD_MS = 1000.0
_USUAL_FPS = 30.0
_ARCADE_FPS = 60.0  # of the Arcade Learning Environment's single frames


def assign_keys(actions: Sequence[str]) -> dict[str, str]:
    """Assign a key to each action.

    An action whose name suggests an arrow or a similar key gets that key if it is free; the others get digits and
    letters in order. Actions that come after the last digit and letter get no key.

    Returns:
        The action of each key.
    """
    action_of_key: dict[str, str] = {}
    for action in actions:
        usual_key = next((key for key in _USUAL_KEYS.get(action, "").split() if key not in action_of_key), None)
        if usual_key is not None:
            action_of_key[usual_key] = action
    free_keys = iter([key for key in _OTHER_KEYS if key not in action_of_key])
    for action in actions:
        if action not in action_of_key.values():
            key = next(free_keys, None)
            if key is not None:
                action_of_key[key] = action
    return action_of_key


def assign_usual_keys(world: "World") -> dict[str, str]:
    """Return the action of each key, as `assign_keys`; a world's no-op gets no key unless it is the only action."""
    noop = find_noop(world)
    names = [world.action_names[number] for number in world.actions.numbers]
    return assign_keys([name for name in names if name != noop or len(names) == 1])


def find_noop(world: "World") -> str | None:
    """Return the name of a world's action that does nothing, such as "noop"; None if no name says so."""
    names = {name.lower(): name for name in world.action_names}
    return next((names[noop] for noop in _NOOPS if noop in names), None)


def find_period_ms(world: "World") -> float | None:
    """Return the time between the steps of a real-time world in milliseconds, from its frame rate; None for others.

    A world counts as real-time if its actions are vectors or if one of them is to do nothing. The time is limited to
    the range from 1/60 s to 1 s.
    """
    if world.actions.is_discrete and find_noop(world) is None:
        return None
    config = getattr(world.unwrapped, "config", None)  # highway-env's: a policy acts less often than frames are drawn
    policy_hz = config.get("policy_frequency") if isinstance(config, dict) else None
    step_hz = float(policy_hz or world.env.metadata.get("render_fps") or _USUAL_FPS)
    frames_per_step = getattr(world.unwrapped, "_frameskip", 1)  # the arcade's, in which a step is several frames
    if isinstance(frames_per_step, int) and frames_per_step > 1:
        step_hz = _ARCADE_FPS / frames_per_step
    return min(max(1000 / step_hz, _MIN_PERIOD_MS), _MAX_PERIOD_MS)
