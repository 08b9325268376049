"""A 64-bit hash for states and observations, the same on every machine; and references to files by their hash."""

import base64
import hashlib
import struct
from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from typing import Any

import numpy as np

_FLOAT = struct.Struct("<cd")
_PLAIN = frozenset(np.dtype(f"<{kind}") for kind in ("u1", "i1", "i2", "i4", "i8", "u2", "u4", "u8", "f4", "f8"))
_FILES: dict[str, str] = {}  # URL-safe Base64 by its reference, of every plan that this process has made or read


def refer_to_file(content: bytes) -> str:
    """Return the reference to a file that stands in a world's options: "sha256:" and the digest of its content."""
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def keep_files(contents: Iterable[bytes]) -> None:
    """Remember the files of a plan by their references, to which the options of its worlds refer."""
    _FILES.update((refer_to_file(content), base64.urlsafe_b64encode(content).decode()) for content in contents)


def resolve_files(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return a world's options with each file reference replaced by the file's content in URL-safe Base64."""
    return {name: _FILES.get(value, value) if isinstance(value, str) else value for name, value in options.items()}


def hash64(value: Any) -> int:
    """Return a uint64 hash of arrays, numbers, strings, and (nested) dicts, tuples and lists of them.

    The hash is BLAKE2b over a canonical form: dicts by sorted key, arrays by dtype (little-endian), shape and bytes.

    Raises:
        TypeError: if a value has no canonical form.
    """
    return int.from_bytes(hashlib.blake2b(_encode_canonical(value), digest_size=8).digest(), "little")


def quick_hash64(state: Any) -> int:
    """Return another uint64 hash of what ``hash64`` takes, XXH3, at a fortieth of the time for large arrays.

    It is for what no log contains, as another version may hash in another way.

    Raises:
        TypeError: if a value has no canonical form.
    """
    from xxhash import xxh3_64_intdigest  # here, as the environment that compiles the kernels lacks it

    return xxh3_64_intdigest(_encode_canonical(state))


def _encode_canonical(state: Any) -> bytes:
    """Return the canonical form of what is hashed."""
    pieces: list[bytes] = []
    _canonical(state, pieces.append)
    return b"".join(pieces)


def _canonical(value: Any, add: Callable[[bytes], None]) -> None:
    """Pass the canonical form of a value to ``add``, in pieces.

    The commonest types are tested first, because a state has hundreds of values.
    """
    kind = type(value)
    if kind is float:
        add(_FLOAT.pack(b"f", value))
    elif kind is int:
        add(b"i%d;" % value)
    elif kind is str:
        add(_text_form(value))
    elif kind is tuple or kind is list:
        add(b"l%d;" % len(value))
        for item in value:  # numbers without a call: a first-person state has dozens
            add(_FLOAT.pack(b"f", item)) if type(item) is float else _canonical(item, add)
    elif kind is np.ndarray and value.dtype in _PLAIN and value.flags.c_contiguous:
        add(_array_head(value.dtype.str, value.shape))
        add(value.tobytes())
    elif kind is dict:
        add(b"d%d;" % len(value))
        for key in sorted(value):
            add(_text_form(key)) if type(key) is str else _canonical(key, add)
            _canonical(value[key], add)
    else:
        _encode_other_types(value, add)


def _encode_other_types(value: Any, add: Callable[[bytes], None]) -> None:
    """Pass the canonical form of a value to ``add`` if its type is not one of the commonest ones.

    Subclasses of a type, and NumPy's scalars, have the form of the plain type.

    Raises:
        TypeError: if the value has no canonical form.
    """
    match value:
        case None:
            add(b"n")
        case bool() | np.bool_():
            add(b"b1" if value else b"b0")
        case int() | np.integer():
            add(b"i%d;" % int(value))
        case float() | np.floating():
            add(_FLOAT.pack(b"f", float(value)))
        case str():
            _canonical(str.__str__(value), add)
        case bytes():
            add(b"y%d;" % len(value) + value)
        case np.ndarray() if not value.dtype.hasobject:  # the bytes of an array of objects are addresses
            array = np.ascontiguousarray(value)
            array = array.astype(array.dtype.newbyteorder("<"), copy=False)
            add(_array_head(array.dtype.str, array.shape))
            add(array.tobytes())
        case dict():
            _canonical(dict(value), add)
        case tuple() | list():
            _canonical(list(value), add)
        case _:
            raise TypeError(f"{type(value).__name__} {value!r} cannot be hashed; it has no canonical form")


@lru_cache(1024)
def _text_form(text: str) -> bytes:
    encoded = text.encode()
    return b"s%d;" % len(encoded) + encoded


@cache
def _array_head(dtype: str, shape: tuple[int, ...]) -> bytes:
    return f"a{dtype}{shape};".encode()
