"""Figures as files, drawn again only where what they show has changed: each file's own metadata holds a digest of it.

Loads no Matplotlib unless a figure is drawn: drawing one takes half a second, of which its import is a part.
"""

import importlib
from collections.abc import Sequence
from functools import cache
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minihuman.dataset.caches import digest_sources

_LIBRARIES = ("matplotlib", "numpy", "scipy", "pillow", "fonttools")
_ENDS = {".png": b"IEND\xaeB`\x82", ".pdf": b"%%EOF\n"}  # a file that was cut off does not have it


def draw_figure_files(stem: Path, name: str, *values: object, **options: object) -> tuple[Path, Path]:
    """Write a figure as ``stem``.png and ``stem``.pdf unless both are there and show the same; the PNG comes first.

    Args:
        stem: the files' path without a suffix; the folder is made.
        name: the module below ``minihuman.figures`` and the function that draws, as ``estimation.estimation_figure``.
        values: the function's arguments: texts, numbers, arrays, dataclasses and collections of them.
        options: its keyword arguments.

    Raises:
        TypeError: if a value cannot be encoded, as no digest could tell it from others.
    """
    digest = digest_figure(name, values, options)
    png, pdf = (stem.with_name(f"{stem.name}{suffix}") for suffix in _ENDS)
    if not (_holds(png, digest) and _holds(pdf, digest)):
        from minihuman.figures.style import save_figure

        module, _, function = name.partition(".")
        draw = getattr(importlib.import_module(f"minihuman.figures.{module}"), function)
        save_figure(draw(*values, **options), stem, digest=digest)
    return png, pdf


def digest_figure(name: str, values: Sequence[object], options: dict[str, Any]) -> str:
    """Digest all that a figure follows from: its data and options, our code, and the libraries that draw it."""
    encoded = msgspec.msgpack.encode((_describe_software(), name, values, options), enc_hook=_encode)
    return blake2b(encoded, digest_size=16).hexdigest()


@cache
def _describe_software() -> tuple[str, ...]:
    return digest_sources(), *(version(library) for library in _LIBRARIES)


def _holds(path: Path, digest: str) -> bool:
    """Whether a file is whole and has that digest in its metadata."""
    content = path.read_bytes() if path.is_file() else b""
    return digest.encode() in content and content.endswith(_ENDS[path.suffix])


def _encode(value: Any) -> object:
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Sequence):  # of our own: columns of a log
        return list(value)
    raise TypeError(f"a figure's data contain a {type(value).__qualname__}, which has no digest; use plain values")
