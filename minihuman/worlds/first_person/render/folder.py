"""Assets from a folder laid out like Miniworld's: ``textures/NAME.png`` and ``meshes/NAME.obj``."""

from pathlib import Path

import numpy as np
from PIL import Image

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import Assets, Mesh, Texture
from minihuman.worlds.first_person.render.obj import read_obj

TEXELS_A_METRE = 512


class FolderAssets(Assets):
    """The textures and meshes in a folder; an installed ``miniworld`` package's folder is one."""

    def __init__(self, folder: Path) -> None:
        if not (folder / "textures").is_dir():
            raise WorldError(f"{folder} has no folder textures in it; give the folder that holds textures and meshes")
        self._folder = folder

    def texture(self, name: str) -> Texture:
        """A PNG of the folder, 512 texels a metre; a mesh's texture is named by its path."""
        path = Path(name) if name.endswith(".png") else self._folder / "textures" / f"{name}.png"
        try:
            with Image.open(path) as image:
                pixels = np.asarray(image.convert("RGB"))
        except OSError as error:
            raise WorldError(f"texture {name!r}: {path} cannot be read as a picture") from error
        height, width = pixels.shape[:2]
        return Texture(pixels, (width / TEXELS_A_METRE, height / TEXELS_A_METRE))

    def mesh(self, name: str) -> Mesh:
        """An OBJ file of the folder."""
        return read_obj(self._folder / "meshes" / f"{name}.obj")
