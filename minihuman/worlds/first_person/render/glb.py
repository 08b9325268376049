"""GLB files: a mesh with its materials and textures in one file, as modelling programs export it; read by trimesh."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import Mesh, Texture
from minihuman.worlds.first_person.render.tables import F64

Rgb = tuple[float, float, float]


def read_glb(path: Path) -> Mesh:
    """Read a mesh; its base is moved to y = 0 and the middle of its width and depth to x = z = 0.

    A triangle has its material's colour or texture, or the mean of its corners' colours where it has no material. Its
    textures are inside the mesh.

    Raises:
        WorldError: if the file cannot be read, has no triangle in it or no height.
    """
    import trimesh  # only worlds with such a mesh need it

    try:
        parts: list[Any] = [part for part in trimesh.load_scene(path).dump() if len(getattr(part, "faces", ()))]
    except Exception as error:  # whatever a reader of a foreign format raises
        raise WorldError(f"{path}: cannot be read as a mesh ({error}); export it as GLB again") from error
    if not parts:
        raise WorldError(f"{path}: there is no triangle in it; a mesh has at least one")
    images: dict[str, Texture] = {}
    names: list[str | None] = []
    colours, places = [], []
    for number, part in enumerate(parts):
        image = _image(part)
        if image is not None:
            images[f"{path}#{number}"] = image
        names += [None if image is None else f"{path}#{number}"] * len(part.faces)
        colours.append(_colours(part))
        places.append(_places(part))
    corners: F64 = np.concatenate([np.asarray(part.triangles, np.float64) for part in parts])
    normals = np.concatenate([np.asarray(part.vertex_normals, np.float64)[part.faces] for part in parts])
    return Mesh(
        _centred(corners, path),
        normals,
        np.concatenate(places),
        np.concatenate(colours),
        tuple(names),
        images=images,
    )


def _image(part: Any) -> Texture | None:
    """The texture of a part; a metre of it is all of it, as its places say where on it a corner is."""
    material = getattr(part.visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None or getattr(part.visual, "uv", None) is None:
        return None
    return Texture(np.asarray(image.convert("RGB")), (1.0, 1.0))


def _colours(part: Any) -> F64:
    """A colour a triangle, 0 to 1."""
    material = getattr(part.visual, "material", None)
    if material is None:
        return np.array(part.visual.face_colors[:, :3], np.float64) / 255
    factor = getattr(material, "baseColorFactor", None)
    rgb = np.ones(3) if factor is None else np.asarray(factor, np.float64)[:3] / 255
    return np.tile(rgb, (len(part.faces), 1))


def _places(part: Any) -> F64:
    uv: NDArray[np.float64] | None = getattr(part.visual, "uv", None)
    return np.zeros((len(part.faces), 3, 2)) if uv is None else np.asarray(uv, np.float64)[part.faces]


def _centred(corners: F64, path: Path) -> F64:
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    if high[1] <= low[1]:
        raise WorldError(f"{path}: the mesh is flat; a mesh has a height")
    middle = (low + high) / 2
    centred: F64 = corners - np.array([middle[0], low[1], middle[2]])
    return centred
