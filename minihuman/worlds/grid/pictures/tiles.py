"""Tiles: the drawing of each object at any size, in a flat style with soft corners; with palettes and shapes.

A shape is an array of signed distances to its edge in tile widths (negative inside) at a tile's pixel centres, so every
edge is smooth at every size; u points right and v down, both 0 to 1 across the tile. The palette `colour-safe` keeps
all six colours distinguishable for colour-blind viewers; `minigrid` also uses Minigrid's tiles, which `minigrid_tiles`
draws.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette
from minihuman.worlds.grid.core import cells
from minihuman.worlds.grid.core.cells import colour_of, kind_of, state_of
from minihuman.worlds.grid.core.state import FIRST_OWN_KIND

RGB = tuple[int, int, int]


class DrawnKind(Protocol):
    """The part of a world's own object kind that a tile needs; ``object_kinds`` has the whole kind."""

    @property
    def draw(self) -> "Callable[[Canvas, RGB, str], None]":
        """Return the function that paints an object of the kind on a tile, given its colour and state."""
        ...


GridPalette = Palette | Literal["minigrid"]
GRID_PALETTES: tuple[GridPalette, ...] = ("classic", "colour-safe", "minigrid")

# by colour number: red, green, blue, purple, yellow, grey
OBJECT_COLOURS: Mapping[GridPalette, tuple[RGB, ...]] = MappingProxyType(
    {
        "classic": ((235, 64, 52), (60, 200, 80), (66, 121, 245), (160, 88, 224), (247, 214, 64), (158, 163, 172)),
        # told apart by lightness as well as by hue; a test measures this for three kinds of eyes
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
FLOOR_COLOUR: RGB = (36, 39, 46)
GRID_LINE: RGB = (54, 58, 67)
UNSEEN: RGB = (10, 10, 13)
WALL_COLOUR: RGB = (96, 101, 112)


def colour_rgb(code: int, palette: GridPalette) -> RGB:
    """Return the colour in which an object with this code is drawn."""
    if kind_of(code) == cells.LAVA:
        return LAVA_COLOURS[palette]
    return OBJECT_COLOURS[palette][colour_of(code)]


def hex_colour(code: int, palette: GridPalette) -> str:
    """Return the colour in which an object with this code is drawn, as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*colour_rgb(code, palette))


Plane = NDArray[np.float64]  # (px, px)


class Canvas:
    """A tile that is being painted: the colour of each pixel as floats from 0 to 255, and its opacity."""

    def __init__(self, size_px: int) -> None:
        centres = (np.arange(size_px) + 0.5) / size_px
        self.size_px = size_px
        self.v, self.u = np.meshgrid(centres, centres, indexing="ij")
        self.rgb = np.zeros((size_px, size_px, 3))
        self.alpha = np.zeros((size_px, size_px))

    def fill(self, shape: Plane, colour: tuple[float, float, float], opacity: float = 1.0) -> None:
        """Paint the inside of a shape in a colour, over what is there; pixels at its edge are blended."""
        cover = np.clip(0.5 - shape * self.size_px, 0.0, 1.0) * opacity
        alpha = cover + self.alpha * (1 - cover)
        share = np.divide(cover, alpha, out=np.zeros_like(cover), where=alpha > 0)[..., None]
        self.rgb = self.rgb * (1 - share) + np.asarray(colour) * share
        self.alpha = alpha

    def everywhere(self) -> Plane:
        """Return the shape of the whole tile."""
        return np.full_like(self.u, -1.0)

    def disc(self, u: float, v: float, radius: float) -> Plane:
        """Return the shape of a disc with the centre (u, v); all lengths are in tiles."""
        return np.hypot(self.u - u, self.v - v) - radius

    def box(self, left: float, top: float, right: float, bottom: float, corner: float = 0.0) -> Plane:
        """Return the shape of a rectangle whose corners are rounded with the radius ``corner``; lengths in tiles."""
        du = np.abs(self.u - (left + right) / 2) - (right - left) / 2 + corner
        dv = np.abs(self.v - (top + bottom) / 2) - (bottom - top) / 2 + corner
        return np.hypot(np.maximum(du, 0), np.maximum(dv, 0)) + np.minimum(np.maximum(du, dv), 0) - corner

    def bar(self, u0: float, v0: float, u1: float, v1: float, radius: float) -> Plane:
        """Return the shape of a line from (u0, v0) to (u1, v1) with round ends, ``radius`` to each side of it."""
        along = np.clip(
            ((self.u - u0) * (u1 - u0) + (self.v - v0) * (v1 - v0)) / ((u1 - u0) ** 2 + (v1 - v0) ** 2), 0, 1
        )
        return np.hypot(self.u - u0 - along * (u1 - u0), self.v - v0 - along * (v1 - v0)) - radius

    def polygon(self, *corners: tuple[float, float], rounding: float = 0.0) -> Plane:
        """Return the shape of a simple polygon, given its corners in order, grown and rounded by ``rounding``."""
        distance = np.full_like(self.u, np.inf)
        inside = np.zeros(self.u.shape, bool)
        for (u0, v0), (u1, v1) in zip(corners, corners[1:] + corners[:1], strict=True):
            distance = np.minimum(distance, self.bar(u0, v0, u1, v1, 0.0))
            if v0 != v1:
                crosses = (self.v < v0) != (self.v < v1)
                inside ^= crosses & (self.u < u0 + (self.v - v0) / (v1 - v0) * (u1 - u0))
        return np.where(inside, -distance, distance) - rounding


Colour = tuple[float, float, float]


def shade(colour: RGB, amount: float) -> Colour:
    """Return a colour that is lightened (amounts above 0, 1 for white) or darkened (below 0, -1 for black)."""
    target = 255 if amount > 0 else 0
    red, green, blue = (part + (target - part) * abs(amount) for part in colour)
    return red, green, blue


def draw_cell_tile(code: int, size_px: int, palette: Palette, kinds: "Sequence[DrawnKind]" = ()) -> Canvas:
    """Return an opaque tile of a cell with the object in it, as it is drawn from above.

    Args:
        code: the code of the cell.
        size_px: the number of pixels on a side of the tile.
        palette: the colours.
        kinds: the world's own kinds.
    """
    canvas = Canvas(size_px)
    kind = kind_of(code)
    colour = colour_rgb(code, palette)
    if kind == cells.WALL:
        _paint_wall(canvas, colour)
        return canvas
    if kind == cells.LAVA:
        _paint_lava(canvas, colour)
        return canvas
    canvas.fill(canvas.everywhere(), GRID_LINE)
    line = max(0.5 / size_px, 0.012)
    canvas.fill(canvas.box(line, line, 1 - line, 1 - line), FLOOR_COLOUR)
    if kind == cells.FLOOR:
        canvas.fill(canvas.box(line, line, 1 - line, 1 - line), shade(colour, -0.55))
    elif kind != cells.EMPTY:
        paint(canvas, code, palette, kinds)
    return canvas


def draw_unseen_tile(size_px: int) -> Canvas:
    """Return the tile of a cell that the agent does not see."""
    canvas = Canvas(size_px)
    canvas.fill(canvas.everywhere(), UNSEEN)
    return canvas


def draw_carried(code: int, size_px: int, palette: Palette, kinds: "Sequence[DrawnKind]" = ()) -> Canvas:
    """Return a picture of a carried object on a dark disc without background; arguments as in `draw_cell_tile`."""
    canvas = Canvas(size_px)
    canvas.fill(canvas.disc(0.5, 0.5, 0.5), UNSEEN, opacity=0.85)
    paint(canvas, code, palette, kinds)
    return canvas


def agent(direction: int, size_px: int, palette: Palette, colour: RGB | None = None) -> Canvas:
    """Return a tile of the agent as an arrowhead without background, looking right (0), down (1), left (2) or up (3).

    Its colour is the palette's colour of the agent unless another is given.
    """
    canvas = Canvas(size_px)
    for _ in range(direction):
        canvas.u, canvas.v = canvas.v, 1 - canvas.u
    colour = colour or AGENT_COLOURS[palette]
    corners = ((0.22, 0.24), (0.80, 0.50), (0.22, 0.76), (0.34, 0.50))
    canvas.fill(canvas.polygon(*corners, rounding=0.085), shade(colour, -0.75))
    canvas.fill(canvas.polygon(*corners, rounding=0.045), colour)
    return canvas


Part = tuple[Callable[..., Plane], tuple[Any, ...], float]  # a shape, its measures, how much lighter than the colour


def paint(canvas: Canvas, code: int, palette: Palette, kinds: "Sequence[DrawnKind]" = ()) -> None:
    """Paint the object with a code on a canvas, over what is there; ``kinds`` are the world's own kinds."""
    colour = colour_rgb(code, palette)
    kind = kind_of(code)
    state = state_of(code)
    if kind >= FIRST_OWN_KIND:
        kinds[kind - FIRST_OWN_KIND].draw(canvas, colour, cells.DOOR_STATES[state])
    for shape, measures, lightness in _DOORS[state] if kind == cells.DOOR else _OBJECTS.get(kind, ()):
        canvas.fill(shape(canvas, *measures), shade(colour, lightness))


def _paint_wall(canvas: Canvas, colour: RGB) -> None:
    body = WALL_COLOUR
    if colour[0] != colour[2]:  # a quarter of any colour but a neutral grey is mixed in
        red, green, blue = ((3 * plain + tint) / 4 for plain, tint in zip(WALL_COLOUR, colour, strict=True))
        body = (int(red), int(green), int(blue))
    edge = max(1 / canvas.size_px, 0.05)
    canvas.fill(canvas.everywhere(), shade(body, -0.38))
    canvas.fill(canvas.box(-1, -1, 1 - edge, 1 - edge), shade(body, 0.18))
    canvas.fill(canvas.box(edge, edge, 1 - edge, 1 - edge), body)


def _paint_lava(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.everywhere(), colour)
    for v in (0.30, 0.55, 0.80):
        _paint_wave(canvas, v, shade(colour, -0.45))
    for v in (0.24, 0.49, 0.74):
        _paint_wave(canvas, v, shade(colour, 0.45))


def _paint_wave(canvas: Canvas, v: float, colour: Colour) -> None:
    """Paint a wave, a zigzag of four lines across the tile, around the height ``v``."""
    points = [(0.08 + 0.21 * i, v + (0.05 if i % 2 else -0.05)) for i in range(5)]
    for (u0, v0), (u1, v1) in pairwise(points):
        canvas.fill(canvas.bar(u0, v0, u1, v1, 0.022), colour)


def _ring(canvas: Canvas, u: float, v: float, radius: float, thickness: float) -> Plane:
    """Return the shape of a ring that extends ``thickness`` to each side of a circle with the centre (u, v)."""
    return abs(canvas.disc(u, v, radius)) - thickness


_OBJECTS: Mapping[int, tuple[Part, ...]] = MappingProxyType(
    {
        cells.GOAL: (
            (Canvas.box, (0.04, 0.04, 0.96, 0.96, 0.08), -0.25),
            (Canvas.box, (0.12, 0.12, 0.88, 0.88, 0.06), 0.0),
            (Canvas.box, (0.30, 0.30, 0.70, 0.70, 0.06), 0.45),
        ),
        cells.KEY: tuple(
            part
            for grow, lightness in ((0.035, -0.6), (0.0, 0.0))
            for part in (
                (_ring, (0.5, 0.29, 0.145, 0.055 + grow), lightness),
                (Canvas.bar, (0.5, 0.44, 0.5, 0.82, 0.05 + grow), lightness),
                (Canvas.bar, (0.5, 0.66, 0.655, 0.66, 0.042 + grow), lightness),
                (Canvas.bar, (0.5, 0.80, 0.655, 0.80, 0.042 + grow), lightness),
            )
        ),
        cells.BALL: (
            (Canvas.disc, (0.5, 0.5, 0.32), -0.35),
            (Canvas.disc, (0.49, 0.485, 0.285), 0.0),
            (Canvas.disc, (0.40, 0.38, 0.075), 0.6),
        ),
        cells.BOX: (
            (Canvas.box, (0.15, 0.17, 0.85, 0.85, 0.06), -0.35),
            (Canvas.box, (0.20, 0.44, 0.80, 0.80, 0.03), 0.0),
            (Canvas.box, (0.20, 0.22, 0.80, 0.38, 0.03), 0.25),
            (Canvas.box, (0.43, 0.34, 0.57, 0.54, 0.03), -0.6),
        ),
    }
)
_LEAF: tuple[Part, ...] = (
    (Canvas.box, (0.0, 0.0, 1.0, 1.0), -0.62),
    (Canvas.box, (0.09, 0.09, 0.91, 0.91, 0.04), 0.0),
)
_DOORS: Mapping[int, tuple[Part, ...]] = MappingProxyType(
    {
        cells.OPEN: (
            (Canvas.box, (0.0, 0.0, 1.0, 0.10), -0.62),
            (Canvas.box, (0.0, 0.90, 1.0, 1.0), -0.62),
            (Canvas.box, (0.04, 0.04, 0.20, 0.96, 0.02), 0.0),
        ),
        cells.CLOSED: (
            *_LEAF,
            (Canvas.box, (0.18, 0.18, 0.82, 0.46, 0.03), -0.28),
            (Canvas.box, (0.18, 0.54, 0.82, 0.82, 0.03), -0.28),
            (Canvas.disc, (0.79, 0.50, 0.065), 0.7),
        ),
        cells.LOCKED: (
            *_LEAF,
            (Canvas.box, (0.17, 0.17, 0.83, 0.83, 0.03), -0.45),
            (Canvas.disc, (0.5, 0.42, 0.11), 0.55),
            (Canvas.polygon, ((0.46, 0.44), (0.54, 0.44), (0.59, 0.70), (0.41, 0.70)), 0.55),
        ),
    }
)
