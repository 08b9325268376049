"""What the agent sees: the cells in front of it, turned so that it looks up, without those that walls hide."""

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
    hiding_looks,
)
from minihuman.worlds.kernels import device_function, inline, int64, kernel
from minihuman.worlds.options import check_whole
from minihuman.worlds.simd import simd_function

LARGEST_VIEW = 61  # a row of the view is the bits of one int64
USUAL_VIEW = 7

# what hides what is behind it: bit ``kind | state << 4`` of a number, for all four states that a cell has room for
HIDING = np.int64(sum(1 << (WALL | state << 4) | (state != OPEN) << (DOOR | state << 4) for state in range(4)))


def see_size(size: int) -> int:
    """The size, if a view can have it.

    Raises:
        WorldError: if it cannot.
    """
    return check_whole("agent_view_size", size, 3, LARGEST_VIEW, odd=True)


@kernel("(int32[::1], uint8[:, :, ::1])", hold_gil=True)
def see(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (size, size, 3: kind, colour, state; indexed [right, down]) with the agent's view.

    The agent is at the bottom's middle; its own cell shows what it carries. Unseen cells are 0. Sight spreads from
    the agent row by row, as Minigrid defines it: within a row first rightwards, then leftwards, and every seen cell
    that lets see passes it on to its neighbour in that direction and to the two cells ahead of both.
    """
    see_inline(row, image)


@device_function(force_inline=True)
def see_inline(row: Row, image: NDArray[np.uint8]) -> None:
    """`see`, for kernels that look at many rows."""
    if image.shape[0] == USUAL_VIEW:
        see_usual(row, image, int64(-1) if row[SEE_THROUGH] & 1 else ~(HIDING | hiding_looks(row)))
        show(image, USUAL_VIEW // 2, USUAL_VIEW - 1, int64(row[CARRYING]))
    else:
        see_cells(row, image, image.shape[0])


@simd_function()
def see_usual(ops: Any, row: Row, image: NDArray[np.uint8], showing: Any) -> None:
    """What `see` says, for a view of seven cells, without what is carried: a vector for each column of the grid.

    The 49 cells are loaded column by column in the order in which the view has them; facing left or right they lie
    transposed. What lets see is a number with a byte for each row of the view, in which sight spreads row by row.

    Args:
        showing: bit ``kind | state << 4``: whether such a cell shows what is behind it.
    """
    columns = range(USUAL_VIEW)
    x, y, direction = ops.number(row, X), ops.number(row, Y), ops.number(row, DIRECTION)
    width, height = ops.number(row, WIDTH), ops.number(row, HEIGHT)
    transposed = (direction & 1) == 0
    mirrored = ((direction + 1) & 2) == 2  # facing down or left, a column's cells are in the opposite order
    onward = (direction & 2) - 1  # the columns run leftwards where it faces right or down
    first_x = x - onward * (6 - (direction & 1) * 3)
    first_y = y - ops.where(transposed, 3, (direction - 1) * 3)
    y_lanes = ops.indices(8) + ops.fixed(first_y & 0xFFFFFFFF, 8)
    low, high = (ops.fixed(half & 0xFFFFFFFF, 8) for half in (showing, showing >> 32))
    cells, across, along = [], 0, 0
    for number in columns:
        column = (first_x + onward * number) & 0xFFFFFFFF
        is_inside = column < width
        start = ops.where(is_inside, column * height + first_y + HEADER, 0)
        codes = ops.load(row, start, 8)
        codes = ops.where(y_lanes < ops.fixed(ops.where(is_inside, height, 0), 8), codes, GREY_WALL)
        codes = ops.where(mirrored, ops.shuffled(codes, (6, 5, 4, 3, 2, 1, 0, 7)), codes)
        bits = ops.where((codes & 256) == 0, low, high) >> (codes & 15 | codes >> 3 & 16) & 1
        across = bits << number | across
        along = ops.lane_bits(bits == 1) << 8 * number | along
        cells.append(codes & 15 | (codes & 112) << 4 | (codes & 384) << 9)  # a byte each: kind, colour, state
    views = ops.transposed([*cells, cells[-1]])
    clear = ops.where(transposed, along, ops.join_bytes(across)) & 0x7F7F7F7F7F7F7F
    pairs = clear >> 1 & clear  # and the cell to the left is clear, too
    fours = pairs >> 2 & pairs
    ahead, seen = (direction & 0) + 8, direction & 0
    for number in reversed(columns):
        lets, two, four = (each >> 8 * number & 127 for each in (clear, pairs, fours))
        giving = ahead & lets
        giving = ((giving + lets ^ lets) | giving) & lets & 63
        here = giving << 1 | ahead
        ahead = giving << 1 | giving
        giving = here & lets
        giving = giving >> 1 & lets | giving
        giving = giving >> 2 & two | giving
        giving = (giving >> 4 & four | giving) & 126
        seen = seen << 8 | here | giving >> 1
        ahead = ahead | giving | giving >> 1
    seen_lanes = ops.spread_bytes(seen)
    for number in columns:
        shown = ops.where(transposed, views[number], cells[number]) & (0 - (seen_lanes >> number & 1))
        colours = ops.three_of_four(ops.octets(shown))
        ops.store(image, 21 * number, colours if number < 6 else ops.part(colours, 0, 21))


@simd_function()
def fetch_usual(ops: Any, row: Row) -> None:
    """Prefetch the cells that `see_usual` loads; near a border, cells outside the grid with them."""
    x, y, direction = ops.number(row, X), ops.number(row, Y), ops.number(row, DIRECTION)
    height, onward = ops.number(row, HEIGHT), (direction & 2) - 1
    turned = direction & 1
    middle = ops.where(turned == 1, y - (direction - 2) * 3, y) + HEADER
    first = (x - onward * (6 - turned * 3)) * height + middle
    for number in range(USUAL_VIEW):
        ops.prefetch(row, onward * height * number + first)


@simd_function()
def fetch_header(ops: Any, row: Row) -> None:
    """Prefetch what says where the agent is."""
    ops.prefetch(row, 0)


@device_function(force_inline=True)
def see_cells(row: Row, image: NDArray[np.uint8], size: int) -> None:
    """What `see` says, for a view of ``size`` cells. Without branches on what lies where: those cannot be foreseen."""
    half = size // 2
    x, y, width, height = row[X], row[Y], row[WIDTH], row[HEIGHT]
    # rows of the view that lie in the grid, cells of a row left and right of the agent that do, and how far it is in
    # the state from a cell to the one to its right and to the one ahead
    direction = row[DIRECTION]
    if direction == 0:
        rows, left, right, aside, onward = width - x, y, height - 1 - y, 1, height
    elif direction == 1:
        rows, left, right, aside, onward = height - y, width - 1 - x, x, -height, 1
    elif direction == 2:
        rows, left, right, aside, onward = x + 1, height - 1 - y, y, -1, -height
    else:
        rows, left, right, aside, onward = y + 1, x, width - 1 - x, height, -1
    first, last = half - left, half + right
    everything = (1 << size) - 1
    hiding = row[SEE_THROUGH] & 1 == 0
    showing = ~(HIDING | hiding_looks(row))
    seen = everything
    ahead = 1 << half  # bit i: cell i of the next row is seen
    start = HEADER + x * height + y - half * aside  # of the row's first cell
    for distance in range(size):
        if distance >= rows:
            last = -1
        if hiding:
            if ahead == 0:
                leave_dark(image, size - distance)
                break
            clear = 0
            for i in range(size):
                inside = (first <= i) & (i <= last)
                place = np.uint64(start + i * aside if inside else 0)  # unsigned: not looked for from the end
                code = row[place]
                clear |= (showing >> look_of(code) & inside) << i
            giving = spread_right(ahead, clear) & everything >> 1
            seen = ahead | giving << 1
            ahead = giving | giving << 1
            giving = spread_left(seen, clear, size) & ~1
            seen |= giving >> 1
            ahead |= giving | giving >> 1
        for i in range(size):
            inside = (first <= i) & (i <= last)
            place = np.uint64(start + i * aside if inside else 0)
            code = (row[place] if inside else GREY_WALL) & -(seen >> i & 1)
            show(image, i, size - 1 - distance, code)
        start += onward
    show(image, half, size - 1, int64(row[CARRYING]))


@device_function(force_inline=True)
def show(image: NDArray[np.uint8], i: int, j: int, code: int) -> None:
    """Write down a cell as the agent sees it: kind, colour, state."""
    image[i, j, 0] = kind_of(code)
    image[i, j, 1] = colour_of(code)
    image[i, j, 2] = state_of(code)


@inline
def leave_dark(image: NDArray[np.uint8], rows: int) -> None:
    """Make the upper rows of a view unseen."""
    for i in range(image.shape[0]):
        for j in range(rows):
            image[i, j, 0] = image[i, j, 1] = image[i, j, 2] = 0


@inline
def spread_right(seen: int, clear: int) -> int:
    """The clear cells of a row that are seen once sight has spread along it to higher bits."""
    giving = seen & clear
    return (giving + clear ^ clear | giving) & clear  # the sum's carry runs through the clear cells after each


@inline
def spread_left(seen: int, clear: int, size: int) -> int:
    """The clear cells of a row that are seen once sight has spread along it to lower bits."""
    giving = seen & clear
    run = clear  # bit i: the cells from i to where a stride of this length starts are all clear
    stride = 1
    while stride < size:
        giving |= giving >> stride & run
        run &= run >> stride
        stride *= 2
    return giving


@kernel("(int32[::1], uint8[:, :, ::1])")
def see_all(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (width, height, 3: kind, colour, state; indexed [x, y]) with the whole grid, agent included."""
    for x in range(row[WIDTH]):
        for y in range(row[HEIGHT]):
            show(image, x, y, row[HEADER + x * row[HEIGHT] + y])
    image[row[X], row[Y], 0] = AGENT
    image[row[X], row[Y], 1] = RED
    image[row[X], row[Y], 2] = row[DIRECTION]
