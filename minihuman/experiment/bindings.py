"""Bindings: which keys an environment is played with where nobody has chosen any, and how fast it steps then."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from minihuman.experiment.keys import DIGITS

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World

# What players' fingers expect, for the action names of Minigrid, Miniworld, the arcade and Gymnasium's classics, and
# for the axes of a vector: the first of the keys that is free.
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
_MIN_PERIOD_MS, _MAX_PERIOD_MS = 1000 / 60, 1000.0
_USUAL_FPS = 30.0


def assign_keys(actions: Sequence[str]) -> dict[str, str]:
    """A key for each action: the arrows and their like where the name says so, else digits and letters in order."""
    keys: dict[str, str] = {}
    for action in actions:
        usual = next((key for key in _USUAL_KEYS.get(action, "").split() if key not in keys), None)
        if usual is not None:
            keys[usual] = action
    others = iter(key for key in _OTHER_KEYS if key not in keys)
    for action in actions:
        if action not in keys.values():
            key = next(others, None)
            if key is not None:
                keys[key] = action
    return keys


def assign_usual_keys(world: "World") -> dict[str, str]:
    """A key for each of a world's actions but what happens without a key."""
    noop = find_noop(world)
    names = [world.action_names[number] for number in world.actions.numbers]
    return assign_keys([name for name in names if name != noop or len(names) == 1])


def find_noop(world: "World") -> str | None:
    """The action that is done where no key is down; None where the world has none."""
    names = {name.lower(): name for name in world.action_names}
    return next((names[noop] for noop in _NOOPS if noop in names), None)


def find_period_ms(world: "World") -> float | None:
    """The time between steps of a world that moves by itself, from its frame rate; None for one that waits for keys.

    A world moves by itself where its actions are vectors, or one of them is to do nothing.
    """
    if world.actions.is_discrete and find_noop(world) is None:
        return None
    skipped = getattr(world.unwrapped, "_frameskip", 1)  # the arcade's: its rate is that of single frames
    decides = getattr(world.unwrapped, "config", None)  # highway-env's: a policy acts less often than frames are drawn
    rate = decides.get("policy_frequency") if isinstance(decides, dict) else None
    fps = float(rate or world.env.metadata.get("render_fps") or _USUAL_FPS)
    if isinstance(skipped, int) and skipped > 1:
        fps = 60.0 / skipped
    return min(max(1000 / fps, _MIN_PERIOD_MS), _MAX_PERIOD_MS)
