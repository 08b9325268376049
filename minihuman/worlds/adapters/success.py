"""Reading of success from a world's ``info``, and of the values of ``info`` that a log stores."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minihuman.worlds.outcomes import WORLD_KEYS

_MISSING = object()


def read_success(info: Mapping[str, Any], key: str = "") -> bool | None:
    """Return whether ``info`` says that the episode succeeded; None if it does not say so unambiguously.

    Args:
        info: the info of a step
        key: the key to read, with dots between the keys of nested dictionaries; "" reads the usual keys
    """
    if key:
        return convert_to_flag(find_info(info, key))
    for usual in WORLD_KEYS:
        if usual in info:
            return convert_to_flag(info[usual])
    return None


def find_info(info: Mapping[str, Any], key: str) -> Any:
    """Return the value of a key of ``info``, looked up directly or by levels at its dots; ``_MISSING`` if absent."""
    if key in info:
        return info[key]
    inner: Any = info
    for name in key.split("."):
        if not isinstance(inner, Mapping) or name not in inner:
            return _MISSING
        inner = inner[name]
    return inner


def has_info(info: Mapping[str, Any], key: str) -> bool:
    """Return whether ``info`` has a key."""
    return find_info(info, key) is not _MISSING


def convert_to_flag(content: Any) -> bool | None:
    """Return a number 0 or 1 as a bool, also from an array, sequence or mapping with this single element.

    Anything else gives None.
    """
    if isinstance(content, Mapping):
        if len(content) == 1:
            return convert_to_flag(next(iter(content.values())))
        return None
    if isinstance(content, str) or content is None or content is _MISSING:
        return None
    try:
        array = np.asarray(content)
    except ValueError:  # a ragged sequence
        return None
    if array.size != 1 or array.dtype.kind not in "biuf":
        return None
    number = float(array.reshape(()))
    if number in (0.0, 1.0):
        return bool(number)
    return None


def encode_info(info: Mapping[str, Any], keys: Sequence[str]) -> str:
    """Return chosen keys of ``info`` as JSON; missing keys are left out, and parts that JSON cannot hold are null."""
    chosen = {key: _to_plain(find_info(info, key)) for key in keys if has_info(info, key)}
    return json.dumps(chosen, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def can_keep(content: Any) -> bool:
    """Return whether a log can store a value of ``info`` completely."""
    if isinstance(content, Mapping):
        return all(isinstance(key, str) and can_keep(inner) for key, inner in content.items())
    if isinstance(content, list | tuple):
        return all(map(can_keep, content))
    if isinstance(content, np.ndarray):
        return content.dtype.kind in "biufU"
    return content is None or isinstance(content, bool | int | float | str | np.generic)


def _to_plain(content: Any) -> Any:
    """Return a value of ``info`` with None in place of each part that JSON cannot hold."""
    match content:
        case Mapping():
            return {str(key): _to_plain(inner) for key, inner in content.items()}
        case np.ndarray() | np.generic():
            if content.dtype.kind in "biufU":
                return _to_plain(content.tolist())
            return None
        case list() | tuple():
            return [_to_plain(inner) for inner in content]
        case float():
            if math.isfinite(content):
                return content
            return None
        case bool() | int() | str():
            return content
        case _:
            return None
