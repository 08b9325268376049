"""Kernels of levels: equal rooms in a row of state, their doors and objects, and a random instruction about them.

Every draw is made in Minigrid's order. Giving up is part of the random stream: if an object finds no place in 1001
tries, or the rooms cannot be connected in 5001, the row is marked as FAILED, and the level draws its next layout. A row
that no further draw could complete is marked as HOPELESS.
"""

import numpy as np

from minihuman.worlds.grid.babyai.binding import fits
from minihuman.worlds.grid.babyai.encoding import (
    AFTER,
    ALONE,
    ANY,
    BEFORE,
    CLAUSE,
    CLAUSES,
    COLOUR,
    GO_TO,
    JOIN,
    KIND,
    LEFT,
    OPEN,
    OTHER,
    PLACE,
    PUT_NEXT,
    RIGHT,
    THING,
    VERB,
    block_of,
)
from minihuman.worlds.grid.core.cells import (
    BALL,
    BOX,
    DOOR,
    EMPTY,
    KEY,
    SORTED_COLOURS,
    WALL,
    colour_of,
    identity_of,
    in_colour,
    in_state,
    kind_of,
)
from minihuman.worlds.grid.core.cells import OPEN as STANDS_OPEN
from minihuman.worlds.grid.core.placement import stand
from minihuman.worlds.grid.core.rewards import cell_in_front
from minihuman.worlds.grid.core.state import (
    FAILED,
    HEADER,
    HEIGHT,
    NOWHERE,
    OBJECTS,
    WIDTH,
    Row,
    X,
    Y,
    cell_at,
    contents_index,
    make,
    put,
    where_is,
)
from minihuman.worlds.grid.layouts.room_grid import (
    AGENT_TRIES,
    CONNECT_TRIES,
    DOOR_X,
    DOOR_Y,
    LOCKED_ROOM,
    NO_DOOR,
    PLACE_TRIES,
    WAY,
    Plan,
    add_door,
    add_object,
    behind,
    reachable,
)
from minihuman.worlds.grid.layouts.single_rooms import draw_colour, draw_kind
from minihuman.worlds.kernels import device_function, inline
from minihuman.worlds.rng import RngState, integer, unit

HOPELESS = 2  # in FAILED: no round will ever do
DRAWN = -1  # of a room, wall, kind, colour or lock: draw it


@inline
def code_of(row: Row, identity: int) -> int:
    """Return the code of an object that lies in a cell, or EMPTY if it lies in none."""
    cell = where_is(row, identity)
    if cell != NOWHERE:
        return row[HEADER + cell]
    return EMPTY


@device_function()
def draw_room(rng_state: RngState, columns: int, lines: int) -> int:
    """Draw a room of a grid of rooms, its column, then its line; return its number, line * columns + column."""
    i = integer(rng_state, 0, columns)
    return integer(rng_state, 0, lines) * columns + i


@device_function()
def new_door(
    row: Row, rng_state: RngState, plan: Plan, columns: int, room: int, wall: int, colour: int, locked: int
) -> int:
    """Put a door into a wall of a room; return its identity, or 0 if that wall, or every wall, can have none.

    ``wall``, ``colour`` and ``locked`` (0 or 1) may be DRAWN. If there is no place, mark the row as HOPELESS.
    """
    if wall == DRAWN:
        possible = False
        for k in range(4):
            possible |= plan[room, DOOR_X + k] != NO_DOOR and plan[room, WAY + k] == 0
        if not possible:
            row[FAILED] = HOPELESS
            return 0
        wall = integer(rng_state, 0, 4)
        while plan[room, DOOR_X + wall] == NO_DOOR or plan[room, WAY + wall] != 0:
            wall = integer(rng_state, 0, 4)
    if colour == DRAWN:
        colour = draw_colour(rng_state)
    if locked == DRAWN:
        locked = 1 - integer(rng_state, 0, 2)
    if plan[room, DOOR_X + wall] == NO_DOOR or plan[room, WAY + wall] != 0:
        row[FAILED] = HOPELESS
        return 0
    add_door(row, plan, columns, room, wall, colour, locked != 0)
    return row[OBJECTS]


@device_function()
def new_object(row: Row, rng_state: RngState, columns: int, size: int, room: int, kind: int, colour: int) -> int:
    """Put a key, ball or box into a random cell of a room, not next to the agent; return the object's identity.

    ``kind`` and ``colour`` may be DRAWN. ``columns`` is the number of rooms in a line, and ``size`` the number of cells
    on a side of a room, including its walls.
    """
    if kind == DRAWN:
        kind = draw_kind(rng_state, 3)
    if colour == DRAWN:
        colour = draw_colour(rng_state)
    add_object(row, rng_state, columns, size, room, make(row, kind, colour, 0))
    return row[OBJECTS]


@device_function()
def new_objects(
    row: Row, rng_state: RngState, plan: Plan, columns: int, size: int, room: int, count: int, unlike: bool
) -> None:
    """Put ``count`` random objects into a room, or each into a random room if ``room`` is DRAWN.

    With ``unlike``, each new object differs in kind or colour from every object that lies in a cell.
    """
    lines = len(plan) // columns
    left = count
    tries = 0
    while left > 0 and row[FAILED] == 0:
        colour = draw_colour(rng_state)
        kind = draw_kind(rng_state, 3)
        tries += 1
        if unlike and is_there(row, kind, colour):
            if tries > AGENT_TRIES:
                row[FAILED] = HOPELESS
            continue
        new_object(
            row, rng_state, columns, size, draw_room(rng_state, columns, lines) if room == DRAWN else room, kind, colour
        )
        left -= 1


@device_function()
def is_there(row: Row, kind: int, colour: int) -> bool:
    """Return whether an object of the given kind and colour lies in a cell."""
    for identity in range(1, row[OBJECTS] + 1):
        code = code_of(row, identity)
        if kind_of(code) == kind and colour_of(code) == colour:
            return True
    return False


@device_function()
def put_agent_in(row: Row, rng_state: RngState, plan: Plan, columns: int, size: int, room: int, barred: int) -> None:
    """Put the agent into a room, or into a random one other than ``barred`` if ``room`` is DRAWN.

    The agent faces an empty cell or a wall. If ``barred`` is -1, no room is barred. If no cell is found, mark the row
    as FAILED or HOPELESS. ``columns`` and ``size`` are as in `new_object`.
    """
    lines = len(plan) // columns
    for _ in range(AGENT_TRIES):
        if room == DRAWN:
            target_room = draw_room(rng_state, columns, lines)
        else:
            target_room = room
        stand_in(row, rng_state, columns, size, target_room)
        if row[FAILED] != 0 or target_room != barred:
            return
    row[FAILED] = HOPELESS


@device_function()
def stand_in(row: Row, rng_state: RngState, columns: int, size: int, room: int) -> None:
    """Draw the agent's cell and direction in a room until it faces an empty cell or a wall; FAILED if none is found."""
    left = room % columns * (size - 1)
    top = room // columns * (size - 1)
    for _ in range(AGENT_TRIES):
        row[X] = row[Y] = -1
        tries = 0
        x = integer(rng_state, left, left + size)
        y = integer(rng_state, top, top + size)
        while row[HEADER + x * row[HEIGHT] + y] != EMPTY:
            tries += 1
            if tries == PLACE_TRIES:
                row[FAILED] = 1
                return
            x = integer(rng_state, left, left + size)
            y = integer(rng_state, top, top + size)
        stand(row, x, y, integer(rng_state, 0, 4))
        ahead_x, ahead_y = cell_in_front(row)
        kind = kind_of(cell_at(row, ahead_x, ahead_y))
        if kind == EMPTY or kind == WALL:
            return
    row[FAILED] = HOPELESS


@device_function()
def join_rooms(row: Row, rng_state: RngState, plan: Plan, columns: int, size: int, without: int) -> None:
    """Add closed doors at random walls until all rooms are connected to the agent's; mark the row as FAILED if not.

    None of the doors has the colour ``without``; if that is DRAWN, they have any colours.
    """
    lines = len(plan) // columns
    start = row[Y] // (size - 1) * columns + row[X] // (size - 1)
    joined = reachable(plan, columns, start)
    for _ in range(CONNECT_TRIES):
        if joined == len(plan):
            return
        room = draw_room(rng_state, columns, lines)
        wall = integer(rng_state, 0, 4)
        if plan[room, DOOR_X + wall] == NO_DOOR or plan[room, WAY + wall]:
            continue
        if plan[room, LOCKED_ROOM] or plan[behind(room, wall, columns), LOCKED_ROOM]:
            continue
        if without == DRAWN:
            colour = draw_colour(rng_state)
        else:
            k = integer(rng_state, 0, 5)
            for passed in range(6):
                if SORTED_COLOURS[passed] == without and passed <= k:
                    k += 1
            colour = SORTED_COLOURS[k]
        add_door(row, plan, columns, room, wall, colour, False)
        joined = reachable(plan, columns, start)
    row[FAILED] = 1


@device_function()
def all_in_reach(row: Row) -> bool:
    """Return whether the agent could reach every object if all doors were open, without moving any object."""
    height = row[HEIGHT]
    reached = np.zeros(row[WIDTH] * height, np.uint8)
    stack = np.empty(len(reached) + 1, np.int64)  # what is written at its end counts only if ``waiting`` grows
    cell = row[X] * height + row[Y]
    waiting = 1
    reached[cell] = 1
    stack[0] = cell
    while waiting > 0:
        waiting -= 1
        cell = stack[waiting]
        for other in (cell - height, cell - 1, cell + 1, cell + height):  # all inside the grid, as walls surround it
            kind = kind_of(row[HEADER + other])
            stack[waiting] = other
            waiting += ((kind == EMPTY) | (kind == DOOR)) & (reached[other] == 0)
            reached[other] = 1
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE and not reached[cell]:
            return False
    return True


@device_function()
def draw_door_of(row: Row, rng_state: RngState, plan: Plan, columns: int) -> int:
    """Draw a door from a list that has each door twice, once per room; return its identity, or 0 if there is none.

    Without a door, mark the row as HOPELESS.
    """
    lines = len(plan) // columns
    pick = -1
    count = 0
    for again in range(2):  # first count the doors, then find the one that was drawn
        if again:
            if count == 0:
                row[FAILED] = HOPELESS
                return 0
            pick = integer(rng_state, 0, count)
            count = 0
        for i in range(columns):
            for j in range(lines):
                for wall in range(4):
                    room = j * columns + i
                    if plan[room, WAY + wall]:
                        code = cell_at(row, plan[room, DOOR_X + wall], plan[room, DOOR_Y + wall])
                        if kind_of(code) == DOOR:
                            if count == pick:
                                return identity_of(code)
                            count += 1
    return 0


@device_function()
def open_doors(row: Row) -> None:
    """Open every door."""
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE and kind_of(row[HEADER + cell]) == DOOR:
            row[HEADER + cell] = in_state(row[HEADER + cell], STANDS_OPEN)


@device_function()
def recolour(row: Row, first: int, last: int, colour: int) -> None:
    """Give the objects with the identities ``first`` to ``last`` that lie in cells another colour."""
    for identity in range(first, last + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE:
            row[HEADER + cell] = in_colour(row[HEADER + cell], colour)


@device_function()
def lock_a_room(row: Row, rng_state: RngState, plan: Plan, columns: int, size: int) -> int:
    """Put a locked door into a wall of a random room, and its key into another room; return the locked room.

    If there is only one room, return -1 and mark the row as HOPELESS.
    """
    lines = len(plan) // columns
    if len(plan) == 1:
        row[FAILED] = HOPELESS
        return -1
    room = draw_room(rng_state, columns, lines)
    wall = integer(rng_state, 0, 4)
    while plan[room, DOOR_X + wall] == NO_DOOR:
        room = draw_room(rng_state, columns, lines)
        wall = integer(rng_state, 0, 4)
    colour = draw_colour(rng_state)
    add_door(row, plan, columns, room, wall, colour, True)
    other = draw_room(rng_state, columns, lines)
    while other == room:
        other = draw_room(rng_state, columns, lines)
    new_object(row, rng_state, columns, size, other, KEY, colour)
    return room


@device_function()
def block_door(row: Row, rng_state: RngState, door: int) -> int:
    """Put a ball of a random colour into the cell to the left of the door of identity ``door``; return the ball's."""
    colour = draw_colour(rng_state)
    cell = where_is(row, door)
    x = cell // row[HEIGHT] - 1
    y = cell % row[HEIGHT]
    put(row, x, y, make(row, BALL, colour, 0))
    return row[OBJECTS]


@device_function()
def boxed_key(row: Row, rng_state: RngState, columns: int, size: int, room: int, colour: int) -> int:
    """Put a box of a random colour, with a key of ``colour`` in it, into a room; return the box's identity."""
    key = make(row, KEY, colour, 0)
    box = make(row, BOX, draw_colour(rng_state), 0)
    row[contents_index(row, identity_of(box))] = key
    add_object(row, rng_state, columns, size, room, box)
    return row[OBJECTS]


@inline
def chance_below(rng_state: RngState, threshold: int) -> bool:
    """Draw a number in [0, 1); return whether it is below ``threshold`` / 2**53."""
    return unit(rng_state) < threshold


ONE, BOTH, SEQUENCE = range(3)  # kinds of instructions
DESCRIBE_TRIES = 101
_KINDS = (BOX, BALL, KEY, DOOR)  # what is described; the first three can be carried


@inline
def one_of_list(rng_state: RngState, packed: int) -> int:
    """Return a number drawn from a packed list: its length in the lowest four bits, then four bits per number."""
    return packed >> 4 + 4 * integer(rng_state, 0, packed & 15) & 15


@device_function()
def describe(
    row: Row,
    rng_state: RngState,
    at: int,
    kinds: int,
    places: bool,
    implicit: bool,
    locked: int,
    columns: int,
    size: int,
) -> None:
    """Write to the row at ``at`` a random description of one of the first ``kinds`` of `_KINDS`, or a door if 0."""
    for _ in range(DESCRIBE_TRIES):
        colour_number = integer(rng_state, 0, 7)
        if colour_number == 0:
            colour = ANY
        else:
            colour = SORTED_COLOURS[colour_number - 1]
        if kinds == 0:
            kind = DOOR
        else:
            kind = _KINDS[integer(rng_state, 0, kinds)]
        place = ANY
        if places and integer(rng_state, 0, 2) == 0:
            place = integer(rng_state, 0, 4)
        for identity in range(1, row[OBJECTS] + 1):
            if not fits(row, identity, kind, colour, place):
                continue
            if not implicit and locked >= 0:
                cell = where_is(row, identity)
                x = cell // row[HEIGHT]
                y = cell % row[HEIGHT]
                left = locked % columns * (size - 1)
                top = locked // columns * (size - 1)
                if x >= left and y >= top and x < left + size and y < top + size:
                    continue
            row[at + KIND] = kind
            row[at + COLOUR] = colour
            row[at + PLACE] = place
            return
    row[FAILED] = 1


@device_function()
def kinds_described(verb: int) -> int:
    """Return how many of `_KINDS`, counted from the first, are drawn for a verb's object; 0 if it must be a door."""
    if verb == GO_TO:
        return 4
    if verb == OPEN:
        return 0
    return 3


@device_function()
def sample_instruction(
    row: Row,
    rng_state: RngState,
    actions: int,
    kinds: int,
    places: bool,
    implicit: bool,
    locked: int,
    columns: int,
    size: int,
) -> None:
    """Draw an instruction about the objects of a layout.

    Args:
        row: the furnished layout.
        rng_state: the random stream.
        actions: the verbs that the instruction may have, as a packed list.
        kinds: the kinds of instruction that it may be, ONE, BOTH or SEQUENCE, as a packed list.
        places: whether objects may be described by their place.
        implicit: whether all objects that match a description may lie behind the locked door.
        locked: the locked room, or -1.
        columns: the number of rooms in a line.
        size: the number of cells on a side of a room.
    """
    block = block_of(row)
    kind = one_of_list(rng_state, kinds)
    clauses = 0
    for part_of in range(2 if kind == SEQUENCE else 1):
        if kind == SEQUENCE:
            count = integer(rng_state, 0, 2) + 1
        else:
            count = kind + 1
        row[block + (RIGHT if part_of else LEFT)] = count
        for _ in range(count):
            clause = block + CLAUSES + clauses * CLAUSE
            verb = one_of_list(rng_state, actions)
            row[clause + VERB] = verb
            kinds_of_thing = kinds_described(verb)
            describe(row, rng_state, clause + THING, kinds_of_thing, places, implicit, locked, columns, size)
            if row[FAILED] == 0 and verb == PUT_NEXT:
                describe(row, rng_state, clause + OTHER, 4, places, implicit, locked, columns, size)
            if row[FAILED] != 0:
                return
            clauses += 1
    join = ALONE
    if kind == SEQUENCE:
        join = BEFORE if integer(rng_state, 0, 2) == 0 else AFTER
    row[block + JOIN] = join
