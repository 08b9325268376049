"""Whole numbers that people give: of steps, of actions. A float is refused, even where it is whole."""

from operator import index
from typing import Any

from minihuman.errors import WorldError

MOST_STEPS = 2**31 - 1  # what a grid's state holds


def check_max_steps(max_steps: Any) -> int:
    """How many steps an episode has at most, if it is a whole number from 1 to `MOST_STEPS`.

    Raises:
        WorldError: if it is not.
    """
    steps = _whole(max_steps)
    if steps is None or not 1 <= steps <= MOST_STEPS:
        raise WorldError(f"max_steps is {max_steps!r}; an episode has 1 step or more, a whole number to {MOST_STEPS}")
    return steps


def check_action(action: Any, count: int) -> int:
    """The number of an action, if it is a whole number from 0 to ``count`` - 1.

    Raises:
        WorldError: if it is not.
    """
    number = _whole(action)
    if number is None or not 0 <= number < count:
        raise WorldError(f"action {action!r} is not one of 0 to {count - 1}, whole numbers")
    return number


def _whole(value: Any) -> int | None:
    if isinstance(value, bool):
        return None
    try:
        return index(value)
    except TypeError:
        return None
