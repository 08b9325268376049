"""Pictures of a grid with several bodies: each an arrowhead in its colour, with what it carries in a corner."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette, View
from minihuman.worlds.grid.core.bodies import BODY_COLOURS, body_index, count_bodies, see_body
from minihuman.worlds.grid.core.cells import AGENT, EMPTY, ahead
from minihuman.worlds.grid.core.state import CARRYING, HEIGHT, WIDTH, Row, X, row_length
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.object_kinds import ObjectKind
from minihuman.worlds.grid.pictures.drawing import LOOKS, Pixels, atlas, draw_cells
from minihuman.worlds.grid.pictures.tiles import OBJECT_COLOURS, agent


class Figure(NamedTuple):
    """Something with transparency, prepared for `lay`: whole arrays are blended ten times as fast as broadcast ones."""

    paint: NDArray[np.uint16]  # [px, px, 3]: colours times opacity, and what rounds
    through: NDArray[np.uint16]  # [px, px, 3]: what is seen of what is under it, 0 to 255


def prepare_figure(pixels: Pixels) -> Figure:
    """Prepare a figure, uint8[px, px, 4] with opacity last."""
    opacity = np.repeat(pixels[..., 3:], 3, axis=2).astype(np.uint16)
    return Figure(pixels[..., :3] * opacity + np.uint16(127), 255 - opacity)


@lru_cache(maxsize=256)
def draw_body(body: int, direction: int, tile_px: int, palette: Palette) -> Figure:
    """A body's arrowhead."""
    canvas = agent(direction, tile_px, palette, OBJECT_COLOURS[palette][BODY_COLOURS[body]])
    return prepare_figure(np.dstack([canvas.rgb, 255 * canvas.alpha]).round().astype(np.uint8))


def lay(figure: Figure, left: int, top: int, out: Pixels) -> None:
    """Blend a figure into a picture: the rounded mean of its colours and those under it, by its opacity."""
    under = out[top : top + figure.paint.shape[0], left : left + figure.paint.shape[1]]
    mixed = under * figure.through  # nothing here is over 65,152
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
    """A picture of what a body sees, looking up ("partial"), or of everything, what it sees lighter ("full")."""
    drawn = atlas(tile_px, palette, kinds)
    bodies = [row[body_index(row, each) :][:4].tolist() for each in range(count_bodies(row))]
    alone = row[: row_length(int(row[WIDTH]), int(row[HEIGHT]))].copy()
    alone[X : X + 4] = bodies[body]
    x, y, facing, _ = bodies[body]
    image = np.zeros((view_size, view_size, 3), np.uint8)
    seen = image.copy()
    see(alone, image)
    see_body(row, body, seen)
    alone[CARRYING] = EMPTY  # drawn below
    columns, rows = (view_size, view_size) if view == "partial" else (int(row[WIDTH]), int(row[HEIGHT]))
    out = np.empty((rows * tile_px, columns * tile_px, 3), np.uint8)
    lines, lit = out.reshape(rows * tile_px, -1), np.zeros((columns, rows), np.int64)
    tables = drawn.number, drawn.under, drawn.tiles.view(np.uint8), np.zeros_like(drawn.agents), drawn.carried
    draw_cells(alone, image, view == "full", False, lit, *tables, lines, lines)
    forward_x, forward_y = ahead(0, 0, facing)
    for each, (column, line, direction, carrying) in enumerate(bodies):
        if view == "partial":
            far = (column - x) * forward_x + (line - y) * forward_y
            aside = (line - y) * forward_x - (column - x) * forward_y
            column, line = view_size // 2 + aside, view_size - 1 - far
            inside = 0 <= column < view_size and 0 <= line < view_size
            if each != body and not (inside and seen[column, line, 0] == AGENT):
                continue
            direction = (direction - facing + 3) % 4
        lay(draw_body(each, direction, tile_px, palette), column * tile_px, line * tile_px, out)
        if carrying != EMPTY:
            small = drawn.carried[drawn.number[carrying & LOOKS - 1]]
            inset = tile_px - small.shape[0]
            lay(prepare_figure(small), column * tile_px + inset, line * tile_px + inset, out)
    return out
