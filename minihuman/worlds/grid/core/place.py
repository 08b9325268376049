"""The verbs of layouts: walls, openings, objects at a drawn place, the agent. Plain functions on a row of state.

Every draw is made in the order Minigrid makes it, so the same seed gives the same layout.
"""

from minihuman.worlds.grid.core.cells import EMPTY, GREY_WALL
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.state import DIRECTION, FAILED, HEADER, HEIGHT, WIDTH, Row, X, Y, put
from minihuman.worlds.kernels import inlined, kernel

FOR_EVER = 1 << 30  # tries; a layout that needs more has no free place at all


@kernel("void(int32[::1], int64, int64, int64, int64)")
def across(row: Row, x: int, y: int, length: int, code: int) -> None:
    """A horizontal line from (x, y)."""
    for i in range(length):
        put(row, x + i, y, code)


@kernel("void(int32[::1], int64, int64, int64, int64)")
def down(row: Row, x: int, y: int, length: int, code: int) -> None:
    """A vertical line from (x, y)."""
    for j in range(length):
        put(row, x, y + j, code)


@kernel("void(int32[::1], int64, int64, int64, int64)")
def wall_rect(row: Row, x: int, y: int, width: int, height: int) -> None:
    """The four walls of a room with its top left corner at (x, y), walls included in the size."""
    across(row, x, y, width, GREY_WALL)
    across(row, x, y + height - 1, width, GREY_WALL)
    down(row, x, y, height, GREY_WALL)
    down(row, x + width - 1, y, height, GREY_WALL)


@inlined
def outer_walls(row: Row) -> None:
    """Walls around the whole grid."""
    wall_rect(row, 0, 0, row[WIDTH], row[HEIGHT])


@inlined
def has_room(row: Row, x: int, y: int, width: int, height: int) -> bool:
    """Whether any cell of the rectangle is free: without one, drawing places would never end."""
    for i in range(max(x, 0), min(max(x, 0) + width, row[WIDTH])):
        for j in range(max(y, 0), min(max(y, 0) + height, row[HEIGHT])):
            if row[HEADER + i * row[HEIGHT] + j] == EMPTY and not (i == row[X] and j == row[Y]):
                return True
    return False


@kernel("UniTuple(int64, 2)(int32[::1], uint64[::1], int64, int64, int64, int64, int64)")
def draw_place(row: Row, words: Words, x: int, y: int, width: int, height: int, tries: int) -> tuple[int, int]:
    """Draw cells of the rectangle until one is free; (-1, -1), and the row marked FAILED, if none is found."""
    x, y = max(x, 0), max(y, 0)
    if has_room(row, x, y, width, height):
        for _ in range(tries):
            i = integer(words, x, min(x + width, row[WIDTH]))
            j = integer(words, y, min(y + height, row[HEIGHT]))
            if row[HEADER + i * row[HEIGHT] + j] == EMPTY and not (i == row[X] and j == row[Y]):
                return i, j
    row[FAILED] = 1
    return -1, -1


@kernel("UniTuple(int64, 2)(int32[::1], uint64[::1], int64, int64, int64, int64, int64)")
def place(row: Row, words: Words, code: int, x: int, y: int, width: int, height: int) -> tuple[int, int]:
    """Lay a code into a drawn free cell of the rectangle; where it lies, or (-1, -1)."""
    i, j = draw_place(row, words, x, y, width, height, FOR_EVER)
    if i >= 0:
        put(row, i, j, code)
    return i, j


@inlined
def place_anywhere(row: Row, words: Words, code: int) -> tuple[int, int]:
    """Lay a code into a drawn free cell of the whole grid."""
    return place(row, words, code, 0, 0, row[WIDTH], row[HEIGHT])


@inlined
def stand(row: Row, x: int, y: int, direction: int) -> None:
    """Put the agent into a cell, looking in a direction."""
    row[X], row[Y], row[DIRECTION] = x, y, direction


@kernel("void(int32[::1], uint64[::1], int64, int64, int64, int64)")
def place_agent(row: Row, words: Words, x: int, y: int, width: int, height: int) -> None:
    """Put the agent into a drawn free cell of the rectangle, looking in a drawn direction."""
    row[X] = row[Y] = -1
    i, j = draw_place(row, words, x, y, width, height, FOR_EVER)
    stand(row, i, j, integer(words, 0, 4))


@inlined
def place_agent_anywhere(row: Row, words: Words) -> None:
    """Put the agent into a drawn free cell of the whole grid, looking in a drawn direction."""
    place_agent(row, words, 0, 0, row[WIDTH], row[HEIGHT])
