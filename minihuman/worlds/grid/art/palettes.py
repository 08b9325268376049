"""Palettes: what the colours look like. ``colour-safe`` keeps all six apart for colour-blind eyes.

``minigrid`` has the very tiles of Minigrid too, which ``minigrid_tiles`` draws.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from minihuman.worlds.contract import Palette
from minihuman.worlds.grid.core.cells import LAVA, colour_of, kind_of

RGB = tuple[int, int, int]
GridPalette = Palette | Literal["minigrid"]
GRID_PALETTES: tuple[GridPalette, ...] = ("classic", "colour-safe", "minigrid")

# by colour number: red, green, blue, purple, yellow, grey
OBJECT_COLOURS: Mapping[GridPalette, tuple[RGB, ...]] = MappingProxyType(
    {
        "classic": ((235, 64, 52), (60, 200, 80), (66, 121, 245), (160, 88, 224), (247, 214, 64), (158, 163, 172)),
        # told apart by lightness as well as by hue; the test beside this measures it for three kinds of eyes
        "colour-safe": ((208, 100, 12), (0, 130, 90), (32, 80, 255), (172, 140, 215), (255, 245, 130), (200, 200, 200)),
        "minigrid": ((255, 0, 0), (0, 255, 0), (0, 0, 255), (112, 39, 195), (255, 255, 0), (100, 100, 100)),
    }
)
LAVA_COLOURS: Mapping[GridPalette, RGB] = MappingProxyType(
    {"classic": (240, 120, 36), "colour-safe": (230, 130, 20), "minigrid": (255, 128, 0)}
)
AGENT_COLOURS: Mapping[GridPalette, RGB] = MappingProxyType(
    {"classic": (255, 74, 62), "colour-safe": (255, 255, 255), "minigrid": (255, 0, 0)}
)
FLOOR: RGB = (36, 39, 46)
GRID_LINE: RGB = (54, 58, 67)
UNSEEN: RGB = (10, 10, 13)
WALL: RGB = (96, 101, 112)


def colour_rgb(code: int, palette: GridPalette) -> RGB:
    """The colour in which a thing is drawn."""
    return LAVA_COLOURS[palette] if kind_of(code) == LAVA else OBJECT_COLOURS[palette][colour_of(code)]


def hex_colour(code: int, palette: GridPalette) -> str:
    """The colour of a thing as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*colour_rgb(code, palette))
