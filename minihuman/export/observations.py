"""Observations in the shapes that other libraries keep: stacked by column, or flat numbers."""

import string
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import ExportError

_CHARACTERS = frozenset(string.printable)


def stack(observations: Sequence[Any]) -> Any:
    """A list of observations as one observation of stacked arrays: dicts stay dicts, texts become lists."""
    first = observations[0]
    if isinstance(first, dict):
        return {key: stack([observation[key] for observation in observations]) for key in first}
    if isinstance(first, tuple):
        return tuple(stack(column) for column in zip(*observations, strict=True))
    return list(observations) if isinstance(first, str) else np.stack(observations)


def plain_space(space: gymnasium.Space[Any]) -> gymnasium.Space[Any]:
    """The space with its own kinds (a world's mission space) replaced by Gymnasium's, which others can store.

    Raises:
        ExportError: if a part is of a kind that has no plain form.
    """
    match space:
        case gymnasium.spaces.Dict():
            return gymnasium.spaces.Dict({key: plain_space(part) for key, part in space.spaces.items()})
        case gymnasium.spaces.Tuple():
            return gymnasium.spaces.Tuple([plain_space(part) for part in space.spaces])
        case gymnasium.spaces.Box() | gymnasium.spaces.Discrete() | gymnasium.spaces.MultiDiscrete():
            return space
        case gymnasium.spaces.MultiBinary() | gymnasium.spaces.Text():
            return space
    if isinstance(space.sample(), str):
        return gymnasium.spaces.Text(max_length=4096, min_length=0, charset=_CHARACTERS)
    raise ExportError(f"observation space {space} has no plain form; export csv or parquet instead")


def is_picture(space: gymnasium.Space[Any]) -> bool:
    """Whether observations are colour pictures uint8[H, W, 3], at least 32 pixels high and wide."""
    return (
        isinstance(space, gymnasium.spaces.Box)
        and space.dtype == np.uint8
        and len(space.shape) == 3
        and space.shape[2] == 3
        and min(space.shape[:2]) >= 32
    )


def flat(observation: Any, space: gymnasium.Space[Any]) -> NDArray[Any]:
    """All numbers of an observation in one row, dict parts by sorted key; texts are left out (they are metadata).

    The dtype is the narrowest that holds every part of the space exactly, so it is the same for all observations.
    """
    parts = _numbers(observation, space)
    return np.concatenate(parts) if parts else np.zeros(0, np.uint8)


def flat_names(observation: Any, name: str = "") -> list[str]:
    """A name for each number of ``flat``: "direction", "image_0", "image_1", ..."""
    if isinstance(observation, dict):
        return [label for key in sorted(observation) for label in flat_names(observation[key], f"{name}{key}_")]
    if isinstance(observation, tuple):
        return [label for place, part in enumerate(observation) for label in flat_names(part, f"{name}{place}_")]
    if isinstance(observation, str):
        return []
    size = np.asarray(observation).size
    return [name.rstrip("_") or "value"] if size == 1 else [f"{name}{place}" for place in range(size)]


def _numbers(observation: Any, space: gymnasium.Space[Any]) -> list[NDArray[Any]]:
    match space:
        case gymnasium.spaces.Dict():
            return [part for key in sorted(observation) for part in _numbers(observation[key], space[key])]
        case gymnasium.spaces.Tuple():
            pairs = zip(observation, space.spaces, strict=True)
            return [part for item, inner in pairs for part in _numbers(item, inner)]
        case gymnasium.spaces.Discrete():
            last = int(space.start) + int(space.n) - 1
            dtype = np.min_scalar_type(last) if space.start >= 0 else np.dtype(np.int64)
            return [np.asarray([observation], dtype)]
    return [] if isinstance(observation, str) else [np.asarray(observation).reshape(-1)]
