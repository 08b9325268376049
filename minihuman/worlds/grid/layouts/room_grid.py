"""Room grids: equal rooms side by side, each wall between two with a place for one door.

The plan of a room grid is an array, one line a room (line ``j * columns + i``): a door's x and y for each wall, for
each wall whether it has a way through, and whether a locked door was put to the room. Walls: right, down, left, up.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import CLOSED, DOOR, EMPTY, LOCKED, WALL, kind_of
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.place import place_agent, stand, wall_rect
from minihuman.worlds.grid.core.state import FAILED, HEADER, HEIGHT, WIDTH, Row, X, Y, cell_at, make, put
from minihuman.worlds.grid.core.tasks import front
from minihuman.worlds.grid.layouts.objects import draw_colour
from minihuman.worlds.kernels import inlined, kernel, part

Plan = NDArray[np.int64]  # (rooms, 13)

DOOR_X, DOOR_Y, WAY, LOCKED_ROOM = 0, 4, 8, 12  # where a line holds what
NO_DOOR = -1  # a door's x where a wall has no neighbour behind it
RIGHT, DOWN, LEFT, UP = range(4)

PLACE_TRIES = 1001
CONNECT_TRIES = 5001
AGENT_TRIES = 100_000  # Minigrid never gives up; a room that needs more cannot hold the agent


@kernel()
def rooms(row: Row, words: Words, columns: int, lines: int, size: int) -> Plan:
    """Draw the walls of a room grid and the places of its doors; the agent stands in the middle room for now."""
    plan = np.full((columns * lines, 13), NO_DOOR, np.int64)
    for room in range(columns * lines):
        for k in range(WAY, plan.shape[1]):
            plan[room, k] = 0
    for j in range(lines):
        for i in range(columns):
            wall_rect(row, i * (size - 1), j * (size - 1), size, size)
    for j in range(lines):
        for i in range(columns):
            room = j * columns + i
            x, y = i * (size - 1), j * (size - 1)
            if i < columns - 1:
                link(plan, room, room + 1, RIGHT, x + size - 1, integer(words, y + 1, y + size - 1))
            if j < lines - 1:
                link(plan, room, room + columns, DOWN, integer(words, x + 1, x + size - 1), y + size - 1)
    stand(row, columns // 2 * (size - 1) + size // 2, lines // 2 * (size - 1) + size // 2, 0)
    return plan


@inlined
def link(plan: Plan, room: int, other: int, wall: int, x: int, y: int) -> None:
    """Note the place of the door between two rooms, in both."""
    plan[room, DOOR_X + wall], plan[room, DOOR_Y + wall] = x, y
    plan[other, DOOR_X + wall + 2], plan[other, DOOR_Y + wall + 2] = x, y


@inlined
def behind(room: int, wall: int, columns: int) -> int:
    """The room on the other side of a wall."""
    step = 1 if wall % 2 == 0 else columns
    return room + step if wall < 2 else room - step


@part()
def add_door(row: Row, plan: Plan, columns: int, room: int, wall: int, colour: int, locked: bool) -> None:
    """Put a door into a room's wall."""
    door = make(row, DOOR, colour, LOCKED if locked else CLOSED)
    put(row, plan[room, DOOR_X + wall], plan[room, DOOR_Y + wall], door)
    plan[room, LOCKED_ROOM] = locked
    plan[room, WAY + wall] = 1
    plan[behind(room, wall, columns), WAY + (wall + 2) % 4] = 1


@part()
def remove_wall(row: Row, plan: Plan, columns: int, size: int, room: int, wall: int) -> None:
    """Open the whole wall between two rooms, corners excluded."""
    x, y = room % columns * (size - 1), room // columns * (size - 1)
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


@part()
def add_object(row: Row, words: Words, columns: int, size: int, room: int, code: int) -> None:
    """Put a code into a drawn free cell of a room, not beside the agent."""
    left, top = room % columns * (size - 1), room // columns * (size - 1)
    for _ in range(PLACE_TRIES):
        x = integer(words, left, min(left + size, row[WIDTH]))
        y = integer(words, top, min(top + size, row[HEIGHT]))
        if row[HEADER + x * row[HEIGHT] + y] == EMPTY and abs(row[X] - x) + abs(row[Y] - y) >= 2:
            put(row, x, y, code)
            return
    row[FAILED] = 1


@part()
def place_in_room(row: Row, words: Words, columns: int, size: int, room: int) -> None:
    """Put the agent into a drawn free cell of a room, not facing anything but a wall."""
    x, y = room % columns * (size - 1), room // columns * (size - 1)
    for _ in range(AGENT_TRIES):
        place_agent(row, words, x, y, size, size)
        ahead_x, ahead_y = front(row)
        kind = kind_of(cell_at(row, ahead_x, ahead_y))
        if row[FAILED] or kind == EMPTY or kind == WALL:
            return
    row[FAILED] = 1


@part()
def reachable(plan: Plan, columns: int, start: int) -> int:
    """How many rooms can be reached through ways, locked doors included."""
    seen = np.zeros(len(plan), np.bool_)
    stack = np.empty(4 * len(plan) + 1, np.int64)
    stack[0], waiting = start, 1
    while waiting > 0:
        waiting -= 1
        room = stack[waiting]
        if seen[room]:
            continue
        seen[room] = True
        for wall in range(4):
            if plan[room, WAY + wall]:
                stack[waiting] = behind(room, wall, columns)
                waiting += 1
    return seen.sum()


@part()
def connect_all(row: Row, words: Words, plan: Plan, columns: int, size: int) -> None:
    """Add closed doors at drawn walls until every room can be reached from the agent's; locked rooms get none."""
    start = row[Y] // (size - 1) * columns + row[X] // (size - 1)
    lines = len(plan) // columns
    for _ in range(CONNECT_TRIES):
        if reachable(plan, columns, start) == len(plan):
            return
        i, j, wall = integer(words, 0, columns), integer(words, 0, lines), integer(words, 0, 4)
        room = j * columns + i
        if plan[room, DOOR_X + wall] == NO_DOOR or plan[room, WAY + wall]:
            continue
        if plan[room, LOCKED_ROOM] or plan[behind(room, wall, columns), LOCKED_ROOM]:
            continue
        add_door(row, plan, columns, room, wall, draw_colour(words), False)
    row[FAILED] = 1
