"""One 64-bit hash for states and observations, the same on every machine."""

import hashlib
from typing import Any

import numpy as np


def hash64(value: Any) -> int:
    """Hash arrays, numbers, strings, and (nested) dicts, tuples and lists of them to a uint64.

    BLAKE2b over a canonical form: dicts by sorted key, arrays by dtype (little-endian), shape and bytes.

    Raises:
        TypeError: if a value has no canonical form.
    """
    digest = hashlib.blake2b(digest_size=8)
    _feed(digest, value)
    return int.from_bytes(digest.digest(), "little")


def _feed(digest: "hashlib.blake2b", value: Any) -> None:
    match value:
        case None:
            digest.update(b"n")
        case bool() | np.bool_():
            digest.update(b"b1" if value else b"b0")
        case int() | np.integer():
            digest.update(b"i%d;" % int(value))
        case float() | np.floating():
            digest.update(b"f" + np.float64(value).astype("<f8").tobytes())
        case str():
            encoded = value.encode()
            digest.update(b"s%d;" % len(encoded) + encoded)
        case bytes():
            digest.update(b"y%d;" % len(value) + value)
        case np.ndarray() if not value.dtype.hasobject:  # whose bytes would be addresses
            array = np.ascontiguousarray(value)
            array = array.astype(array.dtype.newbyteorder("<"), copy=False)
            digest.update(f"a{array.dtype.str}{array.shape};".encode())
            digest.update(array.tobytes())
        case dict():
            digest.update(b"d%d;" % len(value))
            for key in sorted(value):
                _feed(digest, key)
                _feed(digest, value[key])
        case tuple() | list():
            digest.update(b"l%d;" % len(value))
            for item in value:
                _feed(digest, item)
        case _:
            raise TypeError(f"{type(value).__name__} {value!r} has no canonical form to hash")
