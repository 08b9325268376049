"""Inventing an instruction: a drawn sentence of the whole language about what lies in the house."""

from minihuman.worlds.grid.core.cells import BALL, BOX, DOOR, KEY, SORTED_COLOURS
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.state import FAILED, HEIGHT, OBJECTS, Row, where_is
from minihuman.worlds.grid.instructions.bind import fits
from minihuman.worlds.grid.instructions.block import (
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
from minihuman.worlds.kernels import inlined, part

ONE, BOTH, SEQUENCE = range(3)  # kinds of instructions
DESCRIBE_TRIES = 101
_KINDS = (BOX, BALL, KEY, DOOR)  # what is described; the first three can be carried


@inlined
def one_of_list(words: Words, packed: int) -> int:
    """Draw from a list of small numbers: its length in the lowest four bits, then four bits each."""
    return packed >> 4 + 4 * integer(words, 0, packed & 15) & 15


@part()
def describe(
    row: Row,
    words: Words,
    at: int,
    kinds: int,
    places: bool,
    implicit: bool,
    locked: int,
    columns: int,
    size: int,
) -> None:
    """Draw a description that means something: of one of the first so many kinds, or of a door for 0."""
    for _ in range(DESCRIBE_TRIES):
        drawn = integer(words, 0, 7)
        colour = ANY if drawn == 0 else SORTED_COLOURS[drawn - 1]
        kind = DOOR if kinds == 0 else _KINDS[integer(words, 0, kinds)]
        place = ANY
        if places and integer(words, 0, 2) == 0:
            place = integer(words, 0, 4)
        for identity in range(1, row[OBJECTS] + 1):
            if not fits(row, identity, kind, colour, place):
                continue
            if not implicit and locked >= 0:
                cell = where_is(row, identity)
                x, y = cell // row[HEIGHT], cell % row[HEIGHT]
                left, top = locked % columns * (size - 1), locked // columns * (size - 1)
                if x >= left and y >= top and x < left + size and y < top + size:
                    continue
            row[at + KIND], row[at + COLOUR], row[at + PLACE] = kind, colour, place
            return
    row[FAILED] = 1


@part()
def invent(
    row: Row,
    words: Words,
    actions: int,
    kinds: int,
    places: bool,
    implicit: bool,
    locked: int,
    columns: int,
    size: int,
) -> None:
    """Draw an instruction.

    Args:
        row: The furnished house.
        words: The random stream.
        actions: The verbs it may have, as a list.
        kinds: ONE, BOTH or SEQUENCE, those it may be, as a list.
        places: Whether things may be described by where they are.
        implicit: Whether everything it means may lie behind the locked door.
        locked: The locked room, or -1.
        columns: Rooms in a line.
        size: Cells on a side of a room.
    """
    block = block_of(row)
    kind = one_of_list(words, kinds)
    clauses = 0
    for part_of in range(2 if kind == SEQUENCE else 1):
        count = integer(words, 0, 2) + 1 if kind == SEQUENCE else kind + 1
        row[block + (RIGHT if part_of else LEFT)] = count
        for _ in range(count):
            clause = block + CLAUSES + clauses * CLAUSE
            verb = one_of_list(words, actions)
            row[clause + VERB] = verb
            described = 4 if verb == GO_TO else 0 if verb == OPEN else 3
            describe(row, words, clause + THING, described, places, implicit, locked, columns, size)
            if row[FAILED] == 0 and verb == PUT_NEXT:
                describe(row, words, clause + OTHER, 4, places, implicit, locked, columns, size)
            if row[FAILED] != 0:
                return
            clauses += 1
    row[block + JOIN] = ALONE if kind != SEQUENCE else BEFORE if integer(words, 0, 2) == 0 else AFTER
