"""Crossing: rivers of lava or walls across a room, each with one opening on the way to the goal."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minihuman.worlds.grid.cells import EMPTY, GREEN_GOAL
from minihuman.worlds.grid.chance import Words, integer
from minihuman.worlds.grid.place import across, down, outer_walls, stand
from minihuman.worlds.grid.state import HEIGHT, WIDTH, Row, put

UPRIGHT, LEVEL = 0, 1  # directions of a river


@njit(cache=True)
def crossing(row: Row, words: Words, rivers: int, obstacle: int) -> None:
    """``rivers`` rivers of the code ``obstacle``; columns and rows of the grid are odd and the same."""
    width, height = row[WIDTH], row[HEIGHT]
    outer_walls(row)
    stand(row, 1, 1, 0)
    put(row, width - 2, height - 2, GREEN_GOAL)
    columns, rows = draw_rivers(words, width, height, rivers)
    for y in rows:
        across(row, 1, y, width - 2, obstacle)
    for x in columns:
        down(row, x, 1, height - 2, obstacle)
    path = np.full(len(columns) + len(rows), UPRIGHT, np.int64)
    path[: len(columns)] = LEVEL  # walking level crosses an upright river
    shuffle(words, path)
    column_limits = limits(columns, height)
    row_limits = limits(rows, width)
    i = j = 0
    for way in path:
        if way == LEVEL:
            put(row, column_limits[i + 1], integer(words, row_limits[j] + 1, row_limits[j + 1]), EMPTY)
            i += 1
        else:
            put(row, integer(words, column_limits[i] + 1, column_limits[i + 1]), row_limits[j + 1], EMPTY)
            j += 1


@njit(cache=True)
def draw_rivers(words: Words, width: int, height: int, rivers: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns of the upright rivers and rows of the level ones, each in order."""
    upright = (height - 3) // 2
    places = np.empty((upright + (width - 3) // 2, 2), np.int64)
    for k in range(len(places)):
        places[k, 0] = UPRIGHT if k < upright else LEVEL
        places[k, 1] = 2 + 2 * (k if k < upright else k - upright)
    order = np.arange(len(places))
    shuffle(words, order)
    chosen = places[order[:rivers]]
    return np.sort(chosen[chosen[:, 0] == UPRIGHT, 1]), np.sort(chosen[chosen[:, 0] == LEVEL, 1])


@njit(cache=True)
def limits(rivers: NDArray[np.int64], length: int) -> NDArray[np.int64]:
    """The rivers with the outer walls before and after them."""
    bounds = np.zeros(len(rivers) + 2, np.int64)
    bounds[1:-1] = rivers
    bounds[-1] = length - 1
    return bounds


@njit(cache=True)
def shuffle(words: Words, values: NDArray[np.int64]) -> None:
    """Shuffle in place, as ``Generator.shuffle`` shuffles a list."""
    for i in range(len(values) - 1, 0, -1):
        j = integer(words, 0, i + 1)
        values[i], values[j] = values[j], values[i]
