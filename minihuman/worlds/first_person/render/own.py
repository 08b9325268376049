"""Our own assets: textures painted and meshes turned on first use, letters drawn from the built-in font."""

import zlib

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.assets import Assets, Library, Mesh, Texture
from minihuman.worlds.first_person.render.noise import as_bright
from minihuman.worlds.first_person.render.paint import RECIPES
from minihuman.worlds.first_person.render.shapes import SHAPES, mesh_named

_LETTER_PX = 128
_LETTER_STYLES = 9  # as many looks of a letter as Miniworld draws from


class OwnAssets(Assets):
    """The textures of ``paint.RECIPES``, a picture for each letter and digit, and the meshes of ``shapes.SHAPES``."""

    def texture(self, name: str) -> Texture:
        """Paint a texture. A letter is "chars/ch_0x", its code and "_" and a variant; others are a recipe's name."""
        stem, _, variant = name.rpartition("_")
        if not variant.isdigit():
            stem, variant = name, "1"
        if stem.startswith("chars/ch_0x") and stem[11:].isdigit():
            return _letter(chr(int(stem[11:])), int(variant))
        if stem not in RECIPES or not 1 <= int(variant) <= len(RECIPES[stem][1]):
            raise WorldError(
                f"there is no texture {name!r}; there are {', '.join(RECIPES)}, with _1 and up for variants"
            )
        recipe, kinds = RECIPES[stem]
        wide_m, high_m, bright = kinds[int(variant) - 1]
        seed = zlib.crc32(stem.encode()) % 1_000_003 + 1000 * int(variant)
        return Texture(as_bright(recipe(seed), bright), (wide_m, high_m))

    def mesh(self, name: str) -> Mesh:
        """Make a mesh."""
        mesh = mesh_named(name)
        if mesh is None:
            raise WorldError(
                f"there is no mesh {name!r}; there are {', '.join(SHAPES)}; balls and keys have a colour: key_red"
            )
        return mesh


def own_library() -> Library:
    """A library of our own assets; it fills as scenes ask for them."""
    return Library(OwnAssets())


def _letter(letter: str, variant: int) -> Texture:
    """A dark letter on paper, or its like: the variants differ in ink and paper."""
    if not 1 <= variant <= _LETTER_STYLES:
        raise WorldError(f"the letter {letter!r} has variants 1 to {_LETTER_STYLES}, not {variant}")
    paper = 250 - 9 * (variant - 1)
    image = Image.new("RGB", (_LETTER_PX, _LETTER_PX), (paper, paper, max(paper - 4 * variant, 0)))
    font = ImageFont.load_default(112)
    ink = (18 + 6 * variant, 20, 28 + 8 * variant)
    ImageDraw.Draw(image).text((_LETTER_PX / 2, _LETTER_PX / 2), letter, font=font, fill=ink, anchor="mm")
    return Texture(np.asarray(image), (0.25, 0.25))
