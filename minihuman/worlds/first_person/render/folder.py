"""Assets from a folder: ``textures/NAME.png``, ``meshes/NAME.obj`` and ``meshes/NAME.glb``, added to our own.

What the folder has is taken from it, everything else from our own; Miniworld's package folder is laid out so, too.
"""

from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import Assets, Mesh, Texture
from minihuman.worlds.first_person.render.glb import read_glb
from minihuman.worlds.first_person.render.obj import read_obj
from minihuman.worlds.first_person.render.own import OwnAssets

TEXELS_A_METRE = 512
_READERS = {".obj": read_obj, ".glb": read_glb}


class FolderAssets(Assets):
    """The textures and meshes in a folder, and our own where it has none of a name."""

    def __init__(self, folder: Path) -> None:
        if not any((folder / part).is_dir() for part in ("textures", "meshes")):
            raise WorldError(f"{folder} has no folder textures or meshes in it; give the folder that holds them")
        self._folder = folder
        self._own = OwnAssets()

    @cached_property
    def meshes(self) -> dict[str, Path]:
        """The folder's meshes: their files by name."""
        files = sorted((self._folder / "meshes").glob("*"), reverse=True)  # an OBJ file stands before a GLB file
        return {file.stem: file for file in files if file.suffix in _READERS}

    def texture(self, name: str) -> Texture:
        """A PNG of the folder, 512 texels a metre; ``NAME.png`` is also the first picture of a texture, "NAME_1"."""
        path = self._texture_file(name)
        if path is None:
            try:
                return self._own.texture(name)
            except WorldError as error:
                raise WorldError(f"{self._folder} has no texture {name!r}, and {error}") from error
        try:
            with Image.open(path) as image:
                pixels = np.asarray(image.convert("RGB"))
        except OSError as error:
            raise WorldError(f"texture {name!r}: {path} cannot be read as a picture") from error
        height, width = pixels.shape[:2]
        return Texture(pixels, (width / TEXELS_A_METRE, height / TEXELS_A_METRE))

    def mesh(self, name: str) -> Mesh:
        """An OBJ or GLB file of the folder, or our own mesh of that name."""
        file = self.meshes.get(name)
        if file is not None:
            return _READERS[file.suffix](file)
        try:
            return self._own.mesh(name)
        except WorldError as error:
            raise WorldError(f"{self._folder} has no mesh {name!r}, and {error}") from error

    def brings(self, mesh: str) -> bool:
        """Whether the folder has this mesh."""
        return mesh in self.meshes

    def _texture_file(self, name: str) -> Path | None:
        """Where a texture is; None where it is not the folder's. A mesh's texture is named by its path."""
        if name.endswith(".png"):
            return Path(name)
        names = (name, name.removesuffix("_1"))
        return next(
            (file for file in (self._folder / "textures" / f"{one}.png" for one in names) if file.exists()), None
        )
