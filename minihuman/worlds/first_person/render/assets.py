"""Assets: the textures and meshes that a scene names, packed once in the form that the kernels read."""

import abc
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.draw_buffers import packed_faces
from minihuman.worlds.first_person.render.kernel_tables import F64, I32, SHADE, FaceTable, TextureTable
from minihuman.worlds.first_person.render.texture import MOST_SIZES, fill_sizes

MOST_TEXELS = 2047  # on a side of a texture
CUBE = "cube"
# The first faces of every library, from and to: a cube, a flat arrowhead towards +x, a shadow of radius 1 (two discs).
CUBE_FACES = (0, 6)
ARROW_FACES = (6, 7)
SHADOW_FACES = (7, 9)
SHADOW_REACH = 1.35  # the radius of the shadow's outer disc
_ABOVE_GROUND_M = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A repeatable picture uint8[h, w, 3], with the first row on top, and the metres that it covers."""

    pixels: NDArray[np.uint8]
    size_m: tuple[float, float]  # right, up

    def __post_init__(self) -> None:
        height, width = self.pixels.shape[:2]
        if self.pixels.dtype != np.uint8 or self.pixels.shape != (height, width, 3):
            raise WorldError(f"a texture is {self.pixels.dtype}{list(self.pixels.shape)}; it must be uint8[h, w, 3]")
        if not 1 <= max(height, width) <= MOST_TEXELS:
            raise WorldError(f"a texture is {width} x {height} texels; each side can have at most {MOST_TEXELS}")


@dataclass(frozen=True, slots=True, eq=False)
class MeshData:
    """Triangles, counter-clockwise as seen from outside, that rest on y = 0 around the axis x = z = 0."""

    corners: F64  # (n, 3, 3)
    normals: F64  # (n, 3, 3)
    texture_places: F64  # (n, 3, 2) 0 to 1 over the texture, right and up
    colours: F64  # (n, 3)
    textures: tuple[str | None, ...]  # (n,)
    light_scales: bool = False  # whether it is brighter the smaller it is scaled, as OpenGL lights a scaled mesh
    images: Mapping[str, Texture] = field(default_factory=dict)  # textures that are in the mesh's own file, by name

    @property
    def half_width(self) -> float:
        """The mesh's largest distance from its axis along x, in its own units."""
        return float(np.abs(self.corners[:, :, 0]).max())

    @property
    def half_depth(self) -> float:
        """The mesh's largest distance from its axis along z, in its own units."""
        return float(np.abs(self.corners[:, :, 2]).max())

    @property
    def height(self) -> float:
        """The mesh's height in its own units."""
        return float(self.corners[:, :, 1].max())


class Assets(abc.ABC):
    """A set of textures and meshes by name."""

    @abc.abstractmethod
    def texture(self, name: str) -> Texture:
        """Return the texture of a name with its variant, such as "brick_wall_1".

        Raises:
            WorldError: if there is no such texture.
        """

    @abc.abstractmethod
    def mesh(self, name: str) -> MeshData:
        """Return the mesh of a name, such as "duckie".

        Raises:
            WorldError: if there is no such mesh, or it is invalid.
        """

    def brings(self, mesh: str) -> bool:
        """Return whether a mesh is not built in; only built-in meshes exist in the colours of every palette."""
        return False


class Library:
    """The assets of a set that have been used so far, in the tables of the kernels.

    Tables only grow: scenes that were built earlier keep the tables they were given.
    """

    def __init__(self, assets: Assets) -> None:
        self._assets = assets
        self._texture_rows: dict[str, int] = {}
        self._sizes_m: list[tuple[float, float]] = []
        self._mesh_ranges: dict[str, tuple[int, int]] = {}
        self._meshes: dict[str, MeshData] = {}
        self._boxes: dict[str, tuple[float, float, float, float]] = {}
        self._reaches: dict[str, tuple[float, float]] = {}
        self.textures = TextureTable(np.zeros(0, np.uint32), np.zeros(0, np.uint32))
        arrow = np.array([[1.0, 0.0, 0.0], [-0.75, 0.0, -0.75], [-0.75, 0.0, 0.75]])
        polygons = [*unit_cube(), arrow, _disc(1.0), _disc(SHADOW_REACH)]
        # Cube and arrow have no texture; each disc of a shadow shades one sample of a pixel.
        self.faces = pack(
            polygons, [np.zeros((len(polygon), 2)) for polygon in polygons], [-1] * 7 + [SHADE, SHADE - 1]
        )
        self._packed: tuple[FaceTable, tuple[F64, I32]] | None = None
        self._mesh_ranges[CUBE] = CUBE_FACES

    @property
    def packed(self) -> tuple[F64, I32]:
        """The library's faces in the form that the kernels read."""
        if self._packed is None or self._packed[0] is not self.faces:
            self._packed = self.faces, packed_faces(self.faces)
        return self._packed[1]

    def texture_row(self, name: str) -> int:
        """Return the row of a texture in ``textures``, after loading it if necessary."""
        if name not in self._texture_rows:
            self._add_texture(name, self._assets.texture(name))
        return self._texture_rows[name]

    def texture_size_m(self, name: str) -> tuple[float, float]:
        """Return the metres to the right and up that a texture covers before it repeats."""
        return self._sizes_m[self.texture_row(name)]

    def mesh_faces(self, name: str) -> tuple[int, int]:
        """Return the first face of a mesh in ``faces`` and one past its last, after loading it if necessary."""
        if name not in self._mesh_ranges:
            self._add_mesh(name, self._assets.mesh(name))
        return self._mesh_ranges[name]

    def mesh_scale(self, name: str, height_m: float) -> tuple[float, float]:
        """Return the factor that scales a mesh to a height in metres, and the factor by which it scales normals."""
        self.mesh_faces(name)
        mesh = self._meshes[name]
        scale = height_m / mesh.height
        return scale, 1.0 / scale if mesh.light_scales else 1.0

    def mesh_reach(self, name: str) -> tuple[float, float]:
        """Return a mesh's largest distances from its axis and from the middle of its base, in its own units."""
        self.mesh_faces(name)
        return self._reaches[name]

    def mesh_box(self, name: str) -> tuple[float, float, float, float]:
        """Return the bounding box of a mesh: half its width, its lowest and highest y, half its depth."""
        self.mesh_faces(name)
        return self._boxes[name]

    def mesh_extents(self, name: str) -> tuple[float, float, float]:
        """Return half the width, the height and half the depth of a mesh in its own units."""
        self.mesh_faces(name)
        mesh = self._meshes[name]
        return mesh.half_width, mesh.height, mesh.half_depth

    def brings(self, mesh: str) -> bool:
        """Return whether a mesh is not built in."""
        return self._assets.brings(mesh)

    def _add_texture(self, name: str, texture: Texture) -> None:
        self.textures = _append_texture(self.textures, texture.pixels)
        self._texture_rows[name] = len(self._sizes_m)
        self._sizes_m.append(texture.size_m)

    def _add_mesh(self, name: str, mesh: MeshData) -> None:
        """Add a mesh with the textures of its file, and record its faces, distances and bounding box."""
        for image, texture in mesh.images.items():
            self._add_texture(image, texture)
        rows = np.array([-1 if key is None else self.texture_row(key) for key in mesh.textures], np.int32)
        first = len(self.faces.texture)
        self.faces = join(self.faces, mesh_table(mesh, rows))
        self._mesh_ranges[name] = first, len(self.faces.texture)
        self._meshes[name] = mesh
        points = mesh.corners.reshape(-1, 3)
        around = points[:, 0] ** 2 + points[:, 2] ** 2
        heights = points[:, 1]
        self._reaches[name] = float(np.sqrt(around.max())), float(np.sqrt((around + heights**2).max()))
        self._boxes[name] = mesh.half_width, float(heights.min()), mesh.height, mesh.half_depth


def mesh_table(mesh: MeshData, texture_rows: NDArray[np.int32]) -> FaceTable:
    """Return a mesh as a table of faces, without degenerate triangles."""
    edge_a = mesh.corners[:, 1] - mesh.corners[:, 0]
    edge_b = mesh.corners[:, 2] - mesh.corners[:, 0]
    normal = np.cross(edge_a, edge_b)
    valid = np.any(normal != 0.0, axis=1)
    normal = normal[valid]
    count = int(valid.sum())
    offset = -np.einsum("ij,ij->i", normal, mesh.corners[valid, 0])
    return FaceTable(
        np.arange(0, 3 * count + 1, 3, dtype=np.int32),
        np.ascontiguousarray(mesh.corners[valid]).reshape(-1, 3),
        np.ascontiguousarray(mesh.texture_places[valid]).reshape(-1, 2),
        np.ascontiguousarray(mesh.normals[valid]).reshape(-1, 3),
        np.ascontiguousarray(mesh.colours[valid]),
        texture_rows[valid],
        np.column_stack([normal, offset]),
    )


def pack(polygons: list[F64], places: list[F64], texture_rows: list[int] | None = None) -> FaceTable:
    """Return a table of white flat polygons.

    Args:
        polygons: the corners of each polygon, (n, 3).
        places: the texture coordinates of each polygon's corners, (n, 2).
        texture_rows: the row of each polygon's texture, or -1 for none; None for polygons without textures.

    Raises:
        WorldError: if the corners of a polygon lie on one line.
    """
    normals = [newell(polygon) for polygon in polygons]
    sizes = [len(polygon) for polygon in polygons]
    offsets = [-float(normal @ polygon.mean(axis=0)) for normal, polygon in zip(normals, polygons, strict=True)]
    return FaceTable(
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32),
        np.concatenate([np.zeros((0, 3)), *polygons]),
        np.concatenate([np.zeros((0, 2)), *places]),
        np.repeat(np.array(normals).reshape(-1, 3), sizes, axis=0),
        np.ones((len(polygons), 3)),
        np.array(texture_rows if texture_rows is not None else [-1] * len(polygons), np.int32),
        np.column_stack([np.array(normals).reshape(-1, 3), np.array(offsets)]),
    )


def join(a: FaceTable, b: FaceTable) -> FaceTable:
    """Return two tables of faces joined into one."""
    return FaceTable(
        np.concatenate([a.start, b.start[1:] + a.start[-1]]).astype(np.int32),
        np.concatenate([a.position, b.position]),
        np.concatenate([a.texture_place, b.texture_place]),
        np.concatenate([a.normal, b.normal]),
        np.concatenate([a.colour, b.colour]),
        np.concatenate([a.texture, b.texture]),
        np.concatenate([a.plane, b.plane]),
    )


def newell(polygon: F64) -> F64:
    """Return the unit normal of a flat polygon, on the side from which its corners run counter-clockwise.

    The normal is computed by Newell's method.

    Raises:
        WorldError: if the corners lie on one line.
    """
    following = np.roll(polygon, -1, axis=0)
    normal = np.array(
        [
            np.sum((polygon[:, b] - following[:, b]) * (polygon[:, c] + following[:, c]))
            for b, c in ((1, 2), (2, 0), (0, 1))
        ]
    )
    length = float(np.sqrt(np.sum(normal * normal)))
    if length == 0.0:
        raise WorldError(f"the surface {polygon.tolist()} has no area; give it three corners that are not on one line")
    return normal / length


def unit_cube() -> list[F64]:
    """Return the six sides of a cube one metre wide, with the middle of its base at the origin."""
    sides = []
    for axis in range(3):
        for side in (-0.5, 0.5):
            square = np.zeros((4, 3))
            square[:, axis] = side  # the corners run counter-clockwise as seen from the positive end of the axis
            square[:, (axis + 1) % 3] = [-0.5, 0.5, 0.5, -0.5]
            square[:, (axis + 2) % 3] = [-0.5, -0.5, 0.5, 0.5]
            square[:, 1] += 0.5
            sides.append(square if side > 0 else square[::-1])
    return sides


def _disc(radius: float) -> F64:
    """Return the sixteen corners of a disc around the origin, just above the ground."""
    # the cosine and sine of 0, 22.5, 45 and 67.5 degrees; three quarter turns give the other corners
    corners = [(1.0, 0.0), (0.9238795, 0.3826834), (0.7071068, 0.7071068), (0.3826834, 0.9238795)]
    for _ in range(3):
        corners += [(-z, x) for x, z in corners[-4:]]
    return np.array([(radius * x, _ABOVE_GROUND_M, -radius * z) for x, z in corners])


def _append_texture(textures: TextureTable, pixels: NDArray[np.uint8]) -> TextureTable:
    table = size_table(pixels.shape[1], pixels.shape[0], len(textures.texels))
    texels = np.concatenate([textures.texels, np.empty(_texel_count(table), np.uint32)])
    fill_sizes(np.array(pixels, order="C"), table.ravel(), texels)
    return TextureTable(texels, np.concatenate([textures.table, table.ravel()]))


def size_table(width: int, height: int, begin: int) -> NDArray[np.uint32]:
    """Return the pairs of a texture (see `TextureTable`) whose first texel is at ``begin``, uint32[MOST_SIZES, 2]."""
    table = np.zeros((MOST_SIZES, 2), np.uint32)
    size = 0
    wide = width
    high = height
    while True:
        table[size] = begin, wide | high << 16
        if wide == high == 1:
            break
        begin = begin + (wide + 2) * (high + 2)
        size = size + 1
        part = 0.5 ** (size / 4)  # four sizes for each halving
        wide = max(1, round(width * part))
        high = max(1, round(height * part))
    table[-1, 1] = size
    return table


def _texel_count(table: NDArray[np.uint32]) -> int:
    """Return the number of texels of a texture in all its sizes, rings included, from its `size_table`."""
    last = int(table[-1, 1])
    return int(table[last, 0]) - int(table[0, 0]) + 9  # the smallest size is one texel in its ring
