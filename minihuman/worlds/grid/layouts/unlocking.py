"""Worlds of room grids with locked doors: Unlock, UnlockPickup, BlockedUnlockPickup, KeyCorridor, ObstructedMaze."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import BALL, BLUE, BOX, GREEN, GREY, KEY, SORTED_COLOURS, identity_of
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.state import MISSION, TARGET, TASK, Row, contents_index, make, put
from minihuman.worlds.grid.core.tasks import OPEN_DOOR, PICK
from minihuman.worlds.grid.layouts.objects import draw_colour
from minihuman.worlds.grid.layouts.room_grid import (
    DOOR_X,
    DOOR_Y,
    RIGHT,
    UP,
    Plan,
    add_door,
    add_object,
    connect_all,
    place_in_room,
    remove_wall,
    rooms,
)
from minihuman.worlds.kernels import kernel, part

SIZE = 6  # of the rooms of all these worlds but KeyCorridor


@part()
def pick_task(row: Row, code: int, colour: int, kind: int) -> None:
    """Success is to pick this object up."""
    row[TASK] = PICK
    row[TARGET] = identity_of(code)
    row[MISSION], row[MISSION + 1] = colour, kind


@kernel()
def unlock(row: Row, words: Words) -> None:
    """Two rooms, a locked door between them, its key with the agent."""
    plan = rooms(row, words, 2, 1, SIZE)
    colour = draw_colour(words)
    add_door(row, plan, 2, 0, RIGHT, colour, True)
    add_object(row, words, 2, SIZE, 0, make(row, KEY, colour, 0))
    place_in_room(row, words, 2, SIZE, 0)
    row[TASK] = OPEN_DOOR
    row[TARGET], row[TARGET + 1] = plan[0, DOOR_X + RIGHT], plan[0, DOOR_Y + RIGHT]


@kernel()
def unlock_pickup(row: Row, words: Words, blocked: int) -> None:
    """A box behind a locked door, whose key lies with the agent; a ball before the door if ``blocked``."""
    plan = rooms(row, words, 2, 1, SIZE)
    box_colour = draw_colour(words)
    box = make(row, BOX, box_colour, 0)
    add_object(row, words, 2, SIZE, 1, box)
    colour = draw_colour(words)
    add_door(row, plan, 2, 0, RIGHT, colour, True)
    if blocked:
        ball = make(row, BALL, draw_colour(words), 0)
        put(row, plan[0, DOOR_X + RIGHT] - 1, plan[0, DOOR_Y + RIGHT], ball)
    add_object(row, words, 2, SIZE, 0, make(row, KEY, colour, 0))
    place_in_room(row, words, 2, SIZE, 0)
    pick_task(row, box, box_colour, BOX)


@kernel()
def key_corridor(row: Row, words: Words, lines: int, size: int, kind: int) -> None:
    """A corridor between rooms: an object behind a locked door on the right, its key somewhere on the left."""
    plan = rooms(row, words, 3, lines, size)
    for j in range(1, lines):
        remove_wall(row, plan, 3, size, 3 * j + 1, UP)
    line = integer(words, 0, lines)
    door_colour = draw_colour(words)
    add_door(row, plan, 3, 3 * line + 2, 2, door_colour, True)
    colour = draw_colour(words)
    target = make(row, kind, colour, 0)
    add_object(row, words, 3, size, 3 * line + 2, target)
    key_line = integer(words, 0, lines)
    add_object(row, words, 3, size, 3 * key_line, make(row, KEY, door_colour, 0))
    place_in_room(row, words, 3, size, 3 * (lines // 2) + 1)
    connect_all(row, words, plan, 3, size)
    pick_task(row, target, colour, kind)


@part()
def draw_door_colours(words: Words) -> NDArray[np.int64]:
    """All six colours in a drawn order."""
    left = np.array(SORTED_COLOURS)
    drawn = np.empty(6, np.int64)
    for k in range(6):
        place = integer(words, 0, len(left))
        drawn[k] = left[place]
        left = np.concatenate((left[:place], left[place + 1 :]))
    return drawn


@part()
def add_barrier(row: Row, plan: Plan, columns: int, room: int, wall: int, colour: int, blocked: int) -> None:
    """A locked door, a ball before it if ``blocked``."""
    add_door(row, plan, columns, room, wall, colour, True)
    if blocked:
        x = plan[room, DOOR_X + wall] - (1 - wall) * (1 - wall % 2)
        y = plan[room, DOOR_Y + wall] - (2 - wall) * (wall % 2)
        put(row, x, y, make(row, BALL, GREEN, 0))


@part()
def add_key(row: Row, words: Words, columns: int, room: int, colour: int, boxed: int) -> None:
    """A key, inside a box if ``boxed``."""
    code = make(row, KEY, colour, 0)
    if boxed:
        key = code
        code = make(row, BOX, GREY, 0)
        row[contents_index(row, identity_of(code))] = key
    add_object(row, words, columns, SIZE, room, code)


@kernel()
def obstructed_pair(row: Row, words: Words, boxed: int, blocked: int) -> None:
    """Two rooms: a blue ball behind a locked door."""
    plan = rooms(row, words, 2, 1, SIZE)
    colours = draw_door_colours(words)
    add_barrier(row, plan, 2, 0, RIGHT, colours[0], blocked)
    add_key(row, words, 2, 0, colours[0], boxed)
    target = make(row, BALL, BLUE, 0)
    add_object(row, words, 2, SIZE, 1, target)
    place_in_room(row, words, 2, SIZE, 0)
    pick_task(row, target, BLUE, BALL)


@kernel()
def obstructed_maze(
    row: Row, words: Words, start_room: int, boxed: int, blocked: int, quarters: int, keys_last: int
) -> None:
    """Nine rooms: a blue ball in a corner, locked doors to all corners of the first ``quarters`` sides.

    With ``keys_last`` (the worlds' version 1) a side's keys come after its doors and balls, so that no ball is put on
    a key.
    """
    plan = rooms(row, words, 3, 3, SIZE)
    colours = draw_door_colours(words)
    sides = (5, 7, 3, 1)  # right, below, left and above the middle room, 4
    for i in range(quarters):
        add_door(row, plan, 3, 4, i, colours[i], False)
        for k in (-1, 1):
            colour = colours[(i + k) % 6]
            add_barrier(row, plan, 3, sides[i], (i + k) % 4, colour, blocked)
            if not keys_last:
                add_key(row, words, 3, sides[i], colour, boxed)
        if keys_last:
            for k in (-1, 1):
                add_key(row, words, 3, sides[i], colours[(i + k) % 6], boxed)
    corners = (2, 8, 6, 0)
    corner = corners[integer(words, 0, quarters)]
    target = make(row, BALL, BLUE, 0)
    add_object(row, words, 3, SIZE, corner, target)
    place_in_room(row, words, 3, SIZE, start_room)
    pick_task(row, target, BLUE, BALL)
