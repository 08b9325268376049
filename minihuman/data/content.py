"""A digest of what a value holds, the same in every process: for what follows from a value and is kept beside it."""

import hashlib
from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

import msgspec
import numpy as np


def content_sha256(value: object) -> str:
    """The SHA-256 of a value: two have the same only if they are of the same types and hold the same, in that order.

    Everything that a value holds goes into it: dataclasses and structs field by field, arrays with dtype and shape.

    Raises:
        TypeError: if it holds something that this module cannot see into.
    """
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()


def _feed(digest: Any, value: object) -> None:
    """Put a value in: its kind, how much follows, and that; so that no two values read alike."""
    kind = type(value).__qualname__
    match value:
        case None:
            _put(digest, kind, b"")
        case Enum():
            _put(digest, kind, value.name.encode())
        case bool() | int() | float():
            _put(digest, kind, repr(value).encode())
        case str() | PurePath():
            _put(digest, kind, str(value).encode("utf-8", "surrogatepass"))
        case bytes():
            _put(digest, kind, value)
        case np.ndarray() | np.generic():
            if value.dtype.hasobject:
                raise TypeError(f"an array of {value.dtype} holds what no digest can see into")
            _put(digest, f"{kind} {value.dtype.descr} {value.shape}", value.tobytes())
        case Mapping():
            _all(digest, kind, [one for pair in value.items() for one in pair])
        case Set():
            _all(digest, kind, sorted(content_sha256(one) for one in value))
        case msgspec.Struct():
            _all(digest, kind, [getattr(value, name) for name in value.__struct_fields__])
        case _ if is_dataclass(value) and not isinstance(value, type):
            _all(digest, kind, [getattr(value, one.name) for one in fields(value)])
        case Sequence():
            _all(digest, kind, value)
        case _:
            raise TypeError(f"a {kind} holds what no digest can see into")


def _all(digest: Any, kind: str, parts: Sequence[object]) -> None:
    _put(digest, f"{kind} of {len(parts)}", b"")
    for part in parts:
        _feed(digest, part)


def _put(digest: Any, kind: str, held: bytes) -> None:
    digest.update(f"{kind} {len(held)}\n".encode())
    digest.update(held)
