"""The agent's view: the cells in front of it, turned so that it looks up, without those that walls hide."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    AGENT,
    DOOR,
    GREY_WALL,
    OPEN,
    RED,
    WALL,
    ahead,
    colour_of,
    kind_of,
    look_of,
    state_of,
)
from minihuman.worlds.grid.core.state import (
    CARRYING,
    DIRECTION,
    HEADER,
    HEIGHT,
    SEE_THROUGH,
    WIDTH,
    Row,
    X,
    Y,
    cell_at,
    hiding_looks,
)
from minihuman.worlds.kernels import device_function, inline, int64, kernel
from minihuman.worlds.options import check_whole
from minihuman.worlds.simd import simd_function

LARGEST_VIEW = 61  # a row of the view is the bits of one int64
USUAL_VIEW = 7
TOGETHER = 8  # views in which `spread_usual` spreads sight

PAIRS = (0, 2), (1, 3), (4, 6), (5, 7)  # columns of a view that are in one vector, eight cells each; there is no eighth
# lanes of one such vector, or of two side by side
_MIRRORED = [half + 6 - lane if lane < 7 else half + lane for half in (0, 8) for lane in range(8)]
_SIDES = [[first + lane for first in firsts for lane in range(8)] for firsts in ((0, 16), (8, 24))]
_MERGED = [
    [half + lane + bank for half in (0, 8) for lane in lanes for bank in (0, 16)] for lanes in (range(4), range(4, 8))
]
_IN_ORDER = [first + lane for first in (0, 16, 8, 24) for lane in range(8)]
_THREE_OF_FOUR = [half + lane for half in (0, 16) for lane in (0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 3, 7, 11, 15)]
_ALL = 0x7F7F7F7F7F7F7F

# what hides what is behind it: bit ``kind | state << 4`` of a number, for all four states that a cell has room for
HIDING = np.int64(sum(1 << (WALL | state << 4) | (state != OPEN) << (DOOR | state << 4) for state in range(4)))


def see_size(size: int) -> int:
    """Check that a view can have this number of cells on a side, and return it.

    Raises:
        WorldError: if the size is not an odd number from 3 to 61.
    """
    return check_whole("agent_view_size", size, 3, LARGEST_VIEW, odd=True)


@kernel("(int32[::1], uint8[:, :, ::1])", hold_gil=True)
def see(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (size, size, 3: kind, colour, state; indexed [right, down]) with the agent's view.

    The agent is in the middle of the bottom row, and its own cell shows what it carries. Unseen cells are 0. Sight
    spreads from the agent row by row, as Minigrid defines it: within a row first rightwards, then leftwards, and every
    seen cell that is transparent passes sight on to its neighbour in that direction and to the two cells ahead of both.
    """
    if is_usual(row, image):
        see_usual(row, image)
        show(image, USUAL_VIEW // 2, USUAL_VIEW - 1, int64(row[CARRYING]))
    else:
        see_cells(row, image, image.shape[0])


@inline
def is_usual(row: Row, image: NDArray[np.uint8]) -> bool:
    """Return whether `see_usual` can fill this image with the view of this state.

    It can if the view has seven cells on a side, coordinates fit into 15 bits, and no own kind of object hides things.
    """
    return image.shape[0] == USUAL_VIEW and max(row[WIDTH], row[HEIGHT]) < 1 << 15 and hiding_looks(row) == 0


@simd_function()
def see_usual(ops: Any, row: Row, image: NDArray[np.uint8]) -> None:
    """Fill an image as `see` does, but without the carried object. The view must be one that `is_usual` accepts."""
    columns, clear = look_ahead(ops, row)
    write_view(ops, image, columns, spread_sight(clear))


@simd_function(counts=True)
def look_usual(ops: Any, row: Row, image: NDArray[np.uint8]) -> Any:
    """Write the codes of the cells in view into an image; return the transparent cells, a byte per row of the view.

    This is the first of the three stages of `see_usual`, for batches.
    """
    columns, clear = look_ahead(ops, row)
    for number, codes in enumerate(columns):
        ops.store(image, 32 * number, ops.view(codes, "uint8"))
    return clear


@simd_function()
def spread_usual(ops: Any, boards: NDArray[np.int64], first: Any) -> None:
    """Replace the bits of the transparent cells by those of the cells that are seen, for `TOGETHER` worlds at once.

    The worlds' numbers, with a byte per row of the view, are in ``boards`` from the index ``first`` on. This is the
    second of the three stages of `see_usual`, for batches.
    """
    ops.store(boards, first, spread_sight(ops.load(boards, first, TOGETHER)))


@simd_function()
def show_usual(ops: Any, image: NDArray[np.uint8], boards: NDArray[np.int64], at: Any) -> None:
    """Replace the codes in an image by the view, given the seen cells in ``boards[at]``.

    This is the last of the three stages of `see_usual`, for batches.
    """
    columns = [ops.view(ops.load(image, 32 * number, 32), "uint16") for number in range(len(PAIRS))]
    write_view(ops, image, columns, ops.number(boards, at))


def look_ahead(ops: Any, row: Row) -> tuple[list[Any], Any]:
    """Return the codes in a view by `PAIRS` of columns, and its transparent cells as a number with a byte per row.

    ``ops`` has the vector operations. Columns of the grid are loaded, and transposed if the agent faces left or right.
    """
    x, y, direction, width, height = (ops.number(row, at) for at in (X, Y, DIRECTION, WIDTH, HEIGHT))
    # the columns run leftwards where it faces right or down
    turned = direction & 1
    onward = (direction & 2) - 1
    first_x = x - onward * (6 - turned * 3)
    first_y = y - ops.where(turned == 0, 3, (direction - 1) * 3)
    transposed = ops.fixed_16(turned, 16) == 0
    mirrored = ops.fixed_16(direction + 1 & 2, 16) == 2  # facing down or left, a column's cells are the other way round
    is_in_height = ops.these_16([*range(8)] * 2) + ops.fixed_16(first_y, 16) < ops.fixed_16(height, 16)
    x_lanes = ops.fixed_16(first_x, 16) + (ops.fixed_16(onward, 16) & ops.these_16([0] * 8 + [0xFFFF] * 8))
    start = first_x * height + first_y + HEADER
    columns = []
    pairs = []
    for number in range(USUAL_VIEW):
        is_inside = (first_x + onward * number & 0xFFFFFFFF) < width
        columns.append(ops.load_16(row, ops.where(is_inside, start, HEADER), 8))
        start = start + onward * height
    for left, right in zip(columns[::2], [*columns[1::2], columns[-1]], strict=True):
        is_inside = is_in_height & (x_lanes < ops.fixed_16(width, 16))
        codes = ops.where(is_inside, ops.shuffled(left, range(16), right), GREY_WALL)
        pairs.append(ops.where(mirrored, ops.shuffled(codes, _MIRRORED), codes))
        x_lanes = x_lanes + ops.fixed_16(onward * 2, 16)
    a, b, c, d = pairs
    straight = shuffle_twice(ops, pairs, _SIDES)
    turning = shuffle_twice(ops, (a, c, b, d), _MERGED)
    a, b, c, d = turning
    turning = shuffle_twice(ops, shuffle_twice(ops, shuffle_twice(ops, (a, c, b, d), _MERGED), _SIDES), _MERGED)
    hiding = (ops.number(row, SEE_THROUGH) & 1) - 1
    hidden = []
    for straight_row, turned_row in zip(straight, turning, strict=True):
        codes = ops.where(transposed, straight_row, turned_row)  # a row of the view
        kinds = codes & 15
        hidden.append((kinds == WALL) | ((kinds == DOOR) & ((codes & 3 << 7) > 0)))
    lower, upper = (ops.lane_bits(halves) for halves in shuffle_twice(ops, hidden, (_IN_ORDER,)))
    clear = ((lower | upper << 32) & hiding ^ _ALL) & _ALL
    return [
        ops.where(transposed, turned_row, straight_row)
        for straight_row, turned_row in zip(straight, turning, strict=True)
    ], clear


def shuffle_twice(ops: Any, vectors: Sequence[Any], lanes: Sequence[Sequence[int]]) -> list[Any]:
    """Return lanes of the first two of four vectors, one result per order in ``lanes``, then those of the last two."""
    return [ops.shuffled(vectors[at], order, vectors[at + 1]) for at in (0, 2) for order in lanes]


def spread_sight(clear: Any) -> Any:
    """Return the cells of a view that are seen, given those that are transparent, both with a byte for each row.

    A run of transparent cells is seen as soon as one of them is, together with the cells next to it and ahead of it.
    """
    pairs = clear >> 1 & clear  # and the cell to the left is clear, too
    fours = pairs >> 2 & pairs
    ahead = (clear & 0) + 8
    visible = clear & 0
    for number in reversed(range(USUAL_VIEW)):
        lets, two, four = (cells >> 8 * number & 127 for cells in (clear, pairs, fours))
        giving = ahead & lets  # from here on as in `spread`, with strides of one, two and four cells
        giving = (giving + lets ^ lets | giving) & lets
        giving = giving >> 1 & lets | giving
        giving = giving >> 2 & two | giving
        giving = giving >> 4 & four | giving
        sideways = (giving << 1 | giving >> 1 | giving) & 127
        visible = (ahead | sideways) << 8 * number | visible
        ahead = sideways
    return visible


def write_view(ops: Any, image: NDArray[np.uint8], columns: Sequence[Any], visible: Any) -> None:
    """Write the seen cells of a view into an image.

    Args:
        ops: the vector operations of the machine.
        image: receives kind, colour and state of each cell; 0 for cells that are not seen.
        columns: the codes of the cells by pairs of columns, as `look_ahead` returns them.
        visible: the cells that are seen, as `spread_sight` returns them.

    Each store writes a few bytes too many, which the store of the next column overwrites.
    """
    seen_lanes = ops.spread_bytes(visible)
    stores = {}
    for (left, right), codes in zip(PAIRS, columns, strict=True):
        bits = ops.these_16([1 << left] * 8 + [1 << right] * 8)
        visible_codes = ops.where((seen_lanes & bits) == bits, codes, 0)
        looks = visible_codes & 15 | (visible_codes & 112) << 4
        states = visible_codes >> 7 & 3
        for half, lanes in enumerate(_MERGED):
            cells = ops.view(ops.shuffled(looks, lanes, states), "uint8")  # kind, colour, state, 0
            cells = ops.shuffled(cells, _THREE_OF_FOUR)
            stores[left, half], stores[right, half] = (ops.shuffled(cells, range(at, at + 16)) for at in (0, 16))
    for column in range(USUAL_VIEW):
        ops.store(image, 21 * column, stores[column, 0])
        ops.store(image, 21 * column + 12, ops.shuffled(stores[column, 1], range(16 if column < 6 else 9)))


@simd_function()
def fetch_usual(ops: Any, row: Row) -> None:
    """Prefetch the cells that `see_usual` loads; near a border, this includes cells outside the grid."""
    x = ops.number(row, X)
    y = ops.number(row, Y)
    direction = ops.number(row, DIRECTION)
    height = ops.number(row, HEIGHT)
    onward = (direction & 2) - 1
    turned = direction & 1
    middle = ops.where(turned == 1, y - (direction - 2) * 3, y) + HEADER
    first = (x - onward * (6 - turned * 3)) * height + middle
    for number in range(USUAL_VIEW):
        ops.prefetch(row, onward * height * number + first)


@simd_function()
def fetch_header(ops: Any, row: Row) -> None:
    """Prefetch the header of a row, which has the agent's pose."""
    ops.prefetch(row, 0)


@device_function(force_inline=True)
def see_cells(row: Row, image: NDArray[np.uint8], size: int) -> None:
    """Fill an image as `see` does, for a view of ``size`` cells.

    There are no branches on the cells' contents, because no CPU could predict them.
    """
    half = size // 2
    right, down = ahead(0, 0, row[DIRECTION])
    # the first cell of the agent's row
    x = row[X] + half * down
    y = row[Y] - half * right
    if row[SEE_THROUGH] & 1:
        showing = int64(-1)
    else:
        showing = int64(~(HIDING | hiding_looks(row)))
    reached = 1 << half  # bit i: cell i of the row is seen from the one before
    for distance in range(size):
        if reached == 0:
            image[:, : size - distance] = 0
            break
        clear = 0
        for i in range(size):
            clear |= (showing >> look_of(cell_at(row, x - i * down, y + i * right)) & 1) << i
        giving = spread(reached, clear, size)
        sideways = (giving << 1 | giving >> 1 | giving) & (1 << size) - 1
        visible = reached | sideways
        for i in range(size):
            show(image, i, size - 1 - distance, cell_at(row, x - i * down, y + i * right) & -(visible >> i & 1))
        reached = sideways
        x = x + right
        y = y + down
    show(image, half, size - 1, int64(row[CARRYING]))


@device_function(force_inline=True)
def show(image: NDArray[np.uint8], i: int, j: int, code: int) -> None:
    """Write the kind, colour and state in a code into the cell (i, j) of an image."""
    image[i, j, 0] = kind_of(code)
    image[i, j, 1] = colour_of(code)
    image[i, j, 2] = state_of(code)


@inline
def spread(reached: int, clear: int, size: int) -> int:
    """Return the transparent cells of a row of the view that belong to a run in which a cell is reached by sight.

    The result has one bit per cell.

    Args:
        reached: the cells that sight reaches from the row before, one bit per cell.
        clear: the transparent cells, one bit per cell.
        size: the number of cells in the row.
    """
    giving = reached & clear
    giving = (giving + clear ^ clear | giving) & clear  # the sum's carry runs through the clear cells after each
    run = clear  # bit i: the cells from i to where a stride of this length starts are all clear
    stride = 1
    while stride < size:
        giving |= giving >> stride & run
        run &= run >> stride
        stride *= 2
    return giving


@kernel("(int32[::1], uint8[:, :, ::1])")
def see_all(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (width, height, 3: kind, colour, state; indexed [x, y]) with the whole grid and the agent."""
    for x in range(row[WIDTH]):
        for y in range(row[HEIGHT]):
            show(image, x, y, row[HEADER + x * row[HEIGHT] + y])
    image[row[X], row[Y], 0] = AGENT
    image[row[X], row[Y], 1] = RED
    image[row[X], row[Y], 2] = row[DIRECTION]
