"""Crossing: rivers of lava or walls across a room, each with one opening on the way to the goal."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import EMPTY, GREEN_GOAL
from minihuman.worlds.grid.core.chance import Words, integer, shuffle
from minihuman.worlds.grid.core.place import across, down, outer_walls, stand
from minihuman.worlds.grid.core.state import HEIGHT, WIDTH, Row, put
from minihuman.worlds.kernels import kernel, part

UPRIGHT, LEVEL = 0, 1  # directions of a river


@kernel()
def crossing(row: Row, words: Words, rivers: int, obstacle: int) -> None:
    """``rivers`` rivers of the code ``obstacle``; columns and rows of the grid are odd and the same."""
    width, height = row[WIDTH], row[HEIGHT]
    outer_walls(row)
    stand(row, 1, 1, 0)
    put(row, width - 2, height - 2, GREEN_GOAL)
    is_river = draw_rivers(words, width, rivers)
    # columns and rows of the grid that bound its fields: outer walls and rivers
    columns, rows = bounds(is_river[UPRIGHT]), bounds(is_river[LEVEL])
    for y in rows[1:-1]:
        across(row, 1, y, width - 2, obstacle)
    for x in columns[1:-1]:
        down(row, x, 1, height - 2, obstacle)
    path = np.full(len(columns) + len(rows) - 4, UPRIGHT, np.int64)
    path[: len(columns) - 2] = LEVEL  # walking level crosses an upright river
    shuffle(words, path)
    i = j = 0
    for way in path:
        if way == LEVEL:
            put(row, columns[i + 1], integer(words, rows[j] + 1, rows[j + 1]), EMPTY)
            i += 1
        else:
            put(row, integer(words, columns[i] + 1, columns[i + 1]), rows[j + 1], EMPTY)
            j += 1


@part()
def draw_rivers(words: Words, size: int, rivers: int) -> NDArray[np.bool_]:
    """Whether a river runs there, (2, size): by column for the upright ones, by row for the level ones."""
    places = (size - 3) // 2  # of each direction: the even lines that do not touch the outer walls
    order = np.arange(2 * places)
    shuffle(words, order)
    is_river = np.zeros((2, size), np.bool_)
    for k in order[:rivers]:
        is_river[k // places, 2 + 2 * (k % places)] = True
    return is_river


@part()
def bounds(is_river: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The lines with a river, between the first and the last line of the grid."""
    lines = np.empty(is_river.sum() + 2, np.int64)
    lines[0] = 0
    k = 1
    for line in range(len(is_river)):
        if is_river[line]:
            lines[k] = line
            k += 1
    lines[k] = len(is_river) - 1
    return lines
