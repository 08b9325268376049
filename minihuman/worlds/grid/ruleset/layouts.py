"""The layouts of worlds of rules, as kernels: the task that is drawn, rooms with doors, and where things lie.

The rooms are those of XLand-MiniGrid 0.9.3 (R1, R2, R4, R6 and R9); the random draws are our own.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.ruleset.dynamics import (
    BLACK_FLOOR,
    DIRECTION,
    DOOR_CLOSED,
    FAILED,
    GOAL,
    GREY,
    GREY_WALL,
    HEADER,
    HEIGHT,
    NEW,
    PER_RULE,
    PHASE,
    PLAYING,
    POCKET,
    RULES,
    STEP,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    cell_index,
    first_cell,
)
from minihuman.worlds.kernels import device_function, inline, kernel
from minihuman.worlds.rng import RngState, integer

# indices in a task's record: four numbers of the goal, the number of rules, that of things; then the rules and things
N_RULES, N_THINGS, RECORD = range(4, 7)
ROOMS = (1, 2, 4, 6, 9)


@device_function()
def put_wall_down(row: Row, x: int) -> None:
    """Put a wall into the whole column ``x`` of the grid."""
    for y in range(row[HEIGHT]):
        row[cell_index(row, y, x)] = GREY_WALL


@device_function()
def put_wall_across(row: Row, y: int, first: int, last: int) -> None:
    """Put a wall into row ``y`` of the grid, from column ``first`` to before ``last``."""
    for x in range(first, last):
        row[cell_index(row, y, x)] = GREY_WALL


@inline
def put_door(row: Row, rng_state: RngState, y: int, x: int) -> None:
    """Put a closed door, whose colour is drawn from red to grey, into row ``y`` and column ``x`` of the grid."""
    row[cell_index(row, y, x)] = DOOR_CLOSED | integer(rng_state, 1, GREY + 1) << 4


@device_function()
def build_four_rooms(row: Row, rng_state: RngState) -> None:
    """Build two rooms by two, with a door in each of the four walls between them."""
    height = row[HEIGHT]
    width = row[WIDTH]
    put_wall_down(row, width // 2)
    put_wall_across(row, height // 2, 0, width)
    put_door(row, rng_state, height // 2, integer(rng_state, 1, height // 2))
    put_door(row, rng_state, height // 2, width // 2 + integer(rng_state, 1, height // 2))
    put_door(row, rng_state, integer(rng_state, 1, height // 2), width // 2)
    put_door(row, rng_state, height // 2 + integer(rng_state, 1, height // 2), width // 2)


@device_function()
def build_six_rooms(row: Row, rng_state: RngState) -> None:
    """Build a corridor with three rooms on either side."""
    height = row[HEIGHT]
    width = row[WIDTH]
    left = width // 2 - 2
    right = width // 2 + 2
    put_wall_down(row, left)
    put_wall_down(row, right)
    for i in range(1, 3):
        put_wall_across(row, i * (height // 3), 0, left)
        put_wall_across(row, i * (height // 3), right, right + left)
    for x in (left, right):
        for i in range(3):
            put_door(row, rng_state, height // 2 + (i - 1) * (height // 3), x)


@device_function()
def build_nine_rooms(row: Row, rng_state: RngState) -> None:
    """Build three rooms by three, with a door in each of the twelve walls between them."""
    room_width = row[WIDTH] // 3
    room_height = row[HEIGHT] // 3
    for i in range(1, 3):
        put_wall_down(row, i * room_width)
        put_wall_across(row, i * room_height, 0, row[WIDTH])
    for i in range(3):
        for j in range(3):
            if i < 2:
                put_door(row, rng_state, j * room_height + integer(rng_state, 1, room_width), (i + 1) * room_width)
            if j < 2:
                put_door(row, rng_state, (j + 1) * room_height, i * room_width + integer(rng_state, 1, room_width))


@device_function()
def build_rooms(row: Row, rng_state: RngState, rooms: int) -> None:
    """Fill the grid with floor, outer walls, and the walls and doors between 1, 2, 4, 6 or 9 rooms."""
    height = row[HEIGHT]
    width = row[WIDTH]
    cells = first_cell(row)
    for cell in range(cells, cells + height * width):
        row[cell] = BLACK_FLOOR
    if rooms == 2:
        put_wall_down(row, width // 2)
        put_door(row, rng_state, integer(rng_state, 1, height - 1), width // 2)
    elif rooms == 4:
        build_four_rooms(row, rng_state)
    elif rooms == 6:
        build_six_rooms(row, rng_state)
    elif rooms == 9:
        build_nine_rooms(row, rng_state)
    put_wall_across(row, 0, 0, width)
    put_wall_across(row, height - 1, 0, width)
    for y in range(height):
        row[cell_index(row, y, 0)] = row[cell_index(row, y, width - 1)] = GREY_WALL


@device_function()
def draw_floor(row: Row, rng_state: RngState) -> int:
    """Return the index in the row of a random tile of black floor, of which the grid must have one at least."""
    cells = first_cell(row)
    while True:
        cell = cells + integer(rng_state, 0, row[HEIGHT] * row[WIDTH])
        if row[cell] == BLACK_FLOOR:
            return cell


@device_function()
def lay_out_row(
    row: Row, rng_state: RngState, records: NDArray[np.uint8], starts: NDArray[np.int64], task: int, rooms: int
) -> None:
    """Begin an episode of a task: write its rules into the row, build the rooms, and place things and the agent.

    If there is too little floor for all of them, the row is marked as failed. The task begins at ``starts[task]`` in
    ``records``, in which all tasks lie one after the other; ``rooms`` is the number of rooms.
    """
    start = starts[task]
    rules = int(records[start + N_RULES])
    things = int(records[start + N_THINGS])
    cells = first_cell(row)
    row[STEP] = 0
    row[POCKET] = 0
    row[PHASE] = NEW
    row[RULES] = rules
    row[TASK] = task
    row[FAILED] = 0
    for i in range(4):
        row[GOAL + i] = records[start + i]
    for i in range(HEADER, cells):
        row[i] = records[start + RECORD + i - HEADER] if i < HEADER + PER_RULE * rules else 0
    build_rooms(row, rng_state, rooms)
    free = 0
    for cell in range(cells, len(row)):
        free += row[cell] == BLACK_FLOOR
    if free <= things:
        row[FAILED] = 1
        return
    first = start + RECORD + PER_RULE * rules
    for i in range(things):
        row[draw_floor(row, rng_state)] = records[first + i]
    place = draw_floor(row, rng_state) - cells
    row[Y] = place // row[WIDTH]
    row[X] = place % row[WIDTH]
    row[DIRECTION] = integer(rng_state, 0, 4)
    row[PHASE] = PLAYING


@kernel("(int32[::1], uint64[::1], uint8[::1], int64[::1], int64, int64, int64)", hold_gil=True)
def lay_out_task(
    row: Row,
    rng_state: RngState,
    records: NDArray[np.uint8],
    starts: NDArray[np.int64],
    first: int,
    last: int,
    rooms: int,
) -> None:
    """Begin an episode of a task that is drawn: its number is at least ``first`` and less than ``last``.

    If there is too little floor for everything, the row is marked as failed and begins no episode. ``records`` and
    ``starts`` are the tasks, as in `lay_out_row`, and ``rooms`` is the number of rooms.
    """
    lay_out_row(row, rng_state, records, starts, integer(rng_state, first, last), rooms)


@kernel("(int32[:, ::1], int64[::1], uint64[:, ::1], uint8[::1], int64[::1], int64, int64, int64)", nogil=True)
def lay_out_tasks(
    rows: Row,
    worlds: NDArray[np.int64],
    rng_states: RngState,
    records: NDArray[np.uint8],
    starts: NDArray[np.int64],
    first: int,
    last: int,
    rooms: int,
) -> int:
    """Run `lay_out_task` for the worlds with the numbers ``worlds``; return the first number that failed, or -1.

    ``rows`` and ``rng_states`` have a row for each world of the batch. The other parameters are as in `lay_out_task`.
    """
    failed = -1
    for k in range(len(worlds)):
        i = worlds[k]
        lay_out_row(rows[i], rng_states[i], records, starts, integer(rng_states[i], first, last), rooms)
        if failed < 0 and rows[i, FAILED] != 0:
            failed = i
    return failed
