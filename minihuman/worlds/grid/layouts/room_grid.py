"""Layouts on a grid of equal rooms, with one possible door in each wall between two rooms.

They are Unlock, UnlockPickup, BlockedUnlockPickup, KeyCorridor and ObstructedMaze; BabyAI's levels use the same rooms.
The plan is an array with one line per room (line `j * columns + i`): a door's x and y for each wall, whether each wall
has a passage, whether the room has a locked door, and two numbers for `reachable`. The order of the walls is right,
down, left, up.
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
    GREY,
    KEY,
    LOCKED,
    SORTED_COLOURS,
    WALL,
    identity_of,
    kind_of,
)
from minihuman.worlds.grid.core.placement import place_agent, stand, wall_rect
from minihuman.worlds.grid.core.rewards import OPEN_DOOR, PICK, cell_in_front
from minihuman.worlds.grid.core.state import (
    FAILED,
    HEADER,
    HEIGHT,
    MISSION,
    TARGET,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    cell_at,
    contents_index,
    make,
    put,
)
from minihuman.worlds.grid.layouts.single_rooms import draw_colour
from minihuman.worlds.kernels import device_function, inline, kernel
from minihuman.worlds.rng import RngState, integer

Plan = NDArray[np.int64]  # (rooms, 15)

# where a line holds what
DOOR_X = 0
DOOR_Y = 4
WAY = 8
LOCKED_ROOM = 12
SEEN = 13
QUEUE = 14
NO_DOOR = -1  # a door's x where a wall has no neighbour behind it
RIGHT, DOWN, LEFT, UP = range(4)

PLACE_TRIES = 1001
CONNECT_TRIES = 5001
AGENT_TRIES = 100_000  # Minigrid never gives up; a room that needs more cannot hold the agent


@kernel("(int32[::1], uint64[::1], int64, int64, int64)")
def rooms(row: Row, rng_state: RngState, columns: int, lines: int, size: int) -> Plan:
    """Put the walls of a room grid and draw the places of its doors; return the plan.

    The grid has ``lines`` lines of ``columns`` rooms, each with ``size`` cells on a side, including walls. The agent
    stands in the middle room until it is placed.
    """
    plan = np.full((columns * lines, 15), NO_DOOR, np.int64)
    for room in range(columns * lines):
        for k in range(WAY, plan.shape[1]):
            plan[room, k] = 0
    for j in range(lines):
        for i in range(columns):
            wall_rect(row, i * (size - 1), j * (size - 1), size, size)
    for j in range(lines):
        for i in range(columns):
            room = j * columns + i
            x = i * (size - 1)
            y = j * (size - 1)
            if i < columns - 1:
                link(plan, room, room + 1, RIGHT, x + size - 1, integer(rng_state, y + 1, y + size - 1))
            if j < lines - 1:
                link(plan, room, room + columns, DOWN, integer(rng_state, x + 1, x + size - 1), y + size - 1)
    stand(row, columns // 2 * (size - 1) + size // 2, lines // 2 * (size - 1) + size // 2, 0)
    return plan


@inline
def link(plan: Plan, room: int, other: int, wall: int, x: int, y: int) -> None:
    """Record the cell (x, y) of the possible door between two rooms in the plan's lines of both.

    ``wall`` is the wall of the first room, RIGHT or DOWN.
    """
    plan[room, DOOR_X + wall] = x
    plan[room, DOOR_Y + wall] = y
    plan[other, DOOR_X + wall + 2] = x
    plan[other, DOOR_Y + wall + 2] = y


@inline
def behind(room: int, wall: int, columns: int) -> int:
    """Return the number of the room on the other side of a room's wall, in a grid with ``columns`` rooms in a line."""
    step = 1 if wall % 2 == 0 else columns  # right and left, or down and up
    return room + step if wall < 2 else room - step


@device_function()
def add_door(row: Row, plan: Plan, columns: int, room: int, wall: int, colour: int, locked: bool) -> None:
    """Put a new door into a wall of a room, at the place that the plan has for it, and record it in the plan.

    ``columns`` is the number of rooms in a line. A door that is not ``locked`` is closed.
    """
    door = make(row, DOOR, colour, LOCKED if locked else CLOSED)
    put(row, plan[room, DOOR_X + wall], plan[room, DOOR_Y + wall], door)
    plan[room, LOCKED_ROOM] = locked
    plan[room, WAY + wall] = 1
    plan[behind(room, wall, columns), WAY + (wall + 2) % 4] = 1


@device_function()
def remove_wall(row: Row, plan: Plan, columns: int, size: int, room: int, wall: int) -> None:
    """Remove a wall of a room, except its corners, and record the passage to the room behind it in the plan.

    ``columns`` is the number of rooms in a line, and ``size`` the number of cells on a side of a room with its walls.
    """
    x = room % columns * (size - 1)
    y = room // columns * (size - 1)
    for k in range(1, size - 1):
        if wall == RIGHT:
            put(row, x + size - 1, y + k, EMPTY)
        elif wall == DOWN:
            put(row, x + k, y + size - 1, EMPTY)
        elif wall == LEFT:
            put(row, x, y + k, EMPTY)
        else:
            put(row, x + k, y, EMPTY)
    plan[room, WAY + wall] = 1
    plan[behind(room, wall, columns), WAY + (wall + 2) % 4] = 1


@device_function()
def add_object(row: Row, rng_state: RngState, columns: int, size: int, room: int, code: int) -> None:
    """Put a code into a random free cell of a room, not next to the agent; mark the row as FAILED if none is found.

    ``columns`` is the number of rooms in a line, and ``size`` the number of cells on a side of a room with its walls.
    """
    left = room % columns * (size - 1)
    top = room // columns * (size - 1)
    for _ in range(PLACE_TRIES):
        x = integer(rng_state, left, min(left + size, row[WIDTH]))
        y = integer(rng_state, top, min(top + size, row[HEIGHT]))
        if row[HEADER + x * row[HEIGHT] + y] == EMPTY and abs(row[X] - x) + abs(row[Y] - y) >= 2:
            put(row, x, y, code)
            return
    row[FAILED] = 1


@device_function()
def place_in_room(row: Row, rng_state: RngState, columns: int, size: int, room: int) -> None:
    """Put the agent into a random free cell of a room, facing an empty cell or a wall.

    If none is found, mark the row as FAILED. ``columns`` and ``size`` are as in `add_object`.
    """
    x = room % columns * (size - 1)
    y = room // columns * (size - 1)
    for _ in range(AGENT_TRIES):
        place_agent(row, rng_state, x, y, size, size)
        ahead_x, ahead_y = cell_in_front(row)
        kind = kind_of(cell_at(row, ahead_x, ahead_y))
        if row[FAILED] or kind == EMPTY or kind == WALL:
            return
    row[FAILED] = 1


@device_function()
def reachable(plan: Plan, columns: int, start: int) -> int:
    """Return the number of rooms that can be reached from the room ``start`` through passages, itself included.

    Locked doors count as passages. ``columns`` is the number of rooms in a line.
    """
    for room in range(len(plan)):
        plan[room, SEEN] = 0
    plan[start, SEEN] = 1
    plan[0, QUEUE] = start
    count = 1
    at = 0
    while at < count:
        room = plan[at, QUEUE]
        at += 1
        for wall in range(4):
            if plan[room, WAY + wall]:
                other = behind(room, wall, columns)
                plan[count % len(plan), QUEUE] = other  # it counts only if `count` grows
                count += plan[other, SEEN] == 0
                plan[other, SEEN] = 1
    return count


@device_function()
def connect_all(row: Row, rng_state: RngState, plan: Plan, columns: int, size: int) -> None:
    """Add closed doors in random walls until every room can be reached from the agent's. Locked rooms get none.

    If a room still cannot be reached after `CONNECT_TRIES` draws, mark the row as FAILED.
    """
    start = row[Y] // (size - 1) * columns + row[X] // (size - 1)
    lines = len(plan) // columns
    for _ in range(CONNECT_TRIES):
        if reachable(plan, columns, start) == len(plan):
            return
        i = integer(rng_state, 0, columns)
        j = integer(rng_state, 0, lines)
        wall = integer(rng_state, 0, 4)
        room = j * columns + i
        if plan[room, DOOR_X + wall] == NO_DOOR or plan[room, WAY + wall]:
            continue
        if plan[room, LOCKED_ROOM] or plan[behind(room, wall, columns), LOCKED_ROOM]:
            continue
        add_door(row, plan, columns, room, wall, draw_colour(rng_state), False)
    row[FAILED] = 1


SIZE = 6  # of the rooms of all these worlds but KeyCorridor


@device_function()
def pick_task(row: Row, code: int, colour: int, kind: int) -> None:
    """Set the task of picking up the object with the code ``code``, and the mission's ``colour`` and ``kind``."""
    row[TASK] = PICK
    row[TARGET] = identity_of(code)
    row[MISSION] = colour
    row[MISSION + 1] = kind


@kernel("(int32[::1], uint64[::1])")
def unlock(row: Row, rng_state: RngState) -> None:
    """Lay out two rooms with a locked door between them, and its key in the agent's room."""
    plan = rooms(row, rng_state, 2, 1, SIZE)
    colour = draw_colour(rng_state)
    add_door(row, plan, 2, 0, RIGHT, colour, True)
    add_object(row, rng_state, 2, SIZE, 0, make(row, KEY, colour, 0))
    place_in_room(row, rng_state, 2, SIZE, 0)
    row[TASK] = OPEN_DOOR
    row[TARGET] = plan[0, DOOR_X + RIGHT]
    row[TARGET + 1] = plan[0, DOOR_Y + RIGHT]


@kernel("(int32[::1], uint64[::1], int64)")
def unlock_pickup(row: Row, rng_state: RngState, blocked: int) -> None:
    """Lay out a box behind a locked door, with the key in the agent's room.

    With ``blocked``, a ball lies in front of the door.
    """
    plan = rooms(row, rng_state, 2, 1, SIZE)
    box_colour = draw_colour(rng_state)
    box = make(row, BOX, box_colour, 0)
    add_object(row, rng_state, 2, SIZE, 1, box)
    colour = draw_colour(rng_state)
    add_door(row, plan, 2, 0, RIGHT, colour, True)
    if blocked:
        ball = make(row, BALL, draw_colour(rng_state), 0)
        put(row, plan[0, DOOR_X + RIGHT] - 1, plan[0, DOOR_Y + RIGHT], ball)
    add_object(row, rng_state, 2, SIZE, 0, make(row, KEY, colour, 0))
    place_in_room(row, rng_state, 2, SIZE, 0)
    pick_task(row, box, box_colour, BOX)


@kernel("(int32[::1], uint64[::1], int64, int64, int64)")
def key_corridor(row: Row, rng_state: RngState, lines: int, size: int, kind: int) -> None:
    """Lay out a corridor between rooms, with an object behind a locked door on the right and the key on the left.

    Args:
        row: the row of state.
        rng_state: the random stream.
        lines: the number of rooms on each side of the corridor.
        size: the number of cells on a side of a room, including its walls.
        kind: the kind of the object.
    """
    plan = rooms(row, rng_state, 3, lines, size)
    for j in range(1, lines):
        remove_wall(row, plan, 3, size, 3 * j + 1, UP)
    line = integer(rng_state, 0, lines)
    door_colour = draw_colour(rng_state)
    add_door(row, plan, 3, 3 * line + 2, 2, door_colour, True)
    colour = draw_colour(rng_state)
    target = make(row, kind, colour, 0)
    add_object(row, rng_state, 3, size, 3 * line + 2, target)
    key_line = integer(rng_state, 0, lines)
    add_object(row, rng_state, 3, size, 3 * key_line, make(row, KEY, door_colour, 0))
    place_in_room(row, rng_state, 3, size, 3 * (lines // 2) + 1)
    connect_all(row, rng_state, plan, 3, size)
    pick_task(row, target, colour, kind)


@device_function()
def draw_door_colours(rng_state: RngState) -> NDArray[np.int64]:
    """Return all six colours in a random order, int64[6]."""
    left = np.array(SORTED_COLOURS)
    shuffled = np.empty(6, np.int64)
    for k in range(6):
        place = integer(rng_state, 0, len(left))
        shuffled[k] = left[place]
        left = np.concatenate((left[:place], left[place + 1 :]))
    return shuffled


@device_function()
def add_barrier(row: Row, plan: Plan, columns: int, room: int, wall: int, colour: int, blocked: int) -> None:
    """Put a locked door into a wall of a room; if ``blocked`` is 1, also a green ball in front of it, in this room."""
    add_door(row, plan, columns, room, wall, colour, True)
    if blocked:
        # one step back from the door into the room: the opposite of `cells.ahead` in the direction of the wall
        x = plan[room, DOOR_X + wall] - (1 - wall) * (1 - wall % 2)
        y = plan[room, DOOR_Y + wall] - (2 - wall) * (wall % 2)
        put(row, x, y, make(row, BALL, GREEN, 0))


@device_function()
def add_key(row: Row, rng_state: RngState, columns: int, room: int, colour: int, boxed: int) -> None:
    """Put a key into a room; if ``boxed`` is 1, inside a grey box. ``columns`` is the number of rooms in a line."""
    code = make(row, KEY, colour, 0)
    if boxed:
        key = code
        code = make(row, BOX, GREY, 0)
        row[contents_index(row, identity_of(code))] = key
    add_object(row, rng_state, columns, SIZE, room, code)


@kernel("(int32[::1], uint64[::1], int64, int64)")
def obstructed_pair(row: Row, rng_state: RngState, boxed: int, blocked: int) -> None:
    """Lay out two rooms with a blue ball behind a locked door, and the key in the agent's room.

    If ``boxed`` is 1, the key is in a box; if ``blocked`` is 1, a ball lies in front of the door.
    """
    plan = rooms(row, rng_state, 2, 1, SIZE)
    colours = draw_door_colours(rng_state)
    add_barrier(row, plan, 2, 0, RIGHT, colours[0], blocked)
    add_key(row, rng_state, 2, 0, colours[0], boxed)
    target = make(row, BALL, BLUE, 0)
    add_object(row, rng_state, 2, SIZE, 1, target)
    place_in_room(row, rng_state, 2, SIZE, 0)
    pick_task(row, target, BLUE, BALL)


@kernel("(int32[::1], uint64[::1], int64, int64, int64, int64, int64)")
def obstructed_maze(
    row: Row, rng_state: RngState, start_room: int, boxed: int, blocked: int, quarters: int, keys_last: int
) -> None:
    """Lay out nine rooms with a blue ball in a corner room, and locked doors between side rooms and corner rooms.

    Args:
        row: the row of state.
        rng_state: the random stream.
        start_room: the number of the room in which the agent starts, line by line.
        boxed: 1 if the keys are in boxes, else 0.
        blocked: 1 if a ball lies in front of each locked door, else 0.
        quarters: the number of side rooms that are open, from the right one clockwise, each with two locked doors.
        keys_last: 1 (version 1 of the worlds) to place the keys of a side after its doors and balls, so that no ball
            is put on a key; else 0.
    """
    plan = rooms(row, rng_state, 3, 3, SIZE)
    colours = draw_door_colours(rng_state)
    sides = (5, 7, 3, 1)  # right, below, left and above the middle room, 4
    for i in range(quarters):
        add_door(row, plan, 3, 4, i, colours[i], False)
        for k in (-1, 1):
            colour = colours[(i + k) % 6]
            add_barrier(row, plan, 3, sides[i], (i + k) % 4, colour, blocked)
            if not keys_last:
                add_key(row, rng_state, 3, sides[i], colour, boxed)
        if keys_last:
            for k in (-1, 1):
                add_key(row, rng_state, 3, sides[i], colours[(i + k) % 6], boxed)
    corners = (2, 8, 6, 0)
    corner = corners[integer(rng_state, 0, quarters)]
    target = make(row, BALL, BLUE, 0)
    add_object(row, rng_state, 3, SIZE, corner, target)
    place_in_room(row, rng_state, 3, SIZE, start_room)
    pick_task(row, target, BLUE, BALL)
