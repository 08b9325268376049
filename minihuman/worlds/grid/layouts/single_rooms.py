"""Layouts of one room: open floors, lava, rivers to cross, and objects to fetch, put near or remember.

Empty, DistShift, LavaGap, DynamicObstacles, Crossing; Fetch, GoToObject, PutNear, GoToDoor, Memory.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    BALL,
    BLUE,
    BOX,
    CLOSED,
    DOOR,
    EMPTY,
    GREEN,
    GREEN_GOAL,
    GREY_WALL,
    KEY,
    RED_LAVA,
    SORTED_COLOURS,
)
from minihuman.worlds.grid.core.placement import (
    UNLIMITED_TRIES,
    draw_place,
    outer_walls,
    place_agent,
    place_agent_anywhere,
    place_anywhere,
    stand,
    wall_across,
    wall_down,
    wall_rect,
)
from minihuman.worlds.grid.core.rewards import DODGE, FETCH, MATCH, PUT_NEAR, STAND_BY
from minihuman.worlds.grid.core.state import FAILED, HEIGHT, MISSION, TARGET, TASK, WIDTH, Row, make, put
from minihuman.worlds.kernels import device_function, kernel
from minihuman.worlds.rng import RngState, integer, shuffle

KINDS_DRAWN = (KEY, BALL, BOX)


@device_function()
def draw_colour(rng_state: RngState) -> int:
    """Draw one of the six colours."""
    return SORTED_COLOURS[integer(rng_state, 0, 6)]


@device_function()
def draw_kind(rng_state: RngState, kinds: int) -> int:
    """Draw one of the first ``kinds`` of key, ball and box."""
    return KINDS_DRAWN[integer(rng_state, 0, kinds)]


@kernel("(int32[::1], uint64[::1], int64)")
def fetch(row: Row, rng_state: RngState, objects: int) -> None:
    """Lay out a room with ``objects`` keys and balls; the agent must fetch one like the named one."""
    outer_walls(row)
    kinds = np.empty(objects, np.int64)
    colours = np.empty(objects, np.int64)
    for k in range(objects):
        kinds[k] = draw_kind(rng_state, 2)
        colours[k] = draw_colour(rng_state)
        place_anywhere(row, rng_state, make(row, kinds[k], colours[k], 0))
    place_agent_anywhere(row, rng_state)
    k = integer(rng_state, 0, objects)
    row[TASK] = FETCH
    row[TARGET] = kinds[k]
    row[TARGET + 1] = colours[k]
    row[MISSION] = integer(rng_state, 0, 5)
    row[MISSION + 1] = colours[k]
    row[MISSION + 2] = kinds[k]


@device_function()
def draw_objects(row: Row, rng_state: RngState, objects: int, apart: bool) -> NDArray[np.int64]:
    """Put objects that all differ in kind or colour into random cells; return the kind, colour, x and y of each.

    ``objects`` is their number, 18 at most. With ``apart``, no object touches another. If there is no cell for an
    object, mark the row as FAILED.
    """
    placed = np.full((objects, 4), -9, np.int64)  # a place outside the grid, which no cell touches
    k = 0
    while k < objects and row[FAILED] == 0:
        kind = draw_kind(rng_state, 3)
        colour = draw_colour(rng_state)
        known = False
        for other in range(k):
            known |= placed[other, 0] == kind and placed[other, 1] == colour
        if known:
            continue
        x, y = draw_place(row, rng_state, 0, 0, row[WIDTH], row[HEIGHT], UNLIMITED_TRIES)
        tries = 0
        while apart and beside_any(placed, x, y) and row[FAILED] == 0:
            x, y = draw_place(row, rng_state, 0, 0, row[WIDTH], row[HEIGHT], UNLIMITED_TRIES)
            tries += 1
            if tries > 10_000:
                row[FAILED] = 1
        put(row, x, y, make(row, kind, colour, 0))
        placed[k, 0] = kind
        placed[k, 1] = colour
        placed[k, 2] = x
        placed[k, 3] = y
        k += 1
    return placed


@device_function()
def beside_any(placed: NDArray[np.int64], x: int, y: int) -> bool:
    """Return whether the cell (x, y) touches one of the placed objects (kind, colour, x, y), including at corners."""
    for k in range(len(placed)):
        if abs(placed[k, 2] - x) <= 1 and abs(placed[k, 3] - y) <= 1:
            return True
    return False


@kernel("(int32[::1], uint64[::1], int64)")
def go_to_object(row: Row, rng_state: RngState, objects: int) -> None:
    """Lay out a room with ``objects`` objects; the agent must say "done" next to the named one."""
    outer_walls(row)
    placed = draw_objects(row, rng_state, objects, False)
    place_agent_anywhere(row, rng_state)
    kind, colour, x, y = placed[integer(rng_state, 0, objects)]
    row[TASK] = STAND_BY
    row[TARGET] = x
    row[TARGET + 1] = y
    row[MISSION] = colour
    row[MISSION + 1] = kind


@kernel("(int32[::1], uint64[::1], int64)")
def put_near(row: Row, rng_state: RngState, objects: int) -> None:
    """Lay out a room with ``objects`` objects, one of which is to be put near another."""
    outer_walls(row)
    placed = draw_objects(row, rng_state, objects, True)
    place_agent_anywhere(row, rng_state)
    moved = integer(rng_state, 0, objects)
    target = integer(rng_state, 0, objects)
    while target == moved:
        target = integer(rng_state, 0, objects)
    row[TASK] = PUT_NEAR
    row[TARGET] = placed[moved, 0]
    row[TARGET + 1] = placed[moved, 1]
    row[TARGET + 2] = placed[target, 2]
    row[TARGET + 3] = placed[target, 3]
    row[MISSION] = placed[moved, 1]
    row[MISSION + 1] = placed[moved, 0]
    row[MISSION + 2] = placed[target, 1]
    row[MISSION + 3] = placed[target, 0]


@kernel("(int32[::1], uint64[::1])")
def go_to_door(row: Row, rng_state: RngState) -> None:
    """Lay out a room of random size with four doors; the agent must say "done" next to the named one."""
    width = integer(rng_state, 5, row[WIDTH] + 1)
    height = integer(rng_state, 5, row[HEIGHT] + 1)
    wall_rect(row, 0, 0, width, height)
    places = np.empty((4, 2), np.int64)
    places[0, 0] = integer(rng_state, 2, width - 2)
    places[0, 1] = 0
    places[1, 0] = integer(rng_state, 2, width - 2)
    places[1, 1] = height - 1
    places[2, 0] = 0
    places[2, 1] = integer(rng_state, 2, height - 2)
    places[3, 0] = width - 1
    places[3, 1] = integer(rng_state, 2, height - 2)
    colours = np.full(4, -1, np.int64)
    k = 0
    while k < 4:
        colour = draw_colour(rng_state)
        known = False
        for other in range(k):
            known |= colours[other] == colour
        if not known:
            colours[k] = colour
            k += 1
    for k in range(4):
        put(row, places[k, 0], places[k, 1], make(row, DOOR, colours[k], CLOSED))
    place_agent(row, rng_state, 0, 0, width, height)
    k = integer(rng_state, 0, 4)
    row[TASK] = STAND_BY
    row[TARGET] = places[k, 0]
    row[TARGET + 1] = places[k, 1]
    row[MISSION] = colours[k]


@kernel("(int32[::1], uint64[::1], int64)")
def memory(row: Row, rng_state: RngState, random_length: int) -> None:
    """Lay out a corridor with an object at its start and two at its end; the agent must go to the matching one.

    If ``random_length`` is 1, the length of the corridor is drawn.
    """
    width = row[WIDTH]
    height = row[HEIGHT]
    outer_walls(row)
    middle = height // 2
    if random_length:
        end = integer(rng_state, 4, width - 2)
    else:
        end = width - 3
    # the start room, three rows high, with its exit in the middle row; the corridor; the wall with its opening, and the
    # wall at the end, between which the two objects lie
    wall_across(row, 1, middle - 2, 4, GREY_WALL)
    wall_across(row, 1, middle + 2, 4, GREY_WALL)
    put(row, 4, middle - 1, GREY_WALL)
    put(row, 4, middle + 1, GREY_WALL)
    wall_across(row, 5, middle - 1, end - 5, GREY_WALL)
    wall_across(row, 5, middle + 1, end - 5, GREY_WALL)
    for y in range(height):
        if y != middle:
            put(row, end, y, GREY_WALL)
        put(row, end + 2, y, GREY_WALL)
    stand(row, integer(rng_state, 1, end + 1), middle, 0)
    cue = KEY if integer(rng_state, 0, 2) == 0 else BALL
    put(row, 1, middle - 1, make(row, cue, GREEN, 0))
    above = BALL if integer(rng_state, 0, 2) == 0 else KEY
    put(row, end + 1, middle - 2, make(row, above, GREEN, 0))
    put(row, end + 1, middle + 2, make(row, KEY if above == BALL else BALL, GREEN, 0))
    up = -1 if cue == above else 1
    row[TASK] = MATCH
    row[TARGET] = end + 1
    row[TARGET + 1] = middle + up
    row[TARGET + 2] = end + 1
    row[TARGET + 3] = middle - up


@kernel("(int32[::1], uint64[::1], int64, int64, int64)")
def empty(row: Row, rng_state: RngState, agent_x: int, agent_y: int, direction: int) -> None:
    """Lay out a room with only a goal in the bottom right corner.

    If ``agent_x`` is negative, the agent's cell and direction are drawn.
    """
    outer_walls(row)
    put(row, row[WIDTH] - 2, row[HEIGHT] - 2, GREEN_GOAL)
    start(row, rng_state, agent_x, agent_y, direction)


@kernel("(int32[::1], uint64[::1], int64, int64, int64)")
def start(row: Row, rng_state: RngState, x: int, y: int, direction: int) -> None:
    """Put the agent into the cell (x, y), or into a random one with a random direction if ``x`` is negative."""
    if x < 0:
        place_agent_anywhere(row, rng_state)
    else:
        stand(row, x, y, direction)


@kernel("(int32[::1], uint64[::1], int64, int64, int64, int64)")
def dist_shift(row: Row, rng_state: RngState, agent_x: int, agent_y: int, direction: int, second_strip: int) -> None:
    """Lay out a room with two strips of lava, one below the top wall and one in the row ``second_strip``.

    If ``agent_x`` is negative, the agent's cell and direction are drawn.
    """
    outer_walls(row)
    put(row, row[WIDTH] - 2, 1, GREEN_GOAL)
    wall_across(row, 3, 1, row[WIDTH] - 6, RED_LAVA)
    wall_across(row, 3, second_strip, row[WIDTH] - 6, RED_LAVA)
    start(row, rng_state, agent_x, agent_y, direction)


@kernel("(int32[::1], uint64[::1], int64)")
def gap(row: Row, rng_state: RngState, obstacle: int) -> None:
    """Lay out a room with one column of cells of the code ``obstacle``, such as lava, that has a gap."""
    outer_walls(row)
    stand(row, 1, 1, 0)
    put(row, row[WIDTH] - 2, row[HEIGHT] - 2, GREEN_GOAL)
    x = integer(rng_state, 2, row[WIDTH] - 2)
    y = integer(rng_state, 1, row[HEIGHT] - 1)
    wall_down(row, x, 1, row[HEIGHT] - 2, obstacle)
    put(row, x, y, EMPTY)


@kernel("(int32[::1], uint64[::1], int64, int64, int64, int64)")
def dynamic_obstacles(
    row: Row, rng_state: RngState, agent_x: int, agent_y: int, direction: int, obstacles: int
) -> None:
    """Lay out a room with ``obstacles`` balls that move at random.

    If ``agent_x`` is negative, the agent's cell and direction are drawn.
    """
    outer_walls(row)
    put(row, row[WIDTH] - 2, row[HEIGHT] - 2, GREEN_GOAL)
    start(row, rng_state, agent_x, agent_y, direction)
    for _ in range(obstacles):
        ball = make(row, BALL, BLUE, 0)
        x, y = draw_place(row, rng_state, 0, 0, row[WIDTH], row[HEIGHT], 101)
        if x >= 0:
            put(row, x, y, ball)
    row[TASK] = DODGE
    row[TARGET] = obstacles


# directions of a river
UPRIGHT = 0
LEVEL = 1


@kernel("(int32[::1], uint64[::1], int64, int64)")
def crossing(row: Row, rng_state: RngState, rivers: int, obstacle: int) -> None:
    """Lay out a room with ``rivers`` rivers made of the code ``obstacle``, each with an opening.

    The grid is square, with an odd number of cells on a side.
    """
    width = row[WIDTH]
    height = row[HEIGHT]
    outer_walls(row)
    stand(row, 1, 1, 0)
    put(row, width - 2, height - 2, GREEN_GOAL)
    is_river = draw_rivers(rng_state, width, rivers)
    # columns and rows of the grid that bound its fields: outer walls and rivers
    columns = bounds(is_river[UPRIGHT])
    rows = bounds(is_river[LEVEL])
    for y in rows[1:-1]:
        wall_across(row, 1, y, width - 2, obstacle)
    for x in columns[1:-1]:
        wall_down(row, x, 1, height - 2, obstacle)
    path = np.full(len(columns) + len(rows) - 4, UPRIGHT, np.int64)
    path[: len(columns) - 2] = LEVEL  # walking level crosses an upright river
    shuffle(rng_state, path)
    i = j = 0
    for way in path:
        if way == LEVEL:
            put(row, columns[i + 1], integer(rng_state, rows[j] + 1, rows[j + 1]), EMPTY)
            i += 1
        else:
            put(row, integer(rng_state, columns[i] + 1, columns[i + 1]), rows[j + 1], EMPTY)
            j += 1


@device_function()
def draw_rivers(rng_state: RngState, size: int, rivers: int) -> NDArray[np.bool_]:
    """Draw which lines of the grid have a river, and return them as bool[2, size].

    First come the columns with upright rivers, then the rows with level ones. ``size`` is the number of cells on a side
    of the grid, and ``rivers`` the number of rivers.
    """
    places = (size - 3) // 2  # of each direction: the even lines that do not touch the outer walls
    order = np.arange(2 * places)
    shuffle(rng_state, order)
    is_river = np.zeros((2, size), np.bool_)
    for k in order[:rivers]:
        is_river[k // places, 2 + 2 * (k % places)] = True
    return is_river


@device_function()
def bounds(is_river: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the numbers of the lines that bound the fields: the grid's first line, those with a river, its last.

    ``is_river`` says which lines of one direction have a river, bool[size].
    """
    lines = np.empty(is_river.sum() + 2, np.int64)
    lines[0] = 0
    k = 1
    for line in range(len(is_river)):
        if is_river[line]:
            lines[k] = line
            k += 1
    lines[k] = len(is_river) - 1
    return lines
