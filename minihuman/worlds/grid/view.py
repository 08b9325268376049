"""What the agent sees: the cells in front of it, turned so that it looks up, without what walls and doors hide."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.grid.cells import AGENT, RED, colour_of, kind_of, lets_see, state_of
from minihuman.worlds.grid.state import CARRYING, DIRECTION, HEADER, HEIGHT, SEE_THROUGH, WIDTH, Row, X, Y, cell_at

LARGEST_VIEW = 61  # a row of the view is the bits of one int64


@njit(cache=True)
def see(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (size, size, 3: kind, colour, state; indexed [right, down]) with the agent's view.

    The agent is at the bottom's middle; its own cell shows what it carries. Unseen cells are 0. Sight spreads from
    the agent row by row: a cell passes it to its neighbours beside and ahead unless it blocks sight, first
    rightwards, then leftwards, as Minigrid defines it.
    """
    size = image.shape[0]
    half = size // 2
    direction = row[DIRECTION]
    forward_x = (1 - direction) * (1 - direction % 2)
    forward_y = (2 - direction) * (direction % 2)
    right_x, right_y = -forward_y, forward_x
    see_through = row[SEE_THROUGH] == 1
    everything = (1 << size) - 1
    ahead = 1 << half  # bit i: cell i of the row is seen
    for down in range(size - 1, -1, -1):
        distance = size - 1 - down
        x0 = row[X] + forward_x * distance - right_x * half
        y0 = row[Y] + forward_y * distance - right_y * half
        seen = everything if see_through else ahead
        clear = 0
        for i in range(size):
            code = cell_at(row, x0 + right_x * i, y0 + right_y * i)
            if lets_see(code):
                clear |= 1 << i
            image[i, down, 0] = kind_of(code)
            image[i, down, 1] = colour_of(code)
            image[i, down, 2] = state_of(code)
        if see_through:
            continue
        ahead = 0
        for i in range(size - 1):
            if seen & clear & 1 << i:
                seen |= 1 << i + 1
                ahead |= 3 << i
        for i in range(size - 1, 0, -1):
            if seen & clear & 1 << i:
                seen |= 1 << i - 1
                ahead |= 3 << i - 1
        for i in range(size):
            if not seen & 1 << i:
                image[i, down, :] = 0
    code = row[CARRYING]
    image[half, size - 1, 0] = kind_of(code)
    image[half, size - 1, 1] = colour_of(code)
    image[half, size - 1, 2] = state_of(code)


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
