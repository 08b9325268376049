"""Checks of what a foreign world returns: the tuples of reset and step, rewards, flags and pictures.

Errors state what was returned, what must be returned, and what to write instead. The module knows no world's name and
keeps no state.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError

_MAX_TEXT_CHARS = 60  # of a value that an error quotes
_STEP_VALUES = "(observation, reward, terminated, truncated, info)"
_RESET_VALUES = "(observation, info)"


def describe_value(value: Any) -> str:
    """Describe a value for an error, such as "an array of shape (2,)", "nothing (None)" or "the text 'left'"."""
    match value:
        case None:
            return "nothing (None)"
        case np.ndarray():
            return f"an array of shape {value.shape} and type {value.dtype}"
        case str():
            return f"the text {value[:_MAX_TEXT_CHARS]!r}"
        case bool() | np.bool_():
            return f"the flag {bool(value)}"
        case int() | float() | np.number():
            return f"the number {value!s:.{_MAX_TEXT_CHARS}}"
        case tuple() | list():
            return f"a {type(value).__name__} of {len(value)} values"
        case Mapping():
            return f"a dict of {len(value)} values"
    return f"an object of the class {type(value).__name__}"


def read_reset(returned: Any) -> tuple[Any, Mapping[str, Any]]:
    """Return the observation and info that a reset returned.

    Raises:
        WorldError: if the reset did not return these two values.
    """
    if not isinstance(returned, tuple | list) or len(returned) != 2:
        raise WorldError(f"reset() returned {describe_value(returned)}; it must return {_RESET_VALUES}")
    observation, info = returned
    return observation, _read_info(info, "reset()")


def read_step(returned: Any) -> tuple[Any, float, bool, bool, Mapping[str, Any]]:
    """Return the observation, reward, flags and info that a step returned.

    Raises:
        WorldError: if the step did not return these five values, or one of them has the wrong type.
    """
    if not isinstance(returned, tuple | list) or len(returned) != 5:
        raise WorldError(
            f"step() returned {describe_value(returned)}; it must return {_STEP_VALUES}{_explain_count(returned)}"
        )
    observation, reward, terminated, truncated, info = returned
    return (
        observation,
        read_reward(reward),
        read_flag(terminated, "terminated"),
        read_flag(truncated, "truncated"),
        _read_info(info, "step()"),
    )


def _explain_count(returned: Any) -> str:
    """Return advice for a step that returned another number of values than 5; "" if the cause is unclear."""
    if not isinstance(returned, tuple | list):
        return ""
    match len(returned):
        case 4:
            return ", with done divided into terminated and truncated"
        case 6:
            return ", with anything else, such as a cost, in info"
    return ""


def _read_info(info: Any, call: str) -> Mapping[str, Any]:
    if not isinstance(info, Mapping):
        raise WorldError(f"{call} returned {describe_value(info)} as info; return a dict, {{}} for none")
    return info


def read_reward(reward: Any) -> float:
    """Return a reward as a float. NaN and infinity are accepted, since a log can store them.

    Raises:
        WorldError: if the reward is not one real number.
    """
    if not isinstance(reward, str | bytes):
        try:
            return float(reward)
        except (TypeError, ValueError, OverflowError):
            pass  # the error below names the value
    raise WorldError(f"the reward must be one number and is {describe_value(reward)}; {_suggest_reward(reward)}")


def _suggest_reward(reward: Any) -> str:
    """Return the advice for a reward that is not a number."""
    match reward:
        case np.ndarray():
            return "return a float, such as float(reward.sum())"
        case tuple() | list() | Mapping():
            return (
                "return a float; if these are the rewards of several agents, register a team of seats, whose "
                "interface is PettingZoo's (docs/teams.md), or let one of them be played"
            )
    return "return a float"


def read_flag(flag: Any, name: str) -> bool:
    """Return a flag as a bool; None counts as False.

    Raises:
        WorldError: if the value is not a flag, 0 or 1, or an array with one of these; ``name`` is its name in the
            message.
    """
    if isinstance(flag, np.ndarray) and flag.size == 1 and flag.dtype.kind in "biu":
        flag = flag.item()
    if flag is None or isinstance(flag, bool | np.bool_) or (isinstance(flag, int | np.integer) and flag in (0, 1)):
        return bool(flag)
    raise WorldError(f"{name} must be True or False and is {describe_value(flag)}; return bool({name})")


def read_onset(info: Mapping[str, Any]) -> bool:
    """Return whether the next picture shows a stimulus onset, according to ``info["onset"]``.

    Raises:
        WorldError: if that value is not a flag.
    """
    return "onset" in info and read_flag(info["onset"], "info['onset']")


def read_picture(picture: Any) -> NDArray[np.uint8]:
    """Return a picture as uint8[H, W, 3].

    Pictures of other types are accepted if their values lie between 0 and 255; fractions are cut off.

    Raises:
        WorldError: if the picture has another shape, or would be shown black or in wrong colours.
    """
    if not isinstance(picture, np.ndarray):
        raise WorldError(f"render() returned {describe_value(picture)}; return a uint8 array of shape [H, W, 3]")
    if picture.ndim != 3 or picture.shape[2] != 3 or 0 in picture.shape:
        raise WorldError(
            f"render() returned {describe_value(picture)}; return a uint8 array of shape [H, W, 3]"
            f"{_explain_shape(picture.shape)}"
        )
    if picture.dtype == np.uint8:
        return picture
    return _convert_picture(picture)


def _explain_shape(shape: tuple[int, ...]) -> str:
    """Return advice for a picture that is not of shape [H, W, 3]; "" if the shape is an unusual one."""
    match shape:
        case (_, _):
            return ": a grey picture needs its channel three times, as np.stack([picture] * 3, axis=-1) gives it"
        case (_, _, 4):
            return ": leave out the transparency, picture[..., :3]"
        case (3, _, _):
            return ": the colours come last, picture.transpose(1, 2, 0)"
        case (_, _, 1):
            return ": a grey picture needs its channel three times, as picture.repeat(3, axis=2) gives it"
    return ""


def _convert_picture(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a picture as uint8, with fractions cut off.

    Raises:
        WorldError: if the values are not numbers from 0 to 255, or seem to be fractions of 1.
    """
    kind = picture.dtype.kind
    if kind not in "iuf":
        raise WorldError(f"render() returned a picture of type {picture.dtype}; return uint8 values from 0 to 255")
    low = float(picture.min())
    high = float(picture.max())
    if math.isnan(low):
        raise WorldError("render() returned a picture with NaN; return uint8 values from 0 to 255")
    if low < 0 or high > 255:
        raise WorldError(f"render() returned values from {low:g} to {high:g}; return uint8 values from 0 to 255")
    if 0 < high <= 1:  # a picture that is black throughout is black in either reading
        raise WorldError(
            f"render() returned {picture.dtype} values from {low:g} to {high:g}, which are shown as black; return "
            "uint8 values from 0 to 255: (255 * picture).astype(np.uint8)"
        )
    return picture.astype(np.uint8)


def explain_unhashable(value: Any, name: str = "the observation") -> str:
    """Return an error text for the first part of an observation that a log cannot hash; "" if it can hash all parts.

    Args:
        value: the observation, or a part of it
        name: the name of ``value`` in the text
    """
    match value:
        case dict():
            if any(not isinstance(key, str | int) for key in value) or len({type(key) for key in value}) > 1:
                return f"{name} has keys that are not all text, or all whole numbers; name its parts by text"
            parts = [(part, f"{name}[{key!r}]") for key, part in value.items()]
        case tuple() | list():
            parts = [(part, f"{name}[{number}]") for number, part in enumerate(value)]
        case np.ndarray():
            holds_objects = value.dtype.hasobject
            if holds_objects:
                return f"{name} is an array of Python objects; give it a type of numbers"
            return ""
        case str():
            broken = any("\ud800" <= letter <= "\udfff" for letter in value)
            if broken:
                return f"{name} is text with half a character (a lone surrogate); remove it"
            return ""
        case None | bool() | int() | float() | bytes() | np.bool_() | np.integer() | np.floating():
            return ""
        case _:
            return (
                f"{name} is {describe_value(value)}, which a log cannot hash; "
                "use numbers, text, arrays, and dicts, tuples and lists of them"
            )
    return next(filter(None, (explain_unhashable(part, part_name) for part, part_name in parts)), "")
