"""The program of a level: the operations into which its function was traced, and the kernel that runs them.

A program is a table of whole numbers: a line for the room grid, then a line per operation (number, register for its
result, arguments). An argument is a number, a register's value (`IN_REGISTER` plus its index), or the kind or the
colour of the object whose identity a register holds.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.babyai.binding import bind, makes_sense
from minihuman.worlds.grid.babyai.encoding import (
    BLOCK,
    CLAUSE,
    CLAUSES,
    FLAGS,
    HANDED,
    HELD,
    JOIN,
    LEFT,
    OPEN,
    OTHER,
    OWN_STEPS,
    PICK_UP,
    PLURAL,
    PUT_NEXT,
    RIGHT,
    ROOM,
    ROUNDS,
    STRICT,
    THING,
    VERB,
    block_of,
)
from minihuman.worlds.grid.babyai.level_rooms import (
    all_in_reach,
    block_door,
    boxed_key,
    chance_below,
    code_of,
    draw_door_of,
    join_rooms,
    lock_a_room,
    new_door,
    new_object,
    new_objects,
    open_doors,
    put_agent_in,
    recolour,
    sample_instruction,
)
from minihuman.worlds.grid.babyai.verifier import hand_over, note_places
from minihuman.worlds.grid.core.cells import DOOR, colour_of, kind_of
from minihuman.worlds.grid.core.rewards import INSTRUCTED
from minihuman.worlds.grid.core.state import FAILED, MAX_STEPS, OBJECTS, TASK, Row, clear
from minihuman.worlds.grid.layouts.room_grid import Plan, remove_wall, rooms
from minihuman.worlds.kernels import device_function, inline, kernel
from minihuman.worlds.rng import RngState, integer

Program = NDArray[np.int64]  # (1 + operations, WIDE)
Given = NDArray[np.int64]  # the block of a given instruction, or an empty array if it is drawn

WIDE = 10  # numbers per line of a program
REGISTERS = 64
MOST_ROUNDS = 10_000
# added to a register's index in an argument
IN_REGISTER = 1 << 56
KIND_IN = 1 << 57
COLOUR_IN = 1 << 58

COLUMNS, LINES, SIZE, STEPS_A_WALK, KEYS_MATTER, ALL_FLAGS = range(6)  # the first line
USE = 5  # a verb: open a door, pick up everything else

(
    INTEGER,  # draw in [a, b)
    OUT_OF,  # draw one of the first a of b, c, d, e, f, g, h
    ROOM_AT,  # the room in column a, line b
    DOOR_IN,  # a door in room a, wall b, colour c, locked d
    OBJECT_IN,  # an object in room a, of kind b, colour c
    OBJECTS_IN,  # in room a (or drawn ones) b objects, unlike all others c, if a is not d: first and last identity
    AGENT_IN,  # the agent in room a (or a drawn one), not in room b
    JOIN_ROOMS,  # without doors in the colour a; if b, only with probability 1/2
    REMOVE_WALL,  # of room a, wall b
    IN_REACH,  # all objects can be reached; with a they must not be
    ONE_FROM,  # draw an identity from a to b
    TWO_FROM,  # draw two different identities from a to b
    ANY_DOOR,  # draw one of the doors
    RECOLOUR,  # the objects a to b to colour c
    OPEN_DOORS,
    NONE_LIKE,  # none of the objects a to b is of kind c and colour d
    LOCK_ROOM,  # with probability a / 2**53 a locked room: its number, or -1
    BLOCK_DOOR,  # a ball before the door a
    BOXED_KEY,  # in room a a box with a key of colour b
    SWAP,  # with probability 1/2, the registers a and b
    TWO_COLOURS,  # draw different colours, a of them, into registers from the first
    SKIP_UNLESS,  # the next c operations, unless a is b
    SAY,  # clause a: verb b, kind c, colour d, place e, and SAY_OTHER for the second description
    SAY_OTHER,  # clause a: kind b, colour c, place d
    ARRANGE,  # join a, clauses in the parts b and c, all flags d
    INVENT,  # any instruction: actions a, kinds b, places c, implicit unlocking d, locked room e
    HAND,  # the object a is in the agent's hand
    GIVE_UP_UNLESS,  # reject the layout unless a is not b
) = range(28)


@inline
def value(row: Row, registers: NDArray[np.int64], argument: int) -> int:
    """Return the value of an argument: a number, what a register holds, or the kind or colour of its object."""
    if argument < IN_REGISTER:
        return argument
    if argument >= COLOUR_IN:
        return colour_of(code_of(row, registers[argument - COLOUR_IN]))
    if argument >= KIND_IN:
        return kind_of(code_of(row, registers[argument - KIND_IN]))
    return registers[argument - IN_REGISTER]


@device_function()
def draw_colours(rng_state: RngState, registers: NDArray[np.int64], out: int, count: int) -> None:
    """Draw ``count`` different colours into the registers from the index ``out`` on.

    Each is drawn from the remaining colours, in the order of their names.
    """
    left = np.array((2, 1, 5, 3, 0, 4))  # the colours that remain, sorted by name, as in SORTED_COLOURS
    for k in range(count):
        pick = integer(rng_state, 0, 6 - k)
        registers[out + k] = left[pick]
        for place in range(pick, 5 - k):
            left[place] = left[place + 1]


@device_function()
def say(row: Row, registers: NDArray[np.int64], line: NDArray[np.int64]) -> None:
    """Run the operation SAY in a line of a program: write a clause with its first description into the block."""
    clause = block_of(row) + CLAUSES + line[2] * CLAUSE
    verb = line[3]
    kind = value(row, registers, line[4])
    if verb == USE:
        verb = OPEN if kind == DOOR else PICK_UP
    row[clause + VERB] = verb
    row[clause + THING] = kind
    row[clause + THING + 1] = value(row, registers, line[5])
    row[clause + THING + 2] = value(row, registers, line[6])
    row[clause + STRICT] = line[7]


@device_function()
def carry_out(row: Row, rng_state: RngState, plan: Plan, program: Program) -> bool:
    """Run a program on a row that has walls alone; return False if it rejects the layout or finds no place in it."""
    columns = program[0, COLUMNS]
    size = program[0, SIZE]
    registers = np.zeros(REGISTERS, np.int64)
    block = block_of(row)
    at = 1
    while at < len(program):
        line = program[at]
        at += 1
        operation = line[0]
        out = line[1]
        if operation == SAY:
            say(row, registers, line)
            continue
        a = value(row, registers, line[2])
        b = value(row, registers, line[3])
        c = value(row, registers, line[4])
        d = value(row, registers, line[5])
        if operation == INTEGER:
            registers[out] = integer(rng_state, a, b)
        elif operation == OUT_OF:
            registers[out] = line[3 + integer(rng_state, 0, a)]
        elif operation == ROOM_AT:
            registers[out] = b * columns + a
        elif operation == DOOR_IN:
            registers[out] = new_door(row, rng_state, plan, columns, a, b, c, d)
        elif operation == OBJECT_IN:
            registers[out] = new_object(row, rng_state, columns, size, a, b, c)
        elif operation == OBJECTS_IN:
            registers[out] = row[OBJECTS] + 1
            if a == -1 or a != d:
                new_objects(row, rng_state, plan, columns, size, a, b, c != 0)
            registers[out + 1] = row[OBJECTS]
        elif operation == AGENT_IN:
            put_agent_in(row, rng_state, plan, columns, size, a, b)
        elif operation == JOIN_ROOMS:
            if b and integer(rng_state, 0, 2) != 0:
                a = -1
            join_rooms(row, rng_state, plan, columns, size, a)
        elif operation == REMOVE_WALL:
            remove_wall(row, plan, columns, size, a, b)
        elif operation == IN_REACH:
            if all_in_reach(row) != (a == 0):
                return False
        elif operation == ONE_FROM:
            registers[out] = a + integer(rng_state, 0, b - a + 1)
        elif operation == TWO_FROM:
            first = integer(rng_state, 0, b - a + 1)
            second = integer(rng_state, 0, b - a)
            registers[out] = a + first
            registers[out + 1] = a + second + (second >= first)
        elif operation == ANY_DOOR:
            registers[out] = draw_door_of(row, rng_state, plan, columns)
        elif operation == RECOLOUR:
            recolour(row, a, b, c)
        elif operation == OPEN_DOORS:
            open_doors(row)
        elif operation == NONE_LIKE:
            for identity in range(a, b + 1):
                code = code_of(row, identity)
                if kind_of(code) == c and colour_of(code) == d:
                    return False
        elif operation == LOCK_ROOM:
            registers[out] = -1
            if chance_below(rng_state, a):
                registers[out] = lock_a_room(row, rng_state, plan, columns, size)
        elif operation == BLOCK_DOOR:
            registers[out] = block_door(row, rng_state, a)
        elif operation == BOXED_KEY:
            registers[out] = boxed_key(row, rng_state, columns, size, a, b)
        elif operation == SWAP:
            if integer(rng_state, 0, 2) == 0:
                first = line[2] - IN_REGISTER
                second = line[3] - IN_REGISTER
                registers[first] = b
                registers[second] = a
        elif operation == TWO_COLOURS:
            draw_colours(rng_state, registers, out, a)
        elif operation == SKIP_UNLESS:
            if a != b:
                at += c
        elif operation == SAY_OTHER:
            place = block + CLAUSES + a * CLAUSE + OTHER
            row[place] = b
            row[place + 1] = c
            row[place + 2] = d
        elif operation == ARRANGE:
            row[block + JOIN] = a
            row[block + LEFT] = b
            row[block + RIGHT] = c
            row[block + FLAGS] |= d
        elif operation == INVENT:
            sample_instruction(row, rng_state, a, b, c != 0, d != 0, value(row, registers, line[6]), columns, size)
        elif operation == HAND:
            row[block + HANDED] = a
        elif operation == GIVE_UP_UNLESS and a == b:
            return False
        if row[FAILED] != 0:
            return False
    return True


@device_function()
def settle(row: Row, fixed_mission: Given, keys_matter: bool) -> bool:
    """Bind the drawn instruction, or ``fixed_mission`` if it is not empty, to the layout.

    Return False if a description matches no object, the instruction makes no sense there, or a given instruction has an
    article ("a" or "the") that is wrong there.
    """
    block = block_of(row)
    if len(fixed_mission) == 0:
        return bind(row) and makes_sense(row, keys_matter)
    for k in (JOIN, LEFT, RIGHT):
        row[block + k] = fixed_mission[k]
    for k in range(CLAUSES, BLOCK):
        row[block + k] = fixed_mission[k]
    row[block + FLAGS] |= fixed_mission[FLAGS]
    if not bind(row) or not makes_sense(row, False):
        return False
    for k in range(row[block + LEFT] + row[block + RIGHT]):
        for at in (CLAUSES + k * CLAUSE + THING + PLURAL, CLAUSES + k * CLAUSE + OTHER + PLURAL):
            if fixed_mission[at] >= 0 and fixed_mission[at] != row[block + at]:
                return False
    return True


@kernel("void(int32[::1], uint64[::1], int64[:, ::1], int64[::1])", only=True)
def furnish(row: Row, rng_state: RngState, program: Program, fixed_mission: Given) -> None:
    """Lay out an episode of a level: draw layouts until one is accepted. Mark the row as FAILED if none is.

    Args:
        row: the row of state, which is cleared first.
        rng_state: the random stream.
        program: the program of the level.
        fixed_mission: the block of the episode's instruction; empty if it is drawn.
    """
    columns = program[0, COLUMNS]
    lines = program[0, LINES]
    size = program[0, SIZE]
    block = block_of(row)
    for attempt in range(1, MOST_ROUNDS + 1):
        clear(row)
        plan = rooms(row, rng_state, columns, lines, size)
        row[block + ROOM] = size
        row[block + FLAGS] = program[0, ALL_FLAGS]
        if carry_out(row, rng_state, plan, program) and settle(row, fixed_mission, program[0, KEYS_MATTER] != 0):
            row[block + ROUNDS] = attempt
            break
        if row[FAILED] > 1 or attempt == MOST_ROUNDS:  # HOPELESS: no further draw can succeed
            row[FAILED] = 1
            return
    row[TASK] = INSTRUCTED
    if program[0, STEPS_A_WALK] > 0:
        walks = 0
        for k in range(row[block + LEFT] + row[block + RIGHT]):
            walks += 2 if row[block + CLAUSES + k * CLAUSE + VERB] == PUT_NEXT else 1
        row[MAX_STEPS] = walks * program[0, STEPS_A_WALK]
    if row[block + HANDED] > 0 and row[block + FLAGS] & OWN_STEPS:
        for k in range(row[block + LEFT] + row[block + RIGHT]):
            row[block + CLAUSES + k * CLAUSE + HELD] = row[block + HANDED]
        hand_over(row)
        note_places(row)
