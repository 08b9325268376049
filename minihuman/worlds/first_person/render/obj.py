"""OBJ files: the triangles, materials and textures of a mesh in text form, read with errors that name the line."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import Mesh
from minihuman.worlds.first_person.render.tables import F64

Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Material:
    """What a face is made of: a colour, and the file of a texture where it has one."""

    colour: Rgb = (1.0, 1.0, 1.0)
    texture: Path | None = None


@dataclass(slots=True)
class _Lines:
    vertices: list[list[float]] = field(default_factory=list)
    places: list[list[float]] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    faces: list[list[tuple[int, int | None, int]]] = field(default_factory=list)  # (vertex, place, normal), from 0
    materials: list[str] = field(default_factory=list)  # one a face


def read_obj(path: Path) -> Mesh:
    """Read a mesh of triangles with normals; its base is moved to y = 0 and its middle to x = z = 0.

    Materials come from the .mtl file of the same name; a .png of the same name covers faces without a material.
    Texture names in the mesh are file paths.

    Raises:
        WorldError: if the file is missing, a line makes no sense, or there is no triangle in it.
    """
    lines = _read_lines(path)
    if not lines.faces:
        raise WorldError(f"{path}: there is no face in it; a mesh has at least one triangle")
    image = path.with_suffix(".png")
    materials = {"": Material(texture=image if image.exists() else None), **read_mtl(path.with_suffix(".mtl"))}
    vertices, normals = np.array(lines.vertices, np.float32), np.array(lines.normals, np.float32)
    places = np.array(lines.places or [[0.0, 0.0]], np.float32)
    index = np.array([[[v, 0 if t is None else t, n] for v, t, n in face] for face in lines.faces])
    placed = np.array([[[t is not None] for _, t, _ in face] for face in lines.faces])
    chosen = [materials.get(name, materials[""]) for name in lines.materials]
    corners = vertices[index[:, :, 0]].astype(np.float64)
    return Mesh(
        _centred(corners, path),
        normals[index[:, :, 2]].astype(np.float64),
        np.where(placed, places[index[:, :, 1]], 0.0).astype(np.float64),
        np.array([material.colour for material in chosen], np.float64),
        tuple(None if material.texture is None else str(material.texture) for material in chosen),
        light_scales=True,
    )


def read_mtl(path: Path) -> dict[str, Material]:
    """The materials of a file by name; none if there is no such file.

    Raises:
        WorldError: if a line makes no sense.
    """
    materials: dict[str, Material] = {}
    if not path.exists():
        return materials
    name = ""
    for number, line in enumerate(path.read_text().splitlines(), 1):
        match line.split():
            case ["newmtl", name]:
                materials[name] = Material()
            case ["Kd", *numbers] if name:
                red, green, blue = _numbers(numbers, 3, path, number)
                materials[name] = Material((red, green, blue), materials[name].texture)
            case ["map_Kd", *_, file] if name:
                materials[name] = Material(materials[name].colour, path.parent / file)
            case ["Kd" | "map_Kd", *_]:
                raise WorldError(f"{path}:{number}: a colour or texture comes before the first newmtl")
    return materials


def _read_lines(path: Path) -> _Lines:
    try:
        text = path.read_text()
    except OSError as error:
        raise WorldError(f"{path}: cannot be read ({error.strerror}); check the mesh's name") from error
    except UnicodeDecodeError as error:
        raise WorldError(f"{path}: is not a text file; a mesh is an OBJ file") from error
    lines = _Lines()
    material = ""
    for number, line in enumerate(text.splitlines(), 1):
        match line.split():
            case ["v", *numbers]:
                lines.vertices.append(_numbers(numbers, 3, path, number))
            case ["vt", *numbers]:
                lines.places.append(_numbers(numbers[:2], 2, path, number))
            case ["vn", *numbers]:
                lines.normals.append(_numbers(numbers, 3, path, number))
            case ["usemtl", name]:
                material = name
            case ["f", *corners]:
                if len(corners) != 3:
                    raise WorldError(
                        f"{path}:{number}: a face has {len(corners)} corners; export the mesh as triangles"
                    )
                lines.faces.append([_corner(corner, lines, path, number) for corner in corners])
                lines.materials.append(material)
    return lines


def _numbers(words: list[str], count: int, path: Path, number: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise WorldError(f"{path}:{number}: expected {count} numbers, not {' '.join(words)!r}")
    return values


def _corner(word: str, lines: _Lines, path: Path, number: int) -> tuple[int, int | None, int]:
    parts = word.split("/")
    vertex, place, normal = (parts[0], parts[1], parts[2]) if len(parts) == 3 else (parts[0], "", parts[-1])
    if len(parts) not in (2, 3):
        raise WorldError(f"{path}:{number}: the corner {word!r} has no normal; write it as vertex/texture/normal")
    return (
        _index(vertex, len(lines.vertices), "vertex", path, number),
        _index(place, len(lines.places), "texture place", path, number) if place else None,
        _index(normal, len(lines.normals), "normal", path, number),
    )


def _index(word: str, count: int, what: str, path: Path, number: int) -> int:
    try:
        index = int(word)
    except ValueError:
        index = 0
    if not 1 <= index <= count:
        raise WorldError(f"{path}:{number}: there is no {what} {word!r}; {count} came before this line, counted from 1")
    return index - 1


def _centred(corners: F64, path: Path) -> F64:
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    if high[1] <= low[1]:
        raise WorldError(f"{path}: the mesh is flat; a mesh has a height")
    corners = corners.copy()
    # Miniworld takes the smallest of the three corners' largest coordinates here; things stand where its files say
    middle = (low + corners.max(axis=0).min(axis=0)) / 2
    corners[:, :, 0] -= middle[0]
    corners[:, :, 1] -= low[1]
    corners[:, :, 2] -= middle[2]
    return corners
