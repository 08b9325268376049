"""Encoding of the values of worlds as MessagePack.

Decoded arrays and NumPy scalars keep their types, and sequences become tuples, the only sequence type of Gymnasium's
spaces.
"""

import io
from typing import Any

import msgspec
import numpy as np

# MessagePack extensions
_ARRAY = 1
_SCALAR = 2


def encode_value(value: Any) -> bytes:
    """Encode an observation, or another value made of numbers, text, arrays, and dicts, tuples and lists of them.

    Raises:
        TypeError: if a part of the value is of another type.
        OverflowError: if an integer has more than 64 bits.
    """
    return msgspec.msgpack.encode(value, enc_hook=_encode_array)


def decode_value(encoded: bytes) -> Any:
    """Return the value that `encode_value` encoded.

    Raises:
        Exception: the error of msgspec or NumPy, if `encode_value` did not make the bytes.
    """
    return _with_tuples(msgspec.msgpack.decode(encoded, ext_hook=_decode_array))


def _encode_array(value: Any) -> msgspec.msgpack.Ext:
    """Encode an array or a NumPy scalar as an extension of MessagePack; raise a TypeError for any other value."""
    if not isinstance(value, np.ndarray | np.generic):
        raise TypeError(
            f"{type(value).__name__} {value!r} cannot be stored in an observation; use arrays, numbers or strings"
        )
    file = io.BytesIO()
    np.save(file, value, allow_pickle=False)
    return msgspec.msgpack.Ext(_ARRAY if isinstance(value, np.ndarray) else _SCALAR, file.getvalue())


def _decode_array(code: int, encoded: memoryview) -> Any:
    array = np.load(io.BytesIO(encoded), allow_pickle=False)
    return array[()] if code == _SCALAR else array


def _with_tuples(value: Any) -> Any:
    """Return a decoded value with tuples in place of its lists."""
    match value:
        case dict():
            return {key: _with_tuples(part) for key, part in value.items()}
        case list():
            return tuple(map(_with_tuples, value))
    return value
