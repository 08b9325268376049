"""The asset library: built-in textures and meshes, and those of a world's own folder, read once per process.

A folder contains `textures/NAME.png`, `meshes/NAME.obj` (with materials; errors name the line) and `meshes/NAME.glb`,
like Miniworld's package folder. Assets that the folder lacks are the built-in ones.
"""

import threading
import zlib
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import Assets, Library, MeshData, Texture
from minihuman.worlds.first_person.render.built_in_meshes import mesh_named
from minihuman.worlds.first_person.render.built_in_textures import RECIPES, scale_to_brightness
from minihuman.worlds.first_person.render.kernel_tables import F64

_LETTER_PX = 128
_LETTER_FONT_PX = 112
_LETTER_M = 0.25  # the width and height that a letter's texture covers
_LETTER_STYLES = 9  # the number of variants of a letter, as in Miniworld


class OwnAssets(Assets):
    """The built-in assets: the textures of `RECIPES`, a picture of each letter and digit, and the built-in meshes."""

    def texture(self, name: str) -> Texture:
        """Paint the texture of a name: a recipe's name, or "chars/ch_0x" with a character's code, "_" and a variant.

        Raises:
            WorldError: if there is no such texture.
        """
        stem, _, variant = name.rpartition("_")
        if not variant.isdigit():
            stem = name
            variant = "1"
        if stem.startswith("chars/ch_0x") and stem[11:].isdigit():
            return _draw_letter(chr(int(stem[11:])), int(variant))
        if stem not in RECIPES or not 1 <= int(variant) <= len(RECIPES[stem][1]):
            raise WorldError(f"unknown texture {name!r}; use one of {', '.join(RECIPES)}, with _1 and up for variants")
        recipe, variants = RECIPES[stem]
        width_m, height_m, brightness = variants[int(variant) - 1]
        seed = zlib.crc32(stem.encode()) % 1_000_003 + 1000 * int(variant)  # each picture has its own
        return Texture(scale_to_brightness(recipe(seed), brightness), (width_m, height_m))

    def mesh(self, name: str) -> MeshData:
        """Return the built-in mesh of a name; raise a WorldError if there is none."""
        return mesh_named(name)


def own_library() -> Library:
    """Return a library of the built-in assets, which are loaded when scenes use them."""
    return Library(OwnAssets())


def _draw_letter(letter: str, variant: int) -> Texture:
    """Return a texture of a dark character on paper; the variants differ in the colours of ink and paper.

    Raises:
        WorldError: if there is no such variant.
    """
    if not 1 <= variant <= _LETTER_STYLES:
        raise WorldError(f"the letter {letter!r} has variants 1 to {_LETTER_STYLES}, not {variant}")
    paper = 250 - 9 * (variant - 1)
    image = Image.new("RGB", (_LETTER_PX, _LETTER_PX), (paper, paper, max(paper - 4 * variant, 0)))
    font = ImageFont.load_default(_LETTER_FONT_PX)
    ink = (18 + 6 * variant, 20, 28 + 8 * variant)
    ImageDraw.Draw(image).text((_LETTER_PX / 2, _LETTER_PX / 2), letter, font=font, fill=ink, anchor="mm")
    return Texture(np.asarray(image), (_LETTER_M, _LETTER_M))


Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Material:
    """The material of a face: a colour, and the file of a texture if it has one."""

    colour: Rgb = (1.0, 1.0, 1.0)
    texture: Path | None = None


@dataclass(slots=True)
class _ObjLines:
    """The contents of an OBJ file, by the kind of line."""

    vertices: list[list[float]] = field(default_factory=list)
    places: list[list[float]] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    faces: list[list[tuple[int, int | None, int]]] = field(default_factory=list)  # (vertex, place, normal), from 0
    materials: list[str] = field(default_factory=list)  # one per face


def read_obj(path: Path) -> MeshData:
    """Read a mesh of triangles with normals; its base is moved to y = 0 and its middle to x = z = 0.

    Materials come from the .mtl file of the same name; a .png of the same name covers faces without a material. Texture
    names in the mesh are file paths.

    Raises:
        WorldError: if the file is missing, a line is invalid, or there is no triangle.
    """
    lines = _read_lines(path)
    if not lines.faces:
        raise WorldError(f"{path}: the file has no faces; a mesh needs at least one triangle")
    image = path.with_suffix(".png")
    materials = {"": Material(texture=image if image.exists() else None), **read_mtl(path.with_suffix(".mtl"))}
    face_materials = [materials.get(name, materials[""]) for name in lines.materials]
    vertices = np.array(lines.vertices, np.float32)
    normals = np.array(lines.normals, np.float32)
    vertex_index = np.array([[vertex for vertex, _, _ in face] for face in lines.faces])
    normal_index = np.array([[normal for _, _, normal in face] for face in lines.faces])
    corners = vertices[vertex_index].astype(np.float64)
    # as Miniworld does: the smallest of the three corners' largest coordinates, so that meshes have the same middle
    far = corners.max(axis=0).min(axis=0)
    return MeshData(
        _centre(corners, path, far),
        normals[normal_index].astype(np.float64),
        _index_texture_places(lines),
        np.array([material.colour for material in face_materials], np.float64),
        tuple(None if material.texture is None else str(material.texture) for material in face_materials),
        light_scales=True,
    )


def _index_texture_places(lines: _ObjLines) -> F64:
    """Return the texture place of each corner, (faces, 3, 2); zeros for a corner that states none."""
    places = np.array(lines.places or [[0.0, 0.0]], np.float32)
    index = np.array([[0 if place is None else place for _, place, _ in face] for face in lines.faces])
    is_placed = np.array([[place is not None for _, place, _ in face] for face in lines.faces])
    return np.where(is_placed[:, :, None], places[index], 0.0).astype(np.float64)


def read_mtl(path: Path) -> dict[str, Material]:
    """Return the materials in a file by name; {} if there is no such file.

    Raises:
        WorldError: if a line is invalid.
    """
    materials: dict[str, Material] = {}
    if not path.exists():
        return materials
    name = ""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match line.split():
            case ["newmtl", name]:
                materials[name] = Material()
            case ["Kd", *numbers] if name:
                red, green, blue = _parse_numbers(numbers, 3, path, number)
                materials[name] = Material((red, green, blue), materials[name].texture)
            case ["map_Kd", *_, file] if name:
                materials[name] = Material(materials[name].colour, path.parent / file)
            case ["Kd" | "map_Kd", *_]:
                raise WorldError(f"{path}:{number}: a colour or texture comes before the first newmtl")
    return materials


def _read_lines(path: Path) -> _ObjLines:
    """Read the lines of an OBJ file that describe triangles.

    Raises:
        WorldError: if the file cannot be read, or a line is invalid.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise WorldError(f"{path}: cannot be read ({error.strerror}); check the mesh's name") from error
    except UnicodeDecodeError as error:
        raise WorldError(f"{path} is not a text file; a mesh must be an OBJ file") from error
    lines = _ObjLines()
    material = ""
    for number, line in enumerate(text.splitlines(), 1):
        match line.split():
            case ["v", *numbers]:
                lines.vertices.append(_parse_numbers(numbers, 3, path, number))
            case ["vt", *numbers]:
                lines.places.append(_parse_numbers(numbers[:2], 2, path, number))
            case ["vn", *numbers]:
                lines.normals.append(_parse_numbers(numbers, 3, path, number))
            case ["usemtl", name]:
                material = name
            case ["f", *corners]:
                if len(corners) != 3:
                    raise WorldError(
                        f"{path}:{number}: a face has {len(corners)} corners; export the mesh as triangles"
                    )
                lines.faces.append([_parse_corner(corner, lines, path, number) for corner in corners])
                lines.materials.append(material)
    return lines


def _parse_numbers(words: list[str], count: int, path: Path, number: int) -> list[float]:
    """Return the words of a line as ``count`` finite numbers; raise a WorldError if they are none."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise WorldError(f"{path}:{number}: expected {count} numbers, not {' '.join(words)!r}")
    return values


def _parse_corner(word: str, lines: _ObjLines, path: Path, number: int) -> tuple[int, int | None, int]:
    """Return the indices of a corner's vertex, texture place (None if it has none) and normal, counted from 0.

    Raises:
        WorldError: if ``word`` names no normal, or refers to a line that does not exist.
    """
    parts = word.split("/")
    if len(parts) == 2:
        vertex, place, normal = parts[0], "", parts[1]
    elif len(parts) == 3:
        vertex, place, normal = parts
    else:
        raise WorldError(f"{path}:{number}: the corner {word!r} has no normal; write it as vertex/texture/normal")
    return (
        _parse_index(vertex, len(lines.vertices), "vertex", path, number),
        _parse_index(place, len(lines.places), "texture place", path, number) if place else None,
        _parse_index(normal, len(lines.normals), "normal", path, number),
    )


def _parse_index(word: str, count: int, noun: str, path: Path, number: int) -> int:
    """Return a number that refers to one of ``count`` earlier lines, counted from 0; raise a WorldError for another."""
    try:
        index = int(word)
    except ValueError:
        index = 0
    if not 1 <= index <= count:
        raise WorldError(f"{path}:{number}: {noun} {word!r} does not exist; {count} precede this line, numbered from 1")
    return index - 1


def _centre(corners: F64, path: Path, far: F64) -> F64:
    """Return corners moved so that their base is at y = 0, and the middle between their least and ``far`` at x = z = 0.

    Raises:
        WorldError: if the corners have no height.
    """
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    if high[1] <= low[1]:
        raise WorldError(f"{path}: the mesh is flat; it needs a height")
    middle = (low + far) / 2
    centred: F64 = corners - np.array([middle[0], low[1], middle[2]])
    return centred


def read_glb(path: Path) -> MeshData:
    """Read a mesh; its base is moved to y = 0 and the middle of its width and depth to x = z = 0.

    A triangle has its material's colour or texture, or else the mean colour of its corners. Textures are inside the
    mesh.

    Raises:
        WorldError: if the file cannot be read, or it has no triangle or no height.
    """
    import trimesh  # only worlds with such a mesh need it

    try:
        parts: list[Any] = [part for part in trimesh.load_scene(path).dump() if len(getattr(part, "faces", ()))]
    except Exception as error:  # the reader may raise any exception
        raise WorldError(f"{path}: cannot be read as a mesh ({error}); export it as GLB again") from error
    if not parts:
        raise WorldError(f"{path}: the file has no triangles; a mesh needs at least one")
    images: dict[str, Texture] = {}
    names: list[str | None] = []
    colours = []
    places = []
    for number, part in enumerate(parts):
        image = _read_texture(part)
        if image is not None:
            images[f"{path}#{number}"] = image
        names += [None if image is None else f"{path}#{number}"] * len(part.faces)
        colours.append(_read_colours(part))
        places.append(_read_texture_places(part))
    corners: F64 = np.concatenate([np.asarray(part.triangles, np.float64) for part in parts])
    normals = np.concatenate([np.asarray(part.vertex_normals, np.float64)[part.faces] for part in parts])
    return MeshData(
        _centre(corners, path, corners.max(axis=(0, 1))),
        normals,
        np.concatenate(places),
        np.concatenate(colours),
        tuple(names),
        images=images,
    )


def _read_texture(part: Any) -> Texture | None:
    """Return the texture of a part of a scene; None if it has none.

    Its size is one metre, since texture coordinates are shares of the whole texture.
    """
    material = getattr(part.visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None or getattr(part.visual, "uv", None) is None:
        return None
    return Texture(np.asarray(image.convert("RGB")), (1.0, 1.0))


def _read_colours(part: Any) -> F64:
    """Return a colour for each triangle of a part of a scene, float64[faces, 3] in 0 to 1."""
    material = getattr(part.visual, "material", None)
    if material is None:
        return np.array(part.visual.face_colors[:, :3], np.float64) / 255
    factor = getattr(material, "baseColorFactor", None)
    rgb = np.ones(3) if factor is None else np.asarray(factor, np.float64)[:3] / 255
    return np.tile(rgb, (len(part.faces), 1))


def _read_texture_places(part: Any) -> F64:
    """Return the texture places of each triangle's corners, (faces, 3, 2); zeros if the part has none."""
    uv: NDArray[np.float64] | None = getattr(part.visual, "uv", None)
    if uv is None:
        return np.zeros((len(part.faces), 3, 2))
    places: F64 = np.asarray(uv, np.float64)[part.faces]
    return places


TEXELS_A_METRE = 512
_READERS = {".obj": read_obj, ".glb": read_glb}


class FolderAssets(Assets):
    """The textures and meshes in a folder, and the built-in ones for names that the folder lacks.

    Raises:
        WorldError: if the folder has neither a folder of textures nor one of meshes.
    """

    def __init__(self, folder: Path) -> None:
        if not any((folder / part).is_dir() for part in ("textures", "meshes")):
            raise WorldError(
                f"{folder} has neither a textures nor a meshes folder; give the folder that contains one of them"
            )
        self._folder = folder
        self._own = OwnAssets()

    @cached_property
    def meshes(self) -> dict[str, Path]:
        """Return the files of the folder's meshes, by name."""
        files = sorted((self._folder / "meshes").glob("*"), reverse=True)  # an OBJ file stands before a GLB file
        return {file.stem: file for file in files if file.suffix.lower() in _READERS}

    def texture(self, name: str) -> Texture:
        """Return a PNG of the folder, 512 texels per metre, or else the built-in texture of that name.

        ``NAME.png`` is also a texture's first variant, "NAME_1".

        Raises:
            WorldError: if there is no such texture, or the file is not an image.
        """
        path = self._texture_file(name)
        if path is None:
            try:
                return self._own.texture(name)
            except WorldError as error:
                raise WorldError(f"{self._folder} has no texture {name!r}; {error}") from error
        try:
            with Image.open(path) as image:
                pixels = np.asarray(image.convert("RGB"))
        except OSError as error:
            raise WorldError(f"texture {name!r}: {path} cannot be read as an image") from error
        height, width = pixels.shape[:2]
        return Texture(pixels, (width / TEXELS_A_METRE, height / TEXELS_A_METRE))

    def mesh(self, name: str) -> MeshData:
        """Return the mesh of an OBJ or GLB file of the folder, or else the built-in mesh of that name."""
        file = self.meshes.get(name)
        if file is not None:
            return _READERS[file.suffix.lower()](file)
        try:
            return self._own.mesh(name)
        except WorldError as error:
            raise WorldError(f"{self._folder} has no mesh {name!r}; {error}") from error

    def brings(self, mesh: str) -> bool:
        """Return whether the folder has this mesh."""
        return mesh in self.meshes

    def _texture_file(self, name: str) -> Path | None:
        """Return the path of a texture; None if it is not in the folder. A mesh's texture is named by its path."""
        if name.lower().endswith(".png"):
            return Path(name)
        for stem in (name, name.removesuffix("_1")):
            for suffix in (".png", ".PNG"):
                file = self._folder / "textures" / f"{stem}{suffix}"
                if file.exists():
                    return file
        return None


library_lock = threading.Lock()  # hold it while a scene is laid out: that may read another texture into the library


@cache
def asset_library(folder: str | None) -> Library:
    """Return the library of a folder, or of the built-in assets alone for None; the same object for the same folder."""
    if folder is None:
        return own_library()
    return Library(FolderAssets(Path(folder)))
