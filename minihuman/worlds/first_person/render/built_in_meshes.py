"""The built-in meshes, made by ``python -m kernel_build.meshes``, with the same points on every machine."""

import hashlib
import io
from functools import cache
from pathlib import Path

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import MeshData
from minihuman.worlds.first_person.render.kernel_tables import F64

MESH_FILE = Path(__file__).with_name("meshes.npz")
_SHA256 = "11d12038f4cd16ac75b646a26cfa20f2e91c6ca78d8da0771a5212d50931ec53"
COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "purple": (0.44, 0.15, 0.76),
    "yellow": (1.0, 1.0, 0.0),
    "grey": (0.39, 0.39, 0.39),
    "white": (1.0, 1.0, 1.0),  # for meshes that are tinted when they are drawn
}
_COLOURED = ("ball", "key")


def mesh_named(name: str) -> MeshData:
    """Return the built-in mesh of a name; a coloured ball or key is named as in "ball_red".

    Raises:
        WorldError: if there is no such mesh, or the file of meshes belongs to another version.
    """
    arrays = _read_arrays()
    stem, _, colour = name.partition("_")
    if stem not in _COLOURED or colour not in COLOURS:
        stem = name
        colour = "white"
    if f"{stem}.corners" not in arrays:
        names = ", ".join(key.removesuffix(".corners") for key in arrays if key.endswith(".corners"))
        raise WorldError(f"unknown mesh {name!r}; use one of {names}; balls and keys take a colour, as in key_red")
    corners = arrays[f"{stem}.corners"]
    normals = arrays[f"{stem}.normals"]
    colours = arrays[f"{stem}.colours"] * COLOURS[colour]
    count = len(corners)
    return MeshData(corners, normals, np.zeros((count, 3, 2)), colours, (None,) * count)


@cache
def _read_arrays() -> dict[str, F64]:
    """Read the arrays of all built-in meshes; raise a WorldError for a file of another version."""
    content = MESH_FILE.read_bytes()
    if hashlib.sha256(content).hexdigest() != _SHA256:
        raise WorldError(f"{MESH_FILE.name} is not the one that belongs to this version; install minihuman-lab again")
    with np.load(io.BytesIO(content)) as arrays:
        return dict(arrays)
