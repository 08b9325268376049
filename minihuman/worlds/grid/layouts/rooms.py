"""Worlds of fixed rooms: FourRooms, DoorKey, RedBlueDoors, LockedRoom, Playground."""

import numpy as np

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
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.place import (
    across,
    down,
    outer_walls,
    place,
    place_agent,
    place_agent_anywhere,
    place_anywhere,
    stand,
    wall_rect,
)
from minihuman.worlds.grid.core.state import HEIGHT, MISSION, TARGET, TASK, WIDTH, Row, make, put
from minihuman.worlds.grid.core.tasks import IN_ORDER
from minihuman.worlds.grid.layouts.objects import draw_colour, draw_kind
from minihuman.worlds.kernels import kernel, part


@kernel()
def four_rooms(row: Row, words: Words, agent_x: int, agent_y: int, goal_x: int, goal_y: int) -> None:
    """Four rooms, a gap in each wall between them. A negative ``agent_x`` or ``goal_x`` draws the place."""
    outer_walls(row)
    room_width, room_height = row[WIDTH] // 2, row[HEIGHT] // 2
    for j in range(2):
        for i in range(2):
            left, top = i * room_width, j * room_height
            right, bottom = left + room_width, top + room_height
            if i == 0:
                down(row, right, top, room_height, GREY_WALL)
                put(row, right, integer(words, top + 1, bottom), EMPTY)
            if j == 0:
                across(row, left, bottom, room_width, GREY_WALL)
                put(row, integer(words, left + 1, right), bottom, EMPTY)
    if agent_x < 0:
        place_agent_anywhere(row, words)
    else:
        put(row, agent_x, agent_y, EMPTY)
        stand(row, agent_x, agent_y, integer(words, 0, 4))
    if goal_x < 0:
        place_anywhere(row, words, GREEN_GOAL)
    else:
        put(row, goal_x, goal_y, GREEN_GOAL)


@kernel()
def door_key(row: Row, words: Words) -> None:
    """Two rooms, a locked door between them, its key on the agent's side, the goal on the other."""
    width, height = row[WIDTH], row[HEIGHT]
    outer_walls(row)
    put(row, width - 2, height - 2, GREEN_GOAL)
    split = integer(words, 2, width - 2)
    down(row, split, 0, height, GREY_WALL)
    place_agent(row, words, 0, 0, split, height)
    put(row, split, integer(words, 1, width - 2), make(row, DOOR, YELLOW, LOCKED))
    place(row, words, make(row, KEY, YELLOW, 0), 0, 0, split, height)


@kernel()
def red_blue_doors(row: Row, words: Words) -> None:
    """A room with a red door in its left wall and a blue one in its right wall."""
    size = row[HEIGHT]
    wall_rect(row, 0, 0, 2 * size, size)
    wall_rect(row, size // 2, 0, size, size)
    place_agent(row, words, size // 2, 0, size, size)
    row[TASK] = IN_ORDER
    row[TARGET], row[TARGET + 1] = size // 2, integer(words, 1, size - 1)
    put(row, row[TARGET], row[TARGET + 1], make(row, DOOR, RED, CLOSED))
    row[TARGET + 2], row[TARGET + 3] = size // 2 + size - 1, integer(words, 1, size - 1)
    put(row, row[TARGET + 2], row[TARGET + 3], make(row, DOOR, BLUE, CLOSED))


@kernel()
def locked_room(row: Row, words: Words) -> None:
    """Six rooms along a corridor: the goal in a locked one, its key in another."""
    width, height = row[WIDTH], row[HEIGHT]
    outer_walls(row)
    left_wall, right_wall = width // 2 - 2, width // 2 + 2
    down(row, left_wall, 0, height, GREY_WALL)
    down(row, right_wall, 0, height, GREY_WALL)
    room_width, room_height = left_wall + 1, height // 3 + 1
    for n in range(3):
        across(row, 0, n * (height // 3), left_wall, GREY_WALL)
        across(row, right_wall, n * (height // 3), width - right_wall, GREY_WALL)
    # rooms in pairs from the top, left then right: 2 n and 2 n + 1 at the height n
    locked = integer(words, 0, 6)
    put_inside(row, words, locked, right_wall, room_width, room_height, GREEN_GOAL)
    left_colours = np.array(SORTED_COLOURS)
    colours = np.empty(6, np.int64)
    for room in range(6):
        k = integer(words, 0, len(left_colours))
        colours[room] = left_colours[k]
        left_colours = np.concatenate((left_colours[:k], left_colours[k + 1 :]))
        door = make(row, DOOR, colours[room], LOCKED if room == locked else CLOSED)
        put(row, left_wall if room % 2 == 0 else right_wall, room // 2 * (height // 3) + 3, door)
    key_room = integer(words, 0, 6)
    while key_room == locked:
        key_room = integer(words, 0, 6)
    put_inside(row, words, key_room, right_wall, room_width, room_height, make(row, KEY, colours[locked], 0))
    place_agent(row, words, left_wall, 0, right_wall - left_wall, height)
    row[MISSION], row[MISSION + 1], row[MISSION + 2] = colours[locked], colours[key_room], colours[locked]


@part()
def put_inside(
    row: Row, words: Words, room: int, right_wall: int, room_width: int, room_height: int, code: int
) -> None:
    """Put a code into a drawn cell inside one of the six rooms of LockedRoom."""
    left = 0 if room % 2 == 0 else right_wall
    top = room // 2 * (row[HEIGHT] // 3)
    x = integer(words, left + 1, left + room_width - 1)
    y = integer(words, top + 1, top + room_height - 1)
    put(row, x, y, code)


@kernel()
def playground(row: Row, words: Words) -> None:
    """Nine rooms with doors between them and twelve objects."""
    outer_walls(row)
    room_width, room_height = row[WIDTH] // 3, row[HEIGHT] // 3
    for j in range(3):
        for i in range(3):
            left, top = i * room_width, j * room_height
            right, bottom = left + room_width, top + room_height
            if i < 2:
                down(row, right, top, room_height, GREY_WALL)
                y = integer(words, top + 1, bottom - 1)
                put(row, right, y, make(row, DOOR, draw_colour(words), CLOSED))
            if j < 2:
                across(row, left, bottom, room_width, GREY_WALL)
                x = integer(words, left + 1, right - 1)
                put(row, x, bottom, make(row, DOOR, draw_colour(words), CLOSED))
    place_agent_anywhere(row, words)
    for _ in range(12):
        kind = draw_kind(words, 3)
        place_anywhere(row, words, make(row, kind, draw_colour(words), 0))
