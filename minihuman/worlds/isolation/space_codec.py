"""A codec for the action spaces that sessions support, and for common observation spaces."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from minihuman.errors import WorldError
from minihuman.worlds.value_codec import decode_value, encode_value

_MAX_NAME_CHARS = 200  # of an unsupported space


def encode_space(space: gymnasium.Space[Any]) -> bytes:
    """Encode a space; an unsupported kind of space is encoded as its name alone."""
    return encode_value(_describe_space(space))


def decode_space(encoded: bytes) -> gymnasium.Space[Any]:
    """Return the space that was encoded.

    Raises:
        WorldError: if its kind is unsupported, so that only the world's process knows it.
    """
    return _build_space(decode_value(encoded))


def _describe_space(space: gymnasium.Space[Any]) -> tuple[Any, ...]:
    """Return a space as a tuple of its kind and the arguments that make it."""
    match space:
        case spaces.Box():
            return "box", space.low, space.high, str(space.dtype)
        case spaces.Discrete():
            return "discrete", int(space.n), int(space.start)
        case spaces.MultiBinary():
            return "multi_binary", tuple(space.shape)
        case spaces.MultiDiscrete():
            return "multi_discrete", space.nvec, space.start, str(space.dtype)
        case spaces.Dict():
            return "dict", tuple((name, _describe_space(inner)) for name, inner in space.spaces.items())
        case spaces.Tuple():
            return "tuple", tuple(_describe_space(inner) for inner in space.spaces)
    return "other", str(space)[:_MAX_NAME_CHARS]


def _build_space(description: tuple[Any, ...]) -> gymnasium.Space[Any]:
    """Return the space that a tuple of its kind and arguments describes."""
    match description:
        case "box", low, high, dtype:
            return spaces.Box(low, high, dtype=np.dtype(dtype).type)
        case "discrete", n, start:
            return spaces.Discrete(n, start=start)
        case "multi_binary", shape:
            return spaces.MultiBinary(shape)
        case "multi_discrete", nvec, start, dtype:
            return spaces.MultiDiscrete(nvec, np.dtype(dtype).type, start=start)
        case "dict", parts:
            return spaces.Dict({name: _build_space(inner) for name, inner in parts})
        case "tuple", parts:
            return spaces.Tuple([_build_space(inner) for inner in parts])
    raise WorldError(f"{description[-1]} is a space that only the world's own process knows")
