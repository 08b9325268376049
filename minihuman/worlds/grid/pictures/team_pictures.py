"""Pictures of a grid with several bodies, and of a kitchen from above.

In a grid, each body is an arrowhead in its colour, with what it carries in a corner. A kitchen shows stations, pots
with their clocks, and cooks in their colours with what they hold.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette, View
from minihuman.worlds.grid.core import kitchen_rules as fields
from minihuman.worlds.grid.core.bodies import BODY_COLOURS, body_index, count_bodies, see_body
from minihuman.worlds.grid.core.cells import AGENT, EMPTY, ahead
from minihuman.worlds.grid.core.kitchen_rules import clock_of, kind_of, onions_in, recipe_of, tomatoes_in
from minihuman.worlds.grid.core.state import CARRYING, HEIGHT, WIDTH, Row, X, row_length
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.object_kinds import ObjectKind
from minihuman.worlds.grid.pictures.drawing import LOOKS, Pixels, atlas, draw_cells
from minihuman.worlds.grid.pictures.tiles import OBJECT_COLOURS, RGB, Canvas, agent, shade


class Figure(NamedTuple):
    """A partly transparent figure, prepared for `blend`.

    Arrays of the same shape are blended ten times as fast as arrays that must be broadcast.
    """

    paint: NDArray[np.uint16]  # [px, px, 3]: colours times opacity, plus 127, so that a division by 255 rounds
    through: NDArray[np.uint16]  # [px, px, 3]: the transparency, 0 to 255


def prepare_figure(pixels: Pixels) -> Figure:
    """Return a figure made from pixels uint8[px, px, 4], the last channel of which is the opacity."""
    opacity = np.repeat(pixels[..., 3:], 3, axis=2).astype(np.uint16)
    return Figure(pixels[..., :3] * opacity + np.uint16(127), 255 - opacity)


@lru_cache(maxsize=256)
def draw_body(body: int, direction: int, tile_px: int, palette: Palette) -> Figure:
    """Return the arrowhead of a body as a figure for `blend`, ``tile_px`` pixels on a side.

    The body looks in the direction 0 (right), 1 (down), 2 (left) or 3 (up).
    """
    canvas = agent(direction, tile_px, palette, OBJECT_COLOURS[palette][BODY_COLOURS[body]])
    return prepare_figure(np.dstack([canvas.rgb, 255 * canvas.alpha]).round().astype(np.uint8))


def blend(figure: Figure, left: int, top: int, out: Pixels) -> None:
    """Blend a figure into the picture ``out`` at a pixel column and row: the colours' mean, weighted by the opacity."""
    under = out[top : top + figure.paint.shape[0], left : left + figure.paint.shape[1]]
    mixed = under * figure.through  # with the paint at most 65,152, so that uint16 holds it
    mixed += figure.paint
    mixed //= 255
    under[:] = mixed


def draw_team(
    row: Row,
    body: int,
    *,
    view: View,
    view_size: int,
    tile_px: int,
    palette: Palette,
    kinds: tuple[ObjectKind, ...] = (),
) -> Pixels:
    """Return a picture of what a body sees, looking up ("partial"), or of the grid with this part lit ("full")."""
    tile_atlas = atlas(tile_px, palette, kinds)
    bodies = [row[body_index(row, number) :][:4].tolist() for number in range(count_bodies(row))]
    single_row = row[: row_length(int(row[WIDTH]), int(row[HEIGHT]))].copy()
    single_row[X : X + 4] = bodies[body]
    x, y, facing, _ = bodies[body]
    image = np.zeros((view_size, view_size, 3), np.uint8)
    own_view = image.copy()
    see(single_row, image)
    see_body(row, body, own_view)
    single_row[CARRYING] = EMPTY  # drawn below
    columns, rows = (view_size, view_size) if view == "partial" else (int(row[WIDTH]), int(row[HEIGHT]))
    out = np.empty((rows * tile_px, columns * tile_px, 3), np.uint8)
    lines = out.reshape(rows * tile_px, -1)
    lit = np.zeros((columns, rows), np.int64)
    tables = (
        tile_atlas.number,
        tile_atlas.under,
        tile_atlas.tiles.view(np.uint8),
        np.zeros_like(tile_atlas.agents),
        tile_atlas.carried,
    )
    draw_cells(single_row, image, view == "full", False, lit, *tables, lines, lines)
    forward_x, forward_y = ahead(0, 0, facing)
    for number, (column, line, direction, carrying) in enumerate(bodies):
        if view == "partial":
            n_ahead = (column - x) * forward_x + (line - y) * forward_y
            n_right = (line - y) * forward_x - (column - x) * forward_y
            column = view_size // 2 + n_right
            line = view_size - 1 - n_ahead
            is_in_view = 0 <= column < view_size and 0 <= line < view_size
            if number != body and not (is_in_view and own_view[column, line, 0] == AGENT):
                continue
            direction = (direction - facing + 3) % 4
        blend(draw_body(number, direction, tile_px, palette), column * tile_px, line * tile_px, out)
        if carrying != EMPTY:
            small = tile_atlas.carried[tile_atlas.number[carrying & LOOKS - 1]]
            inset = tile_px - small.shape[0]
            blend(prepare_figure(small), column * tile_px + inset, line * tile_px + inset, out)
    return out


THING_NAMES = ("floor", "pot", "counter", "onions", "tomatoes", "plates", "serving hatch")  # by terrain
_ONION: RGB = (236, 200, 96)
_TOMATO: RGB = (222, 66, 52)
_SKIN: RGB = (150, 112, 40)  # of onions
_LEAF: RGB = (70, 150, 70)  # of tomatoes
_PLATE: RGB = (240, 243, 248)
_COUNTER: RGB = (150, 119, 82)
_POT: RGB = (70, 76, 88)
_HATCH: RGB = (64, 170, 104)
_FLOOR: RGB = (226, 218, 204)
_STEEL: RGB = (176, 184, 196)
_DARK: RGB = (34, 36, 42)
_SOUP: RGB = (214, 140, 52)
_RAW: RGB = (92, 128, 170)  # the water of a pot that does not cook yet
_CLOCK_DOTS = 24  # of a pot's full clock
THING_COLOURS = tuple(
    "#{:02x}{:02x}{:02x}".format(*colour) for colour in (_FLOOR, _POT, _COUNTER, _ONION, _TOMATO, _PLATE, _HATCH)
)
# the places of one, two and three ingredients
_SPOTS = (((0.5, 0.5),), ((0.36, 0.5), (0.64, 0.5)), ((0.5, 0.36), (0.36, 0.62), (0.64, 0.62)))


def list_kitchen_tiles(row: Row, body: int, tile_px: int, palette: Palette) -> list[tuple[Any, ...]]:
    """Return the arguments with which `draw_kitchen_tile` draws each cell of a kitchen, row by row.

    The cook with the number ``body`` has a white ring.
    """
    width, height, cooks = row[:3].tolist()
    times = row[fields.TIMES : fields.COOK].tolist()
    figures = {}
    for cook, (x, y, *looks) in enumerate(row[fields.COOK :][: 4 * cooks].reshape(cooks, 4).tolist()):
        figures[x, y] = (OBJECT_COLOURS[palette][BODY_COLOURS[cook]], *looks, cook == body)
    terrains, things = row[fields.COOK + 4 * cooks :].reshape(2, width, height).tolist()
    arguments = []
    for y in range(height):
        for x in range(width):
            thing = things[x][y]
            time = 0
            if kind_of(thing) == fields.SOUP:
                time = times[recipe_of(thing)]
            arguments.append((terrains[x][y], thing, time, figures.get((x, y)), tile_px))
    return arguments


@lru_cache(maxsize=1024)
def draw_kitchen_tile(
    terrain: int, thing: int, time: int, cook: tuple[RGB, int, int, bool] | None, size_px: int
) -> Pixels:
    """Return the picture of a cell of a kitchen: a station or the floor, and the cook on it.

    The caller must not write to the array, uint8[size_px, size_px, 3], because it is cached.

    Args:
        terrain: the number of the terrain.
        thing: the number of the object in the cell; 0 for none.
        time: the steps that the object cooks if it is a soup, else 0.
        cook: the cook's colour, direction, carried object, and whether it is the observing cook; None for no cook.
        size_px: the number of pixels on a side.
    """
    out = _draw_station(terrain, thing, time, size_px).copy()
    if cook is not None:
        blend(_draw_cook(*cook, size_px), 0, 0, out)
    return out


@lru_cache(maxsize=1024)
def _draw_station(terrain: int, thing: int, time: int, size_px: int) -> Pixels:
    """Return the picture of a station, or of the floor, with the object on it; see `draw_kitchen_tile`."""
    canvas = Canvas(size_px)
    if terrain == fields.FLOOR:
        canvas.fill(canvas.everywhere(), shade(_FLOOR, -0.14))
        canvas.fill(canvas.box(0.02, 0.02, 0.98, 0.98), _FLOOR)
        return canvas.rgb.round().astype(np.uint8)
    canvas.fill(canvas.everywhere(), shade(_COUNTER, -0.35))
    canvas.fill(canvas.box(0.02, 0.02, 0.98, 0.98, 0.06), _COUNTER)
    if terrain == fields.ONIONS or terrain == fields.TOMATOES:
        canvas.fill(canvas.box(0.1, 0.1, 0.9, 0.9, 0.1), shade(_COUNTER, -0.5))
        for u, v in ((0.33, 0.35), (0.67, 0.35), (0.33, 0.67), (0.67, 0.67)):
            _draw_vegetable(canvas, terrain == fields.ONIONS, u, v, 0.16)
    elif terrain == fields.DISHES:
        for v in (0.6, 0.5, 0.4):
            _draw_plate(canvas, 0.5, v, 0.3)
    elif terrain == fields.HATCH:
        canvas.fill(canvas.box(0.06, 0.06, 0.94, 0.94, 0.08), _HATCH)
        canvas.fill(canvas.bar(0.5, 0.7, 0.5, 0.36, 0.07), _PLATE)
        canvas.fill(canvas.polygon((0.5, 0.14), (0.76, 0.46), (0.24, 0.46), rounding=0.03), _PLATE)
    elif terrain == fields.POT:
        _draw_pot(canvas, thing, time)
    if terrain != fields.POT:
        _draw_thing(canvas, thing, 0.5, 0.5, 1.0)
    return canvas.rgb.round().astype(np.uint8)


@lru_cache(maxsize=512)
def _draw_cook(colour: RGB, direction: int, carried: int, is_observer: bool, size_px: int) -> Figure:
    """Return a cook seen from above, with a hat, a point that shows the direction, and the carried object.

    The observing cook has a white ring. ``direction`` is 0 up, 1 down, 2 right or 3 left.
    """
    canvas = Canvas(size_px)
    forward = ((0, -1), (0, 1), (1, 0), (-1, 0))[direction]
    if is_observer:
        canvas.fill(canvas.disc(0.5, 0.5, 0.49), _DARK)
        canvas.fill(canvas.disc(0.5, 0.5, 0.47), _PLATE)
    canvas.fill(canvas.disc(0.5, 0.5, 0.42), _DARK)
    canvas.fill(canvas.disc(0.5, 0.5, 0.38), colour)
    hat_u = 0.5 - 0.1 * forward[0]
    hat_v = 0.5 - 0.1 * forward[1]
    canvas.fill(canvas.disc(hat_u, hat_v, 0.22), shade(colour, -0.4))
    canvas.fill(canvas.disc(hat_u, hat_v, 0.19), _PLATE)
    tip = (0.5 + 0.49 * forward[0], 0.5 + 0.49 * forward[1])
    base = (0.5 + 0.33 * forward[0], 0.5 + 0.33 * forward[1])
    side = (0.17 * forward[1], 0.17 * forward[0])
    corners = (tip, (base[0] + side[0], base[1] + side[1]), (base[0] - side[0], base[1] - side[1]))
    canvas.fill(canvas.polygon(*corners, rounding=0.02), _DARK)
    if carried:
        _draw_thing(canvas, carried, 0.5 + 0.12 * forward[0], 0.5 + 0.12 * forward[1], 0.86)
    return prepare_figure(np.dstack([canvas.rgb, 255 * canvas.alpha]).round().astype(np.uint8))


def _draw_thing(canvas: Canvas, thing: int, u: float, v: float, size: float) -> None:
    """Draw an object that can be carried, centred at (u, v) in tiles, ``size`` times as large as usual; 0 is none."""
    kind = kind_of(thing)
    if kind == fields.ONION or kind == fields.TOMATO:
        _draw_vegetable(canvas, kind == fields.ONION, u, v, 0.21 * size)
    elif kind == fields.DISH:
        _draw_plate(canvas, u, v, 0.3 * size)
    elif kind == fields.SOUP:
        _draw_plate(canvas, u, v, 0.32 * size)
        canvas.fill(canvas.disc(u, v, 0.23 * size), shade(_SOUP, -0.3))
        canvas.fill(canvas.disc(u, v, 0.2 * size), _SOUP)
        _draw_ingredients(canvas, thing, u, v, 0.5 * size)


def _draw_pot(canvas: Canvas, thing: int, time: int) -> None:
    """Draw a pot from above with its contents ``thing``, and a clock that fills in ``time`` steps and turns green."""
    canvas.fill(canvas.box(0.04, 0.04, 0.96, 0.96, 0.08), shade(_POT, -0.5))
    canvas.fill(canvas.bar(0.12, 0.5, 0.88, 0.5, 0.07), _DARK)
    canvas.fill(canvas.disc(0.5, 0.5, 0.38), _STEEL)
    canvas.fill(canvas.disc(0.5, 0.5, 0.32), shade(_POT, -0.55))
    if not thing:
        return
    clock = clock_of(thing)
    is_ready = clock >= time
    canvas.fill(canvas.disc(0.5, 0.5, 0.3), _RAW if clock < 0 else _SOUP)
    _draw_ingredients(canvas, thing, 0.5, 0.5, 0.8)
    if clock >= 0:
        n_dots = _CLOCK_DOTS if is_ready else _CLOCK_DOTS * clock // max(time, 1)
        for dot in range(n_dots):
            angle_rad = math.tau * dot / _CLOCK_DOTS
            canvas.fill(
                canvas.disc(0.5 + 0.4 * math.sin(angle_rad), 0.5 - 0.4 * math.cos(angle_rad), 0.055),
                (70, 220, 110) if is_ready else (255, 255, 255),
            )


def _draw_ingredients(canvas: Canvas, thing: int, u: float, v: float, size: float) -> None:
    """Draw the onions and tomatoes of a soup around the point (u, v); ``size`` is their spread, all in tiles."""
    are_onions = [True] * onions_in(thing) + [False] * tomatoes_in(thing)
    for (spot_u, spot_v), is_onion in zip(_SPOTS[max(len(are_onions), 1) - 1], are_onions, strict=False):
        _draw_vegetable(canvas, is_onion, u + (spot_u - 0.5) * size, v + (spot_v - 0.5) * size, 0.13 * size)


def _draw_vegetable(canvas: Canvas, is_onion: bool, u: float, v: float, radius: float) -> None:
    """Draw an onion, or else a tomato, centred at (u, v); all lengths are in tiles."""
    colour = _ONION if is_onion else _TOMATO
    canvas.fill(canvas.disc(u, v, radius * 1.12), shade(colour, -0.55))
    canvas.fill(canvas.disc(u, v, radius), colour)
    if is_onion:
        for du, top, bottom, width in ((0.0, -1.2, -0.5, 0.16), (-0.3, -0.5, 0.5, 0.07), (0.3, -0.5, 0.5, 0.07)):
            stroke_u = u + radius * du
            canvas.fill(canvas.bar(stroke_u, v + radius * top, stroke_u, v + radius * bottom, radius * width), _SKIN)
    else:
        for du, dv in ((0.5, 0), (-0.5, 0), (0, 0.4)):
            tip = u + radius * du, v + radius * (dv - 0.6)
            canvas.fill(canvas.bar(u, v - radius * 0.6, *tip, radius * 0.16), _LEAF)


def _draw_plate(canvas: Canvas, u: float, v: float, radius: float) -> None:
    """Draw a plate centred at (u, v); all lengths are in tiles."""
    canvas.fill(canvas.disc(u, v, radius * 1.08), shade(_PLATE, -0.5))
    canvas.fill(canvas.disc(u, v, radius), _PLATE)
    canvas.fill(canvas.disc(u, v, radius * 0.68), shade(_PLATE, -0.12))
