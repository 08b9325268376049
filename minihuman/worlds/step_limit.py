"""Validation of step limits and action numbers.

A limit that is a float is refused even if it is whole. An action may be a whole float, or an array of one number, as a
policy's ``predict`` returns it and Minigrid accepts it.

The recipe of a world family has the default limit, and the option `max_steps` replaces it. Gymnasium's `TimeLimit` may
set a lower limit, and so may a protocol.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.options import whole_number

if TYPE_CHECKING:
    import gymnasium

LARGEST_STEP_LIMIT = 2**31 - 1  # what a grid's state holds


def check_max_steps(max_steps: Any) -> int:
    """Check an episode's step limit, a whole number from 1 to `LARGEST_STEP_LIMIT`, and return it.

    Raises:
        WorldError: if the limit is not such a number.
    """
    steps = whole_number(max_steps)
    if steps is None or not 1 <= steps <= LARGEST_STEP_LIMIT:
        raise WorldError(f"max_steps is {max_steps!r}; use a whole number from 1 to {LARGEST_STEP_LIMIT}")
    return steps


def action_number(action: Any) -> int | None:
    """Return the number of an action, a whole number of any type or an array of one; None for anything else."""
    if isinstance(action, np.ndarray) and action.size == 1:
        scalar = action.item()
    else:
        scalar = action
    if isinstance(scalar, float | np.floating) and scalar == scalar // 1:  # false for infinity: inf // 1 is NaN
        return int(scalar)
    return whole_number(scalar)


def check_action(action: Any, count: int) -> int:
    """Check an action, a whole number from 0 to ``count`` - 1, and return its number.

    Raises:
        WorldError: if the action is not such a number.
    """
    number = action_number(action)
    if number is None or not 0 <= number < count:
        raise WorldError(f"action is {action!r}; it must be a whole number, 0 to {count - 1}")
    return number


def step_limit_of(env: "gymnasium.Env[Any, Any]") -> int | None:
    """Return the lower of a world's own step limit and the limit in its Gymnasium spec; None if it has neither."""
    limits = (getattr(env.unwrapped, "max_steps", None), env.spec.max_episode_steps if env.spec else None)
    return min((int(limit) for limit in limits if limit is not None), default=None)


def elapsed_steps(env: "gymnasium.Env[Any, Any]") -> list[int]:
    """Return the step count of each of Gymnasium's `TimeLimit` wrappers, from the outermost inwards."""
    return [wrapper._elapsed_steps for wrapper in _time_limits(env)]


def set_elapsed_steps(env: "gymnasium.Env[Any, Any]", steps: Sequence[int]) -> None:
    """Set the step counters of the `TimeLimit` wrappers to the numbers that `elapsed_steps` returned."""
    for wrapper, elapsed in zip(_time_limits(env), steps, strict=True):
        wrapper._elapsed_steps = elapsed


def _time_limits(env: "gymnasium.Env[Any, Any]") -> Iterator[Any]:
    from gymnasium import Wrapper
    from gymnasium.wrappers import TimeLimit

    while isinstance(env, Wrapper):
        if isinstance(env, TimeLimit):
            yield env
        env = env.env
