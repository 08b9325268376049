"""Comparison of observations with their spaces: which part lies outside, and why, in words."""

import warnings
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.worlds.adapters.returned_values import describe_value


def find_outside(observation: Any, space: gymnasium.Space[Any], name: str = "the observation") -> str:
    """Describe how an observation lies outside its space; return "" if it is inside.

    ``name`` is what the description calls the observation.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Gymnasium warns of lists and casts, and answers as well
        if space.contains(observation):
            return ""
    return (
        find_mismatch(observation, space, name)
        or _find_bad_part(observation, space, name)
        or f"{name} is {describe_value(observation)}, which {space} does not hold"
    )


def find_mismatch(observation: Any, space: gymnasium.Space[Any], name: str = "the observation") -> str:
    """Describe how an observation's structure differs from its space; return "" if it matches.

    Bounds and precision are not compared. An observation that matches can be stacked with others of the space, part by
    part.
    """
    match space:
        case spaces.Dict():
            return _find_dict_mismatch(observation, space, name)
        case spaces.Tuple():
            if not isinstance(observation, tuple | list) or len(observation) != len(space.spaces):
                return f"{name} is {describe_value(observation)}, and its space has {len(space.spaces)} parts"
            parts = zip(observation, space.spaces, strict=True)
            mismatches = (find_mismatch(part, inner, f"{name}[{number}]") for number, (part, inner) in enumerate(parts))
            return next(filter(None, mismatches), "")
        case spaces.Box() | spaces.MultiBinary() | spaces.MultiDiscrete():
            return _find_array_mismatch(observation, space, name)
        case spaces.Discrete():
            is_integer = isinstance(observation, int | np.integer) and not isinstance(observation, bool | np.bool_)
            is_scalar = isinstance(observation, np.ndarray) and not observation.shape and observation.dtype.kind in "iu"
            if not (is_integer or is_scalar):
                return f"{name} is {describe_value(observation)}, and its space holds a whole number"
            is_inside = int(space.start) <= int(observation) < int(space.start) + int(space.n)
            if is_inside:
                return ""
            return _outside_range(observation, space, name)
    return ""


def _outside_range(observation: Any, space: spaces.Discrete, name: str) -> str:
    first = int(space.start)
    return f"{name} is {int(observation)}, and its space holds {first} to {first + int(space.n) - 1}"


def _find_dict_mismatch(observation: Any, space: spaces.Dict, name: str) -> str:
    """Describe how an observation's structure differs from a Dict space; return "" if it matches."""
    if not isinstance(observation, dict):
        return f"{name} is {describe_value(observation)}, and its space is a Dict"
    missing = [key for key in space.spaces if key not in observation]
    added = [key for key in observation if key not in space.spaces]
    if missing:
        return f"{name} has no {missing[0]!r}, which its space has"
    if added:
        return f"{name} has {added[0]!r}, which its space has not"
    mismatches = (find_mismatch(observation[key], part, f"{name}[{key!r}]") for key, part in space.spaces.items())
    return next(filter(None, mismatches), "")


def _find_array_mismatch(observation: Any, space: gymnasium.Space[Any], name: str) -> str:
    """Describe how an observation differs from an array space in shape or kind of numbers; return "" if it matches."""
    try:
        array = np.asarray(observation)
    except ValueError:  # rows of unequal length
        return f"{name} is {describe_value(observation)}, which is no array"
    if array.shape != space.shape:
        return f"{name} is {describe_value(observation)}, and its space has the shape {space.shape}"
    if array.dtype.kind not in "biuf":
        return f"{name} is {describe_value(observation)}, and its space holds numbers"
    is_whole = space.dtype is not None and space.dtype.kind in "iu"
    if is_whole and array.dtype.kind == "f":
        return f"{name} is of type {array.dtype}, and its space is of {space.dtype}"
    return ""


def _find_bad_part(observation: Any, space: gymnasium.Space[Any], name: str) -> str:
    """Describe the first number out of bounds, or of another type, in an observation whose structure matches."""
    match space:
        case spaces.Dict():
            parts = [(observation[key], part, f"{name}[{key!r}]") for key, part in space.spaces.items()]
        case spaces.Tuple():
            inner = enumerate(zip(observation, space.spaces, strict=True))
            parts = [(part, part_space, f"{name}[{number}]") for number, (part, part_space) in inner]
        case spaces.Box():
            return _find_bad_number(np.asarray(observation), observation, space, name)
        case _:
            return ""
    return next(filter(None, (find_outside(*part) for part in parts)), "")


def _find_bad_number(array: NDArray[Any], observation: Any, space: spaces.Box, name: str) -> str:
    """Describe why an observation, ``array`` as an array, is not in a Box of its shape; return "" if it is."""
    if not isinstance(observation, np.ndarray | np.generic):
        return f"{name} is {describe_value(observation)}, and must be an array of {space.dtype}"
    low = np.asarray(space.low)
    high = np.asarray(space.high)
    outside = np.argwhere(~((array >= low) & (array <= high)))
    if len(outside):
        index = tuple(outside[0].tolist())
        if index:
            element_name = f"{name}[{', '.join(map(str, index))}]"
        else:
            element_name = name
        return f"{element_name} is {array[index]:g}, and its space holds {low[index]:g} to {high[index]:g}"
    if array.dtype != space.dtype:
        return f"{name} is of type {array.dtype}, and its space is of {space.dtype}"
    return ""
