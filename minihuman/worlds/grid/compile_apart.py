"""What takes seconds to compile, in pieces that do not need each other: each is run once on next to nothing."""

import numpy as np

from minihuman.worlds.grid.art.pictures import draw
from minihuman.worlds.grid.core.rules import act, step
from minihuman.worlds.grid.core.state import DIRECTION, HEIGHT, WIDTH, Row, X, Y, clear, row_length
from minihuman.worlds.grid.core.view import see


def moves() -> None:
    """Ask for an action where no episode has begun."""
    act(_floor(), 0, np.zeros(6, np.uint64))


def steps() -> None:
    """Look around, and then ask for a step, which is a look and what `moves` compiles: by now that is there."""
    row, image = _floor(), np.empty((3, 3, 3), np.uint8)
    see(row, image)
    step(row, 0, np.zeros(6, np.uint64), image)


def pictures() -> None:
    """Draw a floor from above."""
    draw(_floor(), view="full", view_size=3, tile_px=1, palette="classic", lit=False, by_bytes=True)


PIECES = moves, pictures, steps  # one process begins here, a second one at the end: each has half of it


def _floor() -> Row:
    row = np.zeros(row_length(3, 3), np.int32)
    row[[WIDTH, HEIGHT]] = 3
    clear(row)
    row[[X, Y, DIRECTION]] = 1, 1, 0
    return row
