"""Pictures of worlds of rules: the grid from above or what the agent sees, with its goal and rules as rows of tiles.

The tiles are in the style of `minihuman.worlds.grid.pictures.tiles`. XLand-MiniGrid's palette has more kinds and
colours than the other grids, so this module has its own.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette, View
from minihuman.worlds.grid.pictures.tiles import (
    FLOOR_COLOUR,
    GRID_LINE,
    RGB,
    UNSEEN,
    WALL_COLOUR,
    Canvas,
    agent,
    shade,
)
from minihuman.worlds.grid.ruleset import dynamics as numbers
from minihuman.worlds.grid.ruleset.dynamics import Row, see_tiles

Pixels = NDArray[np.uint8]

# by colour number: none, red, green, blue, purple, yellow, grey, black, orange, white, brown, pink
COLOURS: dict[str, tuple[RGB, ...]] = {
    "classic": (
        *((10, 10, 13), (235, 64, 52), (60, 200, 80), (66, 121, 245), (160, 88, 224), (247, 214, 64)),
        *((158, 163, 172), (36, 39, 46), (255, 140, 30), (250, 250, 250), (142, 92, 52), (255, 155, 200)),
    ),
    "colour-safe": (
        *((10, 10, 13), (208, 60, 12), (0, 130, 90), (32, 80, 255), (172, 120, 230), (255, 245, 130)),
        *((150, 150, 150), (36, 39, 46), (240, 150, 20), (255, 255, 255), (110, 70, 40), (255, 170, 220)),
    ),
}
CARRIED = 0.56  # the size of a carried object's picture, in tiles
_HIGHLIGHT = 0.13  # the share by which seen cells are lightened towards white


def hex_colour(tile: int, palette: Palette) -> str:
    """Return the colour in which a tile is drawn, as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*COLOURS[palette][tile >> 4])


def _list_corners(corners: int, radius: float, *, inner: float = 0.0, v: float = 0.5) -> list[tuple[float, float]]:
    """Return the corners (x, y) of a regular polygon that points up, or of a star if it has an inner radius.

    All lengths are in tiles, and the centre is at (0.5, v).
    """
    points = []
    count = 2 * corners if inner else corners
    for number in range(count):
        distance = inner if inner and number % 2 else radius
        angle_rad = 2 * math.pi * number / count - math.pi / 2
        points.append((0.5 + distance * math.cos(angle_rad), v + distance * math.sin(angle_rad)))
    return points


def _draw_ball(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.disc(0.5, 0.5, 0.32), shade(colour, -0.35))
    canvas.fill(canvas.disc(0.49, 0.485, 0.285), colour)
    canvas.fill(canvas.disc(0.40, 0.38, 0.075), shade(colour, 0.6))


def _draw_square(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.box(0.20, 0.20, 0.80, 0.80, 0.05), shade(colour, -0.35))
    canvas.fill(canvas.box(0.235, 0.235, 0.765, 0.765, 0.03), colour)


def _draw_pyramid(canvas: Canvas, colour: RGB) -> None:
    corners = ((0.5, 0.20), (0.80, 0.78), (0.20, 0.78))
    canvas.fill(canvas.polygon(*corners, rounding=0.04), shade(colour, -0.35))
    canvas.fill(canvas.polygon(*corners), colour)
    canvas.fill(canvas.polygon((0.5, 0.20), (0.80, 0.78), (0.5, 0.78)), shade(colour, -0.2))


def _draw_mat(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.box(0.04, 0.04, 0.96, 0.96, 0.08), shade(colour, -0.45))
    canvas.fill(canvas.box(0.12, 0.12, 0.88, 0.88, 0.06), shade(colour, -0.1))
    for v in (0.30, 0.50, 0.70):
        canvas.fill(canvas.bar(0.2, v, 0.8, v, 0.03), shade(colour, -0.45))


def _draw_hexagon(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.polygon(*_list_corners(6, 0.31), rounding=0.04), shade(colour, -0.35))
    canvas.fill(canvas.polygon(*_list_corners(6, 0.31)), colour)
    canvas.fill(canvas.polygon(*_list_corners(6, 0.15)), shade(colour, -0.25))


def _draw_star(canvas: Canvas, colour: RGB) -> None:
    corners = _list_corners(5, 0.34, inner=0.15, v=0.53)
    canvas.fill(canvas.polygon(*corners, rounding=0.045), shade(colour, -0.35))
    canvas.fill(canvas.polygon(*corners, rounding=0.01), colour)


def _draw_key(canvas: Canvas, colour: RGB) -> None:
    for grow, lightness in ((0.035, -0.6), (0.0, 0.0)):
        tint = shade(colour, lightness)
        canvas.fill(abs(canvas.disc(0.5, 0.29, 0.145)) - 0.055 - grow, tint)
        canvas.fill(canvas.bar(0.5, 0.44, 0.5, 0.82, 0.05 + grow), tint)
        canvas.fill(canvas.bar(0.5, 0.66, 0.655, 0.66, 0.042 + grow), tint)
        canvas.fill(canvas.bar(0.5, 0.80, 0.655, 0.80, 0.042 + grow), tint)


def _draw_floor(canvas: Canvas, colour: RGB) -> None:
    line = max(0.5 / canvas.size_px, 0.012)
    canvas.fill(canvas.box(line, line, 1 - line, 1 - line), shade(colour, -0.55))


def _draw_closed_door(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.everywhere(), shade(colour, -0.62))
    canvas.fill(canvas.box(0.09, 0.09, 0.91, 0.91, 0.04), colour)
    canvas.fill(canvas.box(0.18, 0.18, 0.82, 0.46, 0.03), shade(colour, -0.28))
    canvas.fill(canvas.box(0.18, 0.54, 0.82, 0.82, 0.03), shade(colour, -0.28))
    canvas.fill(canvas.disc(0.79, 0.50, 0.065), shade(colour, 0.7))


def _draw_locked_door(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.everywhere(), shade(colour, -0.62))
    canvas.fill(canvas.box(0.09, 0.09, 0.91, 0.91, 0.04), colour)
    canvas.fill(canvas.box(0.17, 0.17, 0.83, 0.83, 0.03), shade(colour, -0.45))
    canvas.fill(canvas.disc(0.5, 0.42, 0.11), shade(colour, 0.55))
    canvas.fill(canvas.polygon((0.46, 0.44), (0.54, 0.44), (0.59, 0.70), (0.41, 0.70)), shade(colour, 0.55))


def _draw_open_door(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.box(0.0, 0.0, 1.0, 0.10), shade(colour, -0.62))
    canvas.fill(canvas.box(0.0, 0.90, 1.0, 1.0), shade(colour, -0.62))
    canvas.fill(canvas.box(0.04, 0.04, 0.20, 0.96, 0.02), colour)


_DRAWINGS: dict[int, Callable[[Canvas, RGB], None]] = {
    numbers.BALL: _draw_ball,
    numbers.SQUARE: _draw_square,
    numbers.PYRAMID: _draw_pyramid,
    numbers.GOAL_TILE: _draw_mat,
    numbers.KEY: _draw_key,
    numbers.DOOR_LOCKED: _draw_locked_door,
    numbers.DOOR_CLOSED: _draw_closed_door,
    numbers.DOOR_OPEN: _draw_open_door,
    numbers.HEX: _draw_hexagon,
    numbers.STAR: _draw_star,
}


def _draw_object(canvas: Canvas, tile: int, palette: Palette) -> None:
    """Draw the thing or door of a tile; nothing for a wall or floor."""
    drawing = _DRAWINGS.get(tile & 15)
    if drawing is not None:
        drawing(canvas, COLOURS[palette][tile >> 4])


@lru_cache(maxsize=4096)
def draw_tile(tile: int, tile_px: int, palette: Palette) -> Pixels:
    """Return the picture of a tile, uint8[tile_px, tile_px, 3]."""
    canvas = Canvas(tile_px)
    kind = tile & 15
    if kind == numbers.WALL:
        edge = max(1 / tile_px, 0.05)
        canvas.fill(canvas.everywhere(), shade(WALL_COLOUR, -0.38))
        canvas.fill(canvas.box(-1, -1, 1 - edge, 1 - edge), shade(WALL_COLOUR, 0.18))
        canvas.fill(canvas.box(edge, edge, 1 - edge, 1 - edge), WALL_COLOUR)
    elif kind == numbers.EMPTY:
        canvas.fill(canvas.everywhere(), UNSEEN)
    else:
        canvas.fill(canvas.everywhere(), GRID_LINE)
        line = max(0.5 / tile_px, 0.012)
        canvas.fill(canvas.box(line, line, 1 - line, 1 - line), FLOOR_COLOUR)
        if kind == numbers.FLOOR and tile >> 4 != numbers.BLACK:
            _draw_floor(canvas, COLOURS[palette][tile >> 4])
        _draw_object(canvas, tile, palette)
    return canvas.rgb.round().astype(np.uint8)


@lru_cache(maxsize=64)
def _draw_agent(direction: int, tile_px: int, palette: Palette) -> Pixels:
    """Return the picture of the agent, uint8[tile_px, tile_px, 4]; the last channel is the opacity."""
    # `agent` counts directions clockwise from the right, a world of rules from the top
    canvas = agent((direction + 3) % 4, tile_px, palette)
    return np.dstack([canvas.rgb, 255 * canvas.alpha]).round().astype(np.uint8)


@lru_cache(maxsize=1024)
def _draw_in_hand(tile: int, size_px: int, palette: Palette) -> Pixels:
    """Return the picture of a carried tile on a dark disc, uint8[size_px, size_px, 4]; the last channel is opacity."""
    canvas = Canvas(size_px)
    canvas.fill(canvas.disc(0.5, 0.5, 0.5), UNSEEN, opacity=0.85)
    if tile & 15 == numbers.FLOOR:
        canvas.fill(canvas.box(0.25, 0.25, 0.75, 0.75, 0.05), GRID_LINE)
    _draw_object(canvas, tile, palette)
    return np.dstack([canvas.rgb, 255 * canvas.alpha]).round().astype(np.uint8)


def _blend(figure: Pixels, out: Pixels) -> None:
    """Lay a partly transparent figure, uint8[h, w, 4], over ``out``, a part of a picture, uint8[h, w, 3]."""
    opacity = figure[..., 3:].astype(np.float64) / 255
    out[:] = (out * (1 - opacity) + figure[..., :3] * opacity).round()


def draw_ruleset(row: Row, *, view: View, view_size: int, tile_px: int, palette: Palette, lit: bool = True) -> Pixels:
    """Return a picture of the whole grid ("full"), or of what the agent sees, looking up ("partial"), uint8[H, W, 3].

    What the agent carries is drawn small in its corner.

    Args:
        row: the state.
        view: what is drawn.
        view_size: the number of cells on a side of the agent's view.
        tile_px: the number of pixels on a side of a cell.
        palette: the name of the palette.
        lit: whether the picture of the whole grid is lighter where the agent sees.
    """
    if view == "partial":
        image = np.zeros((view_size, view_size, 2), np.uint8)
        see_tiles(row, image)
        tiles = image[..., 0].astype(np.int64) | image[..., 1].astype(np.int64) << 4
        agent_cell = view_size - 1, view_size // 2
        direction = numbers.UP
    else:
        height, width = row[: numbers.WIDTH + 1].tolist()
        tiles = row[-height * width :].reshape(height, width)
        agent_cell = int(row[numbers.Y]), int(row[numbers.X])
        direction = int(row[numbers.DIRECTION])
    out = np.empty((tiles.shape[0] * tile_px, tiles.shape[1] * tile_px, 3), np.uint8)
    for (y, x), tile in np.ndenumerate(tiles):
        out[y * tile_px : (y + 1) * tile_px, x * tile_px : (x + 1) * tile_px] = draw_tile(int(tile), tile_px, palette)
    if view == "full" and lit:
        _lighten(row, out, view_size, tile_px)
    top_px, left_px = (index * tile_px for index in agent_cell)
    _blend(_draw_agent(direction, tile_px, palette), out[top_px : top_px + tile_px, left_px : left_px + tile_px])
    if row[numbers.POCKET]:
        size_px = max(1, round(tile_px * CARRIED))
        inset_px = tile_px - size_px
        corner = out[top_px + inset_px : top_px + tile_px, left_px + inset_px : left_px + tile_px]
        _blend(_draw_in_hand(int(row[numbers.POCKET]), size_px, palette), corner)
    return out


def _lighten(row: Row, out: Pixels, view_size: int, tile_px: int) -> None:
    """Lighten the part of ``out``, a picture of the whole grid, that the agent sees."""
    height, width = row[: numbers.WIDTH + 1].tolist()
    y, x, direction = row[numbers.Y : numbers.DIRECTION + 1].tolist()
    n_seen = [view_size // 2] * 4  # cells up, right, down and left of the agent
    n_seen[direction] = view_size - 1
    n_seen[(direction + 2) % 4] = 0
    n_up, n_right, n_down, n_left = n_seen
    rows = slice(max(0, y - n_up) * tile_px, min(height, y + n_down + 1) * tile_px)
    columns = slice(max(0, x - n_left) * tile_px, min(width, x + n_right + 1) * tile_px)
    part = out[rows, columns].astype(np.float64)
    out[rows, columns] = (part + (255 - part) * _HIGHLIGHT).round()
