"""MultiRoom: a chain of rooms of drawn size and place, closed doors between them, the goal in the last."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import CLOSED, DOOR, GREEN_GOAL, SORTED_COLOURS
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.place import place, place_agent, wall_rect
from minihuman.worlds.grid.core.state import FAILED, HEIGHT, WIDTH, Row, make, put
from minihuman.worlds.kernels import kernel, part

RIGHT, BOTTOM, LEFT, TOP = range(4)  # walls of a room
SMALLEST = 4  # columns and rows, walls included
MOST_TRIED = 2_000_000  # rooms, about a second; a grid that takes more cannot hold so many
TRIES = 8  # places tried for each next room


@kernel()
def multi_room(row: Row, words: Words, fewest: int, most: int, largest: int) -> None:
    """From ``fewest`` to ``most`` rooms of up to ``largest`` columns and rows."""
    count = integer(words, fewest, most + 1)
    rooms = np.empty((0, 6), np.int64)
    left = MOST_TRIED
    while len(rooms) < count:
        door_x, door_y = integer(words, 0, row[WIDTH] - 2), integer(words, 0, row[WIDTH] - 2)
        drawn = draw_chain(row, words, count, largest, door_x, door_y)
        if len(drawn) > len(rooms):
            rooms = drawn
        left -= TRIES + len(drawn)
        if left < 0:
            row[FAILED] = 1
            return
    door_colour = -1
    for k in range(count):
        x, y, width, height, door_x, door_y = rooms[k]
        wall_rect(row, x, y, width, height)
        if k > 0:
            door_colour = draw_other_colour(words, door_colour)
            put(row, door_x, door_y, make(row, DOOR, door_colour, CLOSED))
    x, y, width, height, door_x, door_y = rooms[0]
    place_agent(row, words, x, y, width, height)
    x, y, width, height, door_x, door_y = rooms[count - 1]
    place(row, words, GREEN_GOAL, x, y, width, height)


@part()
def draw_other_colour(words: Words, colour: int) -> int:
    """Draw a colour other than ``colour`` (-1: any)."""
    k = integer(words, 0, 6 if colour < 0 else 5)
    for candidate in SORTED_COLOURS:
        if candidate != colour:
            if k == 0:
                return candidate
            k -= 1
    return -1


@part()
def draw_chain(row: Row, words: Words, count: int, largest: int, door_x: int, door_y: int) -> NDArray[np.int64]:
    """Draw rooms one behind the other until ``count`` or none fits: x, y, width, height, entry door x, y of each."""
    rooms = np.empty((count, 6), np.int64)
    placed = 0
    entry_wall = LEFT
    tries = 0
    while placed < count and tries < (1 if placed == 0 else TRIES):
        tries += 1
        wall = entry_wall
        if placed > 0:
            exit_wall = draw_other_wall(words, entry_wall)
            wall = (exit_wall + 2) % 4
            door_x, door_y = draw_door(words, rooms[placed - 1], exit_wall)
        width, height = integer(words, SMALLEST, largest + 1), integer(words, SMALLEST, largest + 1)
        x, y = door_x, door_y
        if placed > 0:
            if wall == RIGHT:
                x = door_x - width + 1
            if wall == BOTTOM:
                y = door_y - height + 1
            if wall in (RIGHT, LEFT):
                y = integer(words, door_y - height + 2, door_y)
            else:
                x = integer(words, door_x - width + 2, door_x)
        if fits(row, rooms, placed, x, y, width, height):
            rooms[placed, 0], rooms[placed, 1], rooms[placed, 2], rooms[placed, 3] = x, y, width, height
            rooms[placed, 4], rooms[placed, 5] = door_x, door_y
            placed += 1
            entry_wall = wall
            tries = 0
    return rooms[:placed]


@part()
def draw_other_wall(words: Words, wall: int) -> int:
    """Draw a wall other than ``wall``."""
    k = integer(words, 0, 3)
    return k if k < wall else k + 1


@part()
def draw_door(words: Words, room: NDArray[np.int64], wall: int) -> tuple[int, int]:
    """Draw a cell of a room's wall, corners excluded."""
    x, y, width, height = room[0], room[1], room[2], room[3]
    if wall == RIGHT:
        return x + width - 1, y + integer(words, 1, height - 1)
    if wall == BOTTOM:
        return x + integer(words, 1, width - 1), y + height - 1
    if wall == LEFT:
        return x, y + integer(words, 1, height - 1)
    return x + integer(words, 1, width - 1), y


@part()
def fits(row: Row, rooms: NDArray[np.int64], placed: int, x: int, y: int, width: int, height: int) -> bool:
    """Whether a room lies in the grid and overlaps none but the one it is entered from."""
    if x < 0 or y < 0 or x + width > row[WIDTH] or y + height >= row[HEIGHT]:
        return False
    for k in range(placed - 1):
        other_x, other_y, other_width, other_height = rooms[k, 0], rooms[k, 1], rooms[k, 2], rooms[k, 3]
        apart = x + width < other_x or other_x + other_width <= x or y + height < other_y or other_y + other_height <= y
        if not apart:
            return False
    return True
