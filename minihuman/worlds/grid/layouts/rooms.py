"""Layouts of several rooms: FourRooms, DoorKey, RedBlueDoors, LockedRoom, Playground and MultiRoom.

MultiRoom is a chain of rooms of random size and place with closed doors between them.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    BLUE,
    CLOSED,
    DOOR,
    EMPTY,
    GREEN_GOAL,
    GREY_WALL,
    KEY,
    LOCKED,
    RED,
    SORTED_COLOURS,
    YELLOW,
)
from minihuman.worlds.grid.core.placement import (
    outer_walls,
    place,
    place_agent,
    place_agent_anywhere,
    place_anywhere,
    stand,
    wall_across,
    wall_down,
    wall_rect,
)
from minihuman.worlds.grid.core.rewards import IN_ORDER
from minihuman.worlds.grid.core.state import FAILED, HEIGHT, MISSION, TARGET, TASK, WIDTH, Row, make, put
from minihuman.worlds.grid.layouts.single_rooms import draw_colour, draw_kind
from minihuman.worlds.kernels import device_function, kernel
from minihuman.worlds.rng import RngState, integer


@kernel("(int32[::1], uint64[::1], int64, int64, int64, int64)")
def four_rooms(row: Row, rng_state: RngState, agent_x: int, agent_y: int, goal_x: int, goal_y: int) -> None:
    """Lay out four rooms with a gap in each wall between them.

    If ``agent_x`` or ``goal_x`` is negative, the place of the agent or the goal is drawn.
    """
    outer_walls(row)
    room_width = row[WIDTH] // 2
    room_height = row[HEIGHT] // 2
    for j in range(2):
        for i in range(2):
            left = i * room_width
            top = j * room_height
            right = left + room_width
            bottom = top + room_height
            if i == 0:
                wall_down(row, right, top, room_height, GREY_WALL)
                put(row, right, integer(rng_state, top + 1, bottom), EMPTY)
            if j == 0:
                wall_across(row, left, bottom, room_width, GREY_WALL)
                put(row, integer(rng_state, left + 1, right), bottom, EMPTY)
    if agent_x < 0:
        place_agent_anywhere(row, rng_state)
    else:
        put(row, agent_x, agent_y, EMPTY)
        stand(row, agent_x, agent_y, integer(rng_state, 0, 4))
    if goal_x < 0:
        place_anywhere(row, rng_state, GREEN_GOAL)
    else:
        put(row, goal_x, goal_y, GREEN_GOAL)


@kernel("(int32[::1], uint64[::1])")
def door_key(row: Row, rng_state: RngState) -> None:
    """Lay out two rooms with a locked door between them, the key on the agent's side and the goal on the other."""
    width = row[WIDTH]
    height = row[HEIGHT]
    outer_walls(row)
    put(row, width - 2, height - 2, GREEN_GOAL)
    split = integer(rng_state, 2, width - 2)
    wall_down(row, split, 0, height, GREY_WALL)
    place_agent(row, rng_state, 0, 0, split, height)
    put(row, split, integer(rng_state, 1, width - 2), make(row, DOOR, YELLOW, LOCKED))
    place(row, rng_state, make(row, KEY, YELLOW, 0), 0, 0, split, height)


@kernel("(int32[::1], uint64[::1])")
def red_blue_doors(row: Row, rng_state: RngState) -> None:
    """Lay out a room with a red door in its left wall and a blue one in its right wall, to be opened in this order."""
    size = row[HEIGHT]
    wall_rect(row, 0, 0, 2 * size, size)
    wall_rect(row, size // 2, 0, size, size)
    place_agent(row, rng_state, size // 2, 0, size, size)
    row[TASK] = IN_ORDER
    row[TARGET] = size // 2
    row[TARGET + 1] = integer(rng_state, 1, size - 1)
    put(row, row[TARGET], row[TARGET + 1], make(row, DOOR, RED, CLOSED))
    row[TARGET + 2] = size // 2 + size - 1
    row[TARGET + 3] = integer(rng_state, 1, size - 1)
    put(row, row[TARGET + 2], row[TARGET + 3], make(row, DOOR, BLUE, CLOSED))


@kernel("(int32[::1], uint64[::1])")
def locked_room(row: Row, rng_state: RngState) -> None:
    """Lay out six rooms along a corridor, with the goal in a locked room and its key in another."""
    width = row[WIDTH]
    height = row[HEIGHT]
    outer_walls(row)
    left_wall = width // 2 - 2
    right_wall = width // 2 + 2
    wall_down(row, left_wall, 0, height, GREY_WALL)
    wall_down(row, right_wall, 0, height, GREY_WALL)
    room_width = left_wall + 1
    room_height = height // 3 + 1
    for n in range(3):
        wall_across(row, 0, n * (height // 3), left_wall, GREY_WALL)
        wall_across(row, right_wall, n * (height // 3), width - right_wall, GREY_WALL)
    # rooms in pairs from the top, left then right: 2 n and 2 n + 1 at the height n
    locked = integer(rng_state, 0, 6)
    put_inside(row, rng_state, locked, right_wall, room_width, room_height, GREEN_GOAL)
    left_colours = np.array(SORTED_COLOURS)
    colours = np.empty(6, np.int64)
    for room in range(6):
        k = integer(rng_state, 0, len(left_colours))
        colours[room] = left_colours[k]
        left_colours = np.concatenate((left_colours[:k], left_colours[k + 1 :]))
        door = make(row, DOOR, colours[room], LOCKED if room == locked else CLOSED)
        put(row, left_wall if room % 2 == 0 else right_wall, room // 2 * (height // 3) + 3, door)
    key_room = integer(rng_state, 0, 6)
    while key_room == locked:
        key_room = integer(rng_state, 0, 6)
    put_inside(row, rng_state, key_room, right_wall, room_width, room_height, make(row, KEY, colours[locked], 0))
    place_agent(row, rng_state, left_wall, 0, right_wall - left_wall, height)
    row[MISSION] = colours[locked]
    row[MISSION + 1] = colours[key_room]
    row[MISSION + 2] = colours[locked]


@device_function()
def put_inside(
    row: Row, rng_state: RngState, room: int, right_wall: int, room_width: int, room_height: int, code: int
) -> None:
    """Put a code into a random cell inside one of the six rooms of LockedRoom.

    Args:
        row: the row of state.
        rng_state: the random stream.
        room: the number of the room: 2 n on the left and 2 n + 1 on the right, at the height n from the top.
        right_wall: the column of the corridor's right wall.
        room_width: the number of columns of a room, including its walls.
        room_height: the number of rows of a room, including its walls.
        code: the code of the object or the goal.
    """
    left = 0 if room % 2 == 0 else right_wall
    top = room // 2 * (row[HEIGHT] // 3)
    x = integer(rng_state, left + 1, left + room_width - 1)
    y = integer(rng_state, top + 1, top + room_height - 1)
    put(row, x, y, code)


@kernel("(int32[::1], uint64[::1])")
def playground(row: Row, rng_state: RngState) -> None:
    """Lay out nine rooms with doors between them and twelve objects."""
    outer_walls(row)
    room_width = row[WIDTH] // 3
    room_height = row[HEIGHT] // 3
    for j in range(3):
        for i in range(3):
            left = i * room_width
            top = j * room_height
            right = left + room_width
            bottom = top + room_height
            if i < 2:
                wall_down(row, right, top, room_height, GREY_WALL)
                y = integer(rng_state, top + 1, bottom - 1)
                put(row, right, y, make(row, DOOR, draw_colour(rng_state), CLOSED))
            if j < 2:
                wall_across(row, left, bottom, room_width, GREY_WALL)
                x = integer(rng_state, left + 1, right - 1)
                put(row, x, bottom, make(row, DOOR, draw_colour(rng_state), CLOSED))
    place_agent_anywhere(row, rng_state)
    for _ in range(12):
        kind = draw_kind(rng_state, 3)
        place_anywhere(row, rng_state, make(row, kind, draw_colour(rng_state), 0))


RIGHT, BOTTOM, LEFT, TOP = range(4)  # walls of a room
SMALLEST = 4  # columns and rows, walls included
MOST_TRIED = 2_000_000  # rooms, about a second; a grid that takes more cannot hold so many
TRIES = 8  # places tried for each next room


@kernel("(int32[::1], uint64[::1], int64, int64, int64)")
def multi_room(row: Row, rng_state: RngState, fewest: int, most: int, largest: int) -> None:
    """Lay out a chain of ``fewest`` to ``most`` rooms, each of up to ``largest`` columns and rows.

    If no such chain is found, mark the row as FAILED.
    """
    count = integer(rng_state, fewest, most + 1)
    rooms = np.empty((0, 6), np.int64)
    left = MOST_TRIED
    while len(rooms) < count:
        door_x = integer(rng_state, 0, row[WIDTH] - 2)
        door_y = integer(rng_state, 0, row[WIDTH] - 2)
        chain = draw_chain(row, rng_state, count, largest, door_x, door_y)
        if len(chain) > len(rooms):
            rooms = chain
        left -= TRIES + len(chain)
        if left < 0:
            row[FAILED] = 1
            return
    door_colour = -1
    for k in range(count):
        x, y, width, height, door_x, door_y = rooms[k]
        wall_rect(row, x, y, width, height)
        if k > 0:
            door_colour = draw_other_colour(rng_state, door_colour)
            put(row, door_x, door_y, make(row, DOOR, door_colour, CLOSED))
    x, y, width, height, door_x, door_y = rooms[0]
    place_agent(row, rng_state, x, y, width, height)
    x, y, width, height, door_x, door_y = rooms[count - 1]
    place(row, rng_state, GREEN_GOAL, x, y, width, height)


@device_function()
def draw_other_colour(rng_state: RngState, colour: int) -> int:
    """Draw one of the six colours other than ``colour``; for -1, any of them."""
    k = integer(rng_state, 0, 6 if colour < 0 else 5)
    for candidate in SORTED_COLOURS:
        if candidate != colour:
            if k == 0:
                return candidate
            k -= 1
    return -1


@device_function()
def draw_chain(row: Row, rng_state: RngState, count: int, largest: int, door_x: int, door_y: int) -> NDArray[np.int64]:
    """Draw rooms of up to ``largest`` cells a side, each next to the one before, until ``count`` exist or none fits.

    The first begins at (door_x, door_y). Return each room's x, y, width, height and entry door (x, y), int64[rooms, 6].
    """
    rooms = np.empty((count, 6), np.int64)
    placed = 0
    entry_wall = LEFT
    tries = 0
    while placed < count and tries < (1 if placed == 0 else TRIES):
        tries += 1
        wall = entry_wall
        if placed > 0:
            exit_wall = draw_other_wall(rng_state, entry_wall)
            wall = (exit_wall + 2) % 4
            door_x, door_y = draw_door(rng_state, rooms[placed - 1], exit_wall)
        width = integer(rng_state, SMALLEST, largest + 1)
        height = integer(rng_state, SMALLEST, largest + 1)
        x = door_x
        y = door_y
        if placed > 0:
            if wall == RIGHT:
                x = door_x - width + 1
            if wall == BOTTOM:
                y = door_y - height + 1
            if wall in (RIGHT, LEFT):
                y = integer(rng_state, door_y - height + 2, door_y)
            else:
                x = integer(rng_state, door_x - width + 2, door_x)
        if fits(row, rooms, placed, x, y, width, height):
            rooms[placed, 0] = x
            rooms[placed, 1] = y
            rooms[placed, 2] = width
            rooms[placed, 3] = height
            rooms[placed, 4] = door_x
            rooms[placed, 5] = door_y
            placed += 1
            entry_wall = wall
            tries = 0
    return rooms[:placed]


@device_function()
def draw_other_wall(rng_state: RngState, wall: int) -> int:
    """Draw one of the four walls of a room other than ``wall``: RIGHT, BOTTOM, LEFT or TOP."""
    k = integer(rng_state, 0, 3)
    return k if k < wall else k + 1


@device_function()
def draw_door(rng_state: RngState, room: NDArray[np.int64], wall: int) -> tuple[int, int]:
    """Draw a cell of a room's wall that is not a corner; ``room`` begins with its x, y, width and height."""
    x = room[0]
    y = room[1]
    width = room[2]
    height = room[3]
    if wall == RIGHT:
        return x + width - 1, y + integer(rng_state, 1, height - 1)
    if wall == BOTTOM:
        return x + integer(rng_state, 1, width - 1), y + height - 1
    if wall == LEFT:
        return x, y + integer(rng_state, 1, height - 1)
    return x + integer(rng_state, 1, width - 1), y


@device_function()
def fits(row: Row, rooms: NDArray[np.int64], placed: int, x: int, y: int, width: int, height: int) -> bool:
    """Return whether a room fits into the grid with the ``placed`` rooms, apart from the last, to which it is joined.

    As in Minigrid, it does not fit if it overlaps one of them, ends right at the left or upper side of one, or reaches
    the last row of the grid.
    """
    if x < 0 or y < 0 or x + width > row[WIDTH] or y + height >= row[HEIGHT]:
        return False
    for k in range(placed - 1):
        other_x = rooms[k, 0]
        other_y = rooms[k, 1]
        other_width = rooms[k, 2]
        other_height = rooms[k, 3]
        apart = x + width < other_x or other_x + other_width <= x or y + height < other_y or other_y + other_height <= y
        if not apart:
            return False
    return True
