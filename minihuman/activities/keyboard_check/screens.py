"""The screens of keyboard checks."""

from collections.abc import Sequence

from minihuman.experiment.machine.screens import TextScreen
from minihuman.experiment.words import InterfaceWords


def build_keyboard_check_screen(words: InterfaceWords, keys: Sequence[str], pressed: frozenset[str]) -> TextScreen:
    """Build the screen that shows, for every key of the pool, whether it has been pressed yet."""
    n_missing = len(set(keys)) - len(pressed)
    if n_missing == 1:
        prompt = words["keyboard_check.one_left"]
    else:
        prompt = words.fill("keyboard_check.left", count=n_missing)
    return TextScreen(
        words["keyboard_check.title"],
        words["keyboard_check.body"],
        prompt,
        keys=tuple((key, key in pressed) for key in keys),
        locale=words.locale,
        labels=words.labels(tuple(keys)),
    )
