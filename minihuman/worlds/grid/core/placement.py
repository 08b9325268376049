"""Placement in layouts: walls, openings, objects in a random cell, the agent. All are functions on a row of state.

Every draw is made in the order in which Minigrid makes it, so the same seed gives the same layout.
"""

from minihuman.worlds.grid.core.cells import EMPTY, GREY_WALL
from minihuman.worlds.grid.core.state import DIRECTION, FAILED, HEADER, HEIGHT, WIDTH, Row, X, Y, put
from minihuman.worlds.kernels import inline, kernel
from minihuman.worlds.rng import RngState, integer

UNLIMITED_TRIES = 1 << 30  # tries; a layout that needs more has no free place at all


@kernel("void(int32[::1], int64, int64, int64, int64)", only=True)
def wall_across(row: Row, x: int, y: int, length: int, code: int) -> None:
    """Put a code, such as that of a wall, into ``length`` cells in a horizontal line, from (x, y) to the right."""
    for i in range(length):
        put(row, x + i, y, code)


@kernel("void(int32[::1], int64, int64, int64, int64)", only=True)
def wall_down(row: Row, x: int, y: int, length: int, code: int) -> None:
    """Put a code, such as that of a wall, into ``length`` cells in a vertical line, from (x, y) down."""
    for j in range(length):
        put(row, x, y + j, code)


@kernel("void(int32[::1], int64, int64, int64, int64)", only=True)
def wall_rect(row: Row, x: int, y: int, width: int, height: int) -> None:
    """Put the four walls of a room with its top left corner at (x, y). The size includes the walls."""
    wall_across(row, x, y, width, GREY_WALL)
    wall_across(row, x, y + height - 1, width, GREY_WALL)
    wall_down(row, x, y, height, GREY_WALL)
    wall_down(row, x + width - 1, y, height, GREY_WALL)


@inline
def outer_walls(row: Row) -> None:
    """Put walls around the whole grid."""
    wall_rect(row, 0, 0, row[WIDTH], row[HEIGHT])


@inline
def has_room(row: Row, x: int, y: int, width: int, height: int) -> bool:
    """Return whether any cell of a rectangle with the top left cell (x, y) is free: empty, and without the agent.

    If none is, drawing cells until one is free would not end.
    """
    for i in range(max(x, 0), min(max(x, 0) + width, row[WIDTH])):
        for j in range(max(y, 0), min(max(y, 0) + height, row[HEIGHT])):
            if row[HEADER + i * row[HEIGHT] + j] == EMPTY and not (i == row[X] and j == row[Y]):
                return True
    return False


@kernel("UniTuple(int64, 2)(int32[::1], uint64[::1], int64, int64, int64, int64, int64)", only=True)
def draw_place(row: Row, rng_state: RngState, x: int, y: int, width: int, height: int, tries: int) -> tuple[int, int]:
    """Draw cells of a rectangle with the top left cell (x, y), at most ``tries``, until one is free, and return it.

    A cell is free if it is empty and the agent does not stand there. If no free cell was drawn, return (-1, -1) and
    mark the row as FAILED.
    """
    x = max(x, 0)
    y = max(y, 0)
    if has_room(row, x, y, width, height):
        for _ in range(tries):
            i = integer(rng_state, x, min(x + width, row[WIDTH]))
            j = integer(rng_state, y, min(y + height, row[HEIGHT]))
            if row[HEADER + i * row[HEIGHT] + j] == EMPTY and not (i == row[X] and j == row[Y]):
                return i, j
    row[FAILED] = 1
    return -1, -1


@kernel("UniTuple(int64, 2)(int32[::1], uint64[::1], int64, int64, int64, int64, int64)", only=True)
def place(row: Row, rng_state: RngState, code: int, x: int, y: int, width: int, height: int) -> tuple[int, int]:
    """Put a code into a random free cell of a rectangle with the top left cell (x, y); return the cell.

    If none is free, return (-1, -1) and mark the row as FAILED.
    """
    i, j = draw_place(row, rng_state, x, y, width, height, UNLIMITED_TRIES)
    if i >= 0:
        put(row, i, j, code)
    return i, j


@inline
def place_anywhere(row: Row, rng_state: RngState, code: int) -> tuple[int, int]:
    """Put a code into a random free cell of the whole grid; return the cell, or (-1, -1) as `place` does."""
    return place(row, rng_state, code, 0, 0, row[WIDTH], row[HEIGHT])


@inline
def stand(row: Row, x: int, y: int, direction: int) -> None:
    """Put the agent into the cell (x, y), which is not checked, looking in a direction."""
    row[X] = x
    row[Y] = y
    row[DIRECTION] = direction


@kernel("void(int32[::1], uint64[::1], int64, int64, int64, int64)", only=True)
def place_agent(row: Row, rng_state: RngState, x: int, y: int, width: int, height: int) -> None:
    """Put the agent into a random free cell of a rectangle with the top left cell (x, y), in a random direction.

    If none is free, mark the row as FAILED.
    """
    row[X] = row[Y] = -1
    i, j = draw_place(row, rng_state, x, y, width, height, UNLIMITED_TRIES)
    stand(row, i, j, integer(rng_state, 0, 4))


@inline
def place_agent_anywhere(row: Row, rng_state: RngState) -> None:
    """Put the agent into a random free cell of the whole grid, looking in a random direction, as `place_agent` does."""
    place_agent(row, rng_state, 0, 0, row[WIDTH], row[HEIGHT])
