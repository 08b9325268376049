"""Pictures of a whole grid or of the agent's view, drawn from an atlas of tiles in one compiled pass."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.contract import View
from minihuman.worlds.grid.core.cells import (
    BALL,
    BOX,
    DOOR,
    DOOR_STATES,
    EMPTY,
    FLOOR,
    GOAL,
    KEY,
    RED_LAVA,
    WALL,
    ahead,
    pack,
)
from minihuman.worlds.grid.core.state import CARRYING, DIRECTION, FIRST_OWN_KIND, HEADER, HEIGHT, WIDTH, Row, X, Y
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.pictures.minigrid_tiles import minigrid_tile
from minihuman.worlds.grid.pictures.tiles import GridPalette, agent, draw_carried, draw_cell_tile, draw_unseen_tile
from minihuman.worlds.kernels import device_function, inline, kernel

if TYPE_CHECKING:
    from minihuman.worlds.grid.object_kinds import ObjectKind

LOOKS = 512  # kind, colour and state make nine bits
LIT = 0.13  # how much lighter a cell is drawn that the agent sees, from 0 to 1 for white
RUN = 16  # words of a tile's line that are copied at once
CARRIED = 0.56  # the size of a carried object's picture, in tiles
Pixels = NDArray[np.uint8]
Words = NDArray[np.uint64] | Pixels  # eight bytes of pixels each if a tile's line has a multiple of eight, else bytes


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """All tiles at one size in one palette. ``number[look]`` is the index of a tile in the arrays; 0 is "unseen"."""

    number: NDArray[np.int64]  # (512,)
    under: NDArray[np.int64]  # (4, 512): by direction and look: Minigrid's tile of a cell with the agent in it
    tiles: Words  # (2, tiles, px, words): as they are, and lit
    agents: Pixels  # (4, px, px, 4): by direction, with colour and opacity
    carried: Pixels  # (tiles, small px, small px, 4): objects as they are carried, with colour and opacity


@lru_cache(maxsize=16)
def atlas(tile_px: int, palette: GridPalette, kinds: "tuple[ObjectKind, ...]" = ()) -> Atlas:
    """Return the atlas of all tiles at one size in one palette, with the world's own ``kinds``; it is cached."""
    looks = [EMPTY, RED_LAVA]
    for colour in range(len(COLOURS)):
        looks += [pack(kind, colour, 0, 0) for kind in (WALL, FLOOR, KEY, BALL, BOX, GOAL)]
        looks += [pack(DOOR, colour, state, 0) for state in range(len(DOOR_STATES))]
        for own, kind in enumerate(kinds, FIRST_OWN_KIND):
            looks += [pack(own, colour, state, 0) for state in range(len(DOOR_STATES) if kind.opens else 1)]
    number = np.zeros(LOOKS, np.int64)
    number[looks] = np.arange(1, len(looks) + 1)
    if palette == "minigrid":
        return _minigrid_atlas(tile_px, looks, number, kinds)
    canvases = [draw_unseen_tile(tile_px), *(draw_cell_tile(look, tile_px, palette, kinds) for look in looks)]
    plain = np.stack([canvas.rgb for canvas in canvases])
    lit = plain + (255 - plain) * LIT
    small = max(1, round(tile_px * CARRIED))
    carried = np.zeros((len(looks) + 1, small, small, 4), np.uint8)
    for look in looks:
        canvas = draw_carried(look, small, palette, kinds)
        carried[number[look]] = np.dstack([canvas.rgb, 255 * canvas.alpha]).round()
    tiles = np.stack([plain, lit]).round().astype(np.uint8).reshape(2, -1, tile_px, 3 * tile_px)
    agents = [agent(direction, tile_px, palette) for direction in range(4)]
    return Atlas(
        number,
        np.zeros((len(agents), LOOKS), np.int64),
        _view_as_words(tiles),
        np.stack([np.dstack([canvas.rgb, 255 * canvas.alpha]) for canvas in agents]).round().astype(np.uint8),
        carried,
    )


def _minigrid_atlas(
    tile_px: int, looks: list[int], number: NDArray[np.int64], kinds: "tuple[ObjectKind, ...]"
) -> Atlas:
    """Return the atlas of Minigrid's tiles, in which the agent is part of its tile, and an unseen cell looks empty.

    The parameters are those of `atlas`; ``looks`` are all looks that have a tile, and ``number`` has their tiles.
    """
    under = np.zeros((4, LOOKS), np.int64)
    combinations: list[tuple[int, int | None]] = [(EMPTY, None), *((look, None) for look in looks)]
    for direction in range(4):
        under[direction, looks] = len(combinations) + np.arange(len(looks))
        combinations += [(look, direction) for look in looks]
    tiles = np.stack(
        [
            [minigrid_tile(look, tile_px, facing=facing, lit=lit, kinds=kinds) for look, facing in combinations]
            for lit in (False, True)
        ]
    )
    transparent = np.zeros((len(looks) + 1, 1, 1, 4), np.uint8)  # in place of separate figures
    words = _view_as_words(tiles.reshape(2, -1, tile_px, 3 * tile_px))
    return Atlas(number, under, words, agents=transparent[:4], carried=transparent)


def _view_as_words(tiles: Pixels) -> Words:
    """Return lines of pixels as words of eight bytes, or as bytes if their length is not a multiple of eight."""
    if tiles.shape[2] % 8 == 0:
        return tiles.view(np.uint64)
    return tiles


def draw_grid(
    row: Row,
    *,
    view: View,
    view_size: int,
    tile_px: int,
    palette: GridPalette,
    kinds: "tuple[ObjectKind, ...]" = (),
    lit: bool = True,
) -> Pixels:
    """Return a picture of the whole grid or of the agent's view, uint8[rows * tile_px, columns * tile_px, 3].

    Args:
        row: the state.
        view: "partial" for what the agent sees, looking up; "full" for the whole grid.
        view_size: the number of cells on a side of the agent's view.
        tile_px: the number of pixels on a side of a tile.
        palette: the colours.
        kinds: the world's own kinds.
        lit: whether the full view lightens the cells that the agent sees.
    """
    tile_atlas = atlas(tile_px, palette, kinds)
    columns, rows = (view_size, view_size) if view == "partial" else (row[WIDTH], row[HEIGHT])
    out = np.empty((rows * tile_px, columns * tile_px, 3), np.uint8)
    lines = out.reshape(rows * tile_px, -1)
    image = np.zeros((view_size, view_size, 3), np.uint8)
    if lit or view == "partial":
        see(row, image)
    words = lines.view(tile_atlas.tiles.dtype)
    shows_all = view == "full"
    is_minigrid = palette == "minigrid"
    is_lit = np.zeros((columns, rows), np.int64)
    tables = tile_atlas.number, tile_atlas.under, tile_atlas.tiles, tile_atlas.agents, tile_atlas.carried
    draw_cells(row, image, shows_all, is_minigrid, is_lit, *tables, words, lines)
    return out


@device_function("void(uint8[:, :, :, ::1], int64, int64, int64, uint8[:, ::1])")
def lay_over(figures: Pixels, figure: int, left: int, top: int, out: Pixels) -> None:
    """Blend a partly transparent figure, ``figures[figure]``, into the picture ``out`` at a pixel column and row."""
    for v in range(figures.shape[1]):
        for u in range(figures.shape[2]):
            alpha = np.int64(figures[figure, v, u, 3])
            if alpha > 0:
                for part in range(3):
                    byte = 3 * (left + u) + part
                    under = np.int64(out[top + v, byte])
                    over = np.int64(figures[figure, v, u, part])
                    out[top + v, byte] = (over * alpha + under * (255 - alpha) + 127) // 255


@kernel(
    "(int32[::1], uint8[:, :, ::1], boolean, boolean, int64[:, ::1], int64[::1], int64[:, ::1], uint8[:, :, :, "
    "::1], uint8[:, :, :, ::1], uint8[:, :, :, ::1], uint8[:, ::1], uint8[:, ::1])",
    "(int32[::1], uint8[:, :, ::1], boolean, boolean, int64[:, ::1], int64[::1], int64[:, ::1], uint64[:, :, "
    ":, ::1], uint8[:, :, :, ::1], uint8[:, :, :, ::1], uint64[:, ::1], uint8[:, ::1])",
)
def draw_cells(
    row: Row,
    image: NDArray[np.uint8],
    full: bool,
    in_view: bool,
    lit: NDArray[np.int64],
    number: NDArray[np.int64],
    under: NDArray[np.int64],
    tiles: Words,
    agents: Pixels,
    carried: Pixels,
    words: Words,
    out: Pixels,
) -> None:
    """Draw the whole grid, with the cells that the agent sees (``image``) lit; or, if ``full`` is false, only its view.

    With ``in_view``, the view is drawn as in Minigrid: seen cells are lit, and the agent's cell shows what it carries.
    ``lit`` (columns, lines) is overwritten with 1 where a cell is lit. ``words`` and ``out`` (lines, bytes) are the
    same memory.
    """
    view_size = image.shape[0]
    px = tiles.shape[2]
    middle = view_size // 2
    bottom = view_size - 1
    width = row[WIDTH]
    height = row[HEIGHT]
    x = row[X]
    y = row[Y]
    direction = row[DIRECTION]
    columns, lines = (width, height) if full else (view_size, view_size)
    lit[:] = 0
    if full:
        forward_x, forward_y = ahead(0, 0, direction)
        for i in range(view_size):
            for j in range(view_size):
                far = bottom - j
                aside = i - middle
                column = x + forward_x * far - forward_y * aside
                line = y + forward_y * far + forward_x * aside
                if image[i, j, 0] != 0 and 0 <= column < width and 0 <= line < height:
                    lit[column, line] = 1
    elif in_view:
        for i in range(view_size):
            for j in range(view_size):
                lit[i, j] = image[i, j, 0] != 0
    for column in range(columns):
        for line in range(lines):
            if full:
                look = np.int64(row[HEADER + column * height + line])
            elif column == middle and line == bottom:
                look = np.int64(row[HEADER + x * height + y])
            else:
                kind = np.int64(image[column, line, 0])
                colour = np.int64(image[column, line, 1])
                look = kind | colour << 4 | np.int64(image[column, line, 2]) << 7
            lay_tile(tiles, lit[column, line], number[look & LOOKS - 1], column, line, words)
    look = np.int64(row[HEADER + x * height + y])
    if not full:
        x = middle
        y = bottom
        direction = 3  # the view is turned so that the agent looks up
        look = np.int64(row[CARRYING])
    if in_view:  # there the agent is part of its tile
        lay_tile(tiles, lit[x, y], under[direction, look & LOOKS - 1], x, y, words)
    put_agent(row, agents, direction, carried, number, x * px, y * px, out)


@device_function(force_inline=True)
def lay_tile(tiles: Words, lit: int, tile: int, column: int, row: int, words: Words) -> None:
    """Copy ``tiles[lit, tile]`` into a picture, at a column and row of cells; ``lit`` is 1 for the lit tile, else 0."""
    height = tiles.shape[2]
    width = tiles.shape[3]
    left = column * width
    if width < RUN:
        for v in range(height):
            for word in range(width):
                words[row * height + v, left + word] = tiles[lit, tile, v, word]
        return
    run_end = width - width % RUN
    for v in range(height):
        line = row * height + v
        for run in range(0, run_end, RUN):
            for word in range(RUN):  # the compiler turns a loop of known length into one or two vector moves
                words[line, left + run + word] = tiles[lit, tile, v, run + word]
        for word in range(run_end, width):
            words[line, left + word] = tiles[lit, tile, v, word]


@inline
def put_agent(
    row: Row,
    agents: Pixels,
    direction: int,
    carried: Pixels,
    number: NDArray[np.int64],
    left: int,
    top: int,
    out: Pixels,
) -> None:
    """Draw the agent over its tile, and a small picture of what it carries in the tile's lower right corner.

    ``left`` and ``top`` are the tile's pixel column and row in ``out``; the arrays are those of an `Atlas`.
    """
    lay_over(agents, direction, left, top, out)
    if row[CARRYING] != EMPTY:
        inset = agents.shape[1] - carried.shape[1]
        lay_over(carried, number[row[CARRYING] & (LOOKS - 1)], left + inset, top + inset, out)
