"""What the agent sees: the cells in front of it, turned so that it looks up, without what walls and doors hide."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.cells import AGENT, GREY_WALL, RED, colour_of, kind_of, lets_see, state_of
from minihuman.worlds.grid.state import CARRYING, DIRECTION, HEADER, HEIGHT, SEE_THROUGH, WIDTH, Row, X, Y

LARGEST_VIEW = 61  # a row of the view is the bits of one int64


def see_size(size: int) -> int:
    """The size, if a view can have it.

    Raises:
        WorldError: if it cannot.
    """
    if size % 2 == 0 or not 3 <= size <= LARGEST_VIEW:
        raise WorldError(f"agent_view_size is {size!r}; it is odd, 3 to {LARGEST_VIEW}")
    return size


@njit(cache=True)
def see(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (size, size, 3: kind, colour, state; indexed [right, down]) with the agent's view.

    The agent is at the bottom's middle; its own cell shows what it carries. Unseen cells are 0. Sight spreads from
    the agent row by row, as Minigrid defines it: within a row first rightwards, then leftwards, and every seen cell
    that lets see passes it on to its neighbour in that direction and to the two cells ahead of both.
    """
    size = image.shape[0]
    half = size // 2
    direction = row[DIRECTION]
    forward_x = (1 - direction) * (1 - direction % 2)
    forward_y = (2 - direction) * (direction % 2)
    right_x, right_y = -forward_y, forward_x
    first, last = inside_part(row, right_x, right_y, half)
    stride = right_x * row[HEIGHT] + right_y
    everything = (1 << size) - 1
    walls = everything & ~((1 << last + 1) - (1 << first))  # the columns of the view beside the grid
    ahead = 1 << half  # bit i: cell i of the next row is seen
    for distance in range(size):
        x, y = row[X] + forward_x * distance, row[Y] + forward_y * distance
        start = HEADER + x * row[HEIGHT] + y - half * stride
        inside = 0 <= x < row[WIDTH] and 0 <= y < row[HEIGHT]
        seen = everything
        if row[SEE_THROUGH] == 0:
            clear = 0
            if inside:
                for i in range(first, last + 1):
                    clear |= np.int64(lets_see(row[start + i * stride])) << i
            giving = spread(ahead, clear, size, 1) & everything >> 1
            seen = ahead | giving << 1
            ahead = giving | giving << 1
            giving = spread(seen, clear, size, -1) & ~1
            seen |= giving >> 1
            ahead |= giving | giving >> 1
        for i in range(size):
            code = GREY_WALL if not inside or walls >> i & 1 else row[start + i * stride]
            code *= seen >> i & 1
            image[i, size - 1 - distance, 0] = kind_of(code)
            image[i, size - 1 - distance, 1] = colour_of(code)
            image[i, size - 1 - distance, 2] = state_of(code)
    held = row[CARRYING]
    image[half, size - 1, 0] = kind_of(held)
    image[half, size - 1, 1] = colour_of(held)
    image[half, size - 1, 2] = state_of(held)


@njit(cache=True)
def inside_part(row: Row, right_x: int, right_y: int, half: int) -> tuple[int, int]:
    """The first and the last column of the view that lie in the grid."""
    if right_x != 0:
        near, far = row[X], row[WIDTH] - 1 - row[X]
    else:
        near, far = row[Y], row[HEIGHT] - 1 - row[Y]
    if right_x + right_y < 0:
        near, far = far, near
    return half - min(half, near), half + min(half, far)


@njit(cache=True)
def spread(seen: int, clear: int, size: int, step: int) -> int:
    """The clear cells of a row that are seen once sight has spread along it, to higher bits (step 1) or lower (-1)."""
    giving = seen & clear
    run = clear  # bit i: the cells from i back to where a stride of this length starts are all clear
    stride = 1
    while stride < size:
        if step > 0:
            giving |= giving << stride & run
            run &= run << stride
        else:
            giving |= giving >> stride & run
            run &= run >> stride
        stride *= 2
    return giving


@njit(cache=True)
def see_all(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (width, height, 3: kind, colour, state; indexed [x, y]) with the whole grid, agent included."""
    for x in range(row[WIDTH]):
        for y in range(row[HEIGHT]):
            code = row[HEADER + x * row[HEIGHT] + y]
            image[x, y, 0] = kind_of(code)
            image[x, y, 1] = colour_of(code)
            image[x, y, 2] = state_of(code)
    image[row[X], row[Y], 0] = AGENT
    image[row[X], row[Y], 1] = RED
    image[row[X], row[Y], 2] = row[DIRECTION]
