"""Worlds about objects in one room: Fetch, GoToObject, PutNear, GoToDoor, Memory."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import BALL, BOX, CLOSED, DOOR, GREEN, GREY_WALL, KEY, SORTED_COLOURS
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.place import (
    FOR_EVER,
    across,
    draw_place,
    outer_walls,
    place_agent,
    place_agent_anywhere,
    place_anywhere,
    stand,
    wall_rect,
)
from minihuman.worlds.grid.core.state import FAILED, HEIGHT, MISSION, TARGET, TASK, WIDTH, Row, make, put
from minihuman.worlds.grid.core.tasks import FETCH, MATCH, PUT_NEAR, STAND_BY
from minihuman.worlds.kernels import kernel, part

KINDS_DRAWN = (KEY, BALL, BOX)


@part()
def draw_colour(words: Words) -> int:
    """Draw one of the six colours."""
    return SORTED_COLOURS[integer(words, 0, 6)]


@part()
def draw_kind(words: Words, kinds: int) -> int:
    """Draw one of the first so many of key, ball and box."""
    return KINDS_DRAWN[integer(words, 0, kinds)]


@kernel()
def fetch(row: Row, words: Words, objects: int) -> None:
    """Keys and balls; one is to be fetched."""
    outer_walls(row)
    kinds, colours = np.empty(objects, np.int64), np.empty(objects, np.int64)
    for k in range(objects):
        kinds[k] = draw_kind(words, 2)
        colours[k] = draw_colour(words)
        place_anywhere(row, words, make(row, kinds[k], colours[k], 0))
    place_agent_anywhere(row, words)
    k = integer(words, 0, objects)
    row[TASK] = FETCH
    row[TARGET], row[TARGET + 1] = kinds[k], colours[k]
    row[MISSION], row[MISSION + 1], row[MISSION + 2] = integer(words, 0, 5), colours[k], kinds[k]


@part()
def draw_objects(row: Row, words: Words, objects: int, apart: bool) -> NDArray[np.int64]:
    """Place different objects, ``apart`` none beside another: kind, colour, x, y of each."""
    drawn = np.full((objects, 4), -9, np.int64)
    k = 0
    while k < objects and row[FAILED] == 0:
        kind, colour = draw_kind(words, 3), draw_colour(words)
        known = False
        for other in range(k):
            known |= drawn[other, 0] == kind and drawn[other, 1] == colour
        if known:
            continue
        x, y = draw_place(row, words, 0, 0, row[WIDTH], row[HEIGHT], FOR_EVER)
        tries = 0
        while apart and beside_any(drawn, x, y) and row[FAILED] == 0:
            x, y = draw_place(row, words, 0, 0, row[WIDTH], row[HEIGHT], FOR_EVER)
            tries += 1
            if tries > 10_000:
                row[FAILED] = 1
        put(row, x, y, make(row, kind, colour, 0))
        drawn[k, 0], drawn[k, 1], drawn[k, 2], drawn[k, 3] = kind, colour, x, y
        k += 1
    return drawn


@part()
def beside_any(drawn: NDArray[np.int64], x: int, y: int) -> bool:
    """Whether a cell touches one of the objects, corners included."""
    for k in range(len(drawn)):
        if abs(drawn[k, 2] - x) <= 1 and abs(drawn[k, 3] - y) <= 1:
            return True
    return False


@kernel()
def go_to_object(row: Row, words: Words, objects: int) -> None:
    """Objects; the agent says "done" beside the one it is sent to."""
    outer_walls(row)
    drawn = draw_objects(row, words, objects, False)
    place_agent_anywhere(row, words)
    kind, colour, x, y = drawn[integer(words, 0, objects)]
    row[TASK] = STAND_BY
    row[TARGET], row[TARGET + 1] = x, y
    row[MISSION], row[MISSION + 1] = colour, kind


@kernel()
def put_near(row: Row, words: Words, objects: int) -> None:
    """Objects; one is to be put near another."""
    outer_walls(row)
    drawn = draw_objects(row, words, objects, True)
    place_agent_anywhere(row, words)
    moved = integer(words, 0, objects)
    target = integer(words, 0, objects)
    while target == moved:
        target = integer(words, 0, objects)
    row[TASK] = PUT_NEAR
    row[TARGET], row[TARGET + 1] = drawn[moved, 0], drawn[moved, 1]
    row[TARGET + 2], row[TARGET + 3] = drawn[target, 2], drawn[target, 3]
    row[MISSION], row[MISSION + 1] = drawn[moved, 1], drawn[moved, 0]
    row[MISSION + 2], row[MISSION + 3] = drawn[target, 1], drawn[target, 0]


@kernel()
def go_to_door(row: Row, words: Words) -> None:
    """A room of drawn size with four doors; the agent says "done" beside the one it is sent to."""
    width = integer(words, 5, row[WIDTH] + 1)
    height = integer(words, 5, row[HEIGHT] + 1)
    wall_rect(row, 0, 0, width, height)
    places = np.empty((4, 2), np.int64)
    places[0, 0], places[0, 1] = integer(words, 2, width - 2), 0
    places[1, 0], places[1, 1] = integer(words, 2, width - 2), height - 1
    places[2, 0], places[2, 1] = 0, integer(words, 2, height - 2)
    places[3, 0], places[3, 1] = width - 1, integer(words, 2, height - 2)
    colours = np.full(4, -1, np.int64)
    k = 0
    while k < 4:
        colour = draw_colour(words)
        known = False
        for other in range(k):
            known |= colours[other] == colour
        if not known:
            colours[k] = colour
            k += 1
    for k in range(4):
        put(row, places[k, 0], places[k, 1], make(row, DOOR, colours[k], CLOSED))
    place_agent(row, words, 0, 0, width, height)
    k = integer(words, 0, 4)
    row[TASK] = STAND_BY
    row[TARGET], row[TARGET + 1] = places[k, 0], places[k, 1]
    row[MISSION] = colours[k]


@kernel()
def memory(row: Row, words: Words, random_length: int) -> None:
    """An object seen at the start, two at the end of a corridor; go to the matching one."""
    width, height = row[WIDTH], row[HEIGHT]
    outer_walls(row)
    middle = height // 2
    end = integer(words, 4, width - 2) if random_length else width - 3
    across(row, 1, middle - 2, 4, GREY_WALL)
    across(row, 1, middle + 2, 4, GREY_WALL)
    put(row, 4, middle - 1, GREY_WALL)
    put(row, 4, middle + 1, GREY_WALL)
    across(row, 5, middle - 1, end - 5, GREY_WALL)
    across(row, 5, middle + 1, end - 5, GREY_WALL)
    for y in range(height):
        if y != middle:
            put(row, end, y, GREY_WALL)
        put(row, end + 2, y, GREY_WALL)
    stand(row, integer(words, 1, end + 1), middle, 0)
    shown = KEY if integer(words, 0, 2) == 0 else BALL
    put(row, 1, middle - 1, make(row, shown, GREEN, 0))
    above = BALL if integer(words, 0, 2) == 0 else KEY
    put(row, end + 1, middle - 2, make(row, above, GREEN, 0))
    put(row, end + 1, middle + 2, make(row, KEY if above == BALL else BALL, GREEN, 0))
    up = -1 if shown == above else 1
    row[TASK] = MATCH
    row[TARGET], row[TARGET + 1] = end + 1, middle + up
    row[TARGET + 2], row[TARGET + 3] = end + 1, middle - up
