"""Between an instruction and its numbers in a state: to numbers, back, and as a sentence. Pure functions of a row."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import COLOURS, KINDS
from minihuman.worlds.grid.core.state import FAILED, HEADER, HEIGHT, OBJECTS, TASK, WIDTH, Row
from minihuman.worlds.grid.core.tasks import INSTRUCTED
from minihuman.worlds.grid.instructions.block import (
    AFTER,
    ALONE,
    ANY,
    BEFORE,
    BLOCK,
    CLAUSE,
    CLAUSES,
    FLAGS,
    GO_TO,
    HANDED,
    IN_ORDER_STRICTLY,
    JOIN,
    LEFT,
    OPEN,
    OTHER,
    PICK_UP,
    PUT_NEXT,
    RIGHT,
    SATISFIED,
    STATUS,
    STRICT,
    THING,
    VERB,
    WHEN,
)
from minihuman.worlds.grid.instructions.language import (
    PLACES,
    After,
    And,
    Before,
    Clause,
    GoTo,
    Instruction,
    Open,
    Part,
    Pickup,
    PutNext,
    Thing,
    clauses,
    parts,
)

VERBS: dict[type[Clause], int] = {GoTo: GO_TO, Open: OPEN, Pickup: PICK_UP, PutNext: PUT_NEXT}
CLASSES = {number: verb for verb, number in VERBS.items()}
JOINS: dict[type, int] = {Before: BEFORE, After: AFTER}
UNSAID = -1  # in numbers to be compared: "a" or "the" was not said


def to_numbers(instruction: Instruction) -> NDArray[np.int64]:
    """The block's numbers that say the instruction, int64[BLOCK]."""
    numbers = np.zeros(BLOCK, np.int64)
    numbers[JOIN] = JOINS.get(type(instruction), ALONE)
    for at, part in zip((LEFT, RIGHT), parts(instruction), strict=False):
        numbers[at] = 2 if isinstance(part, And) else 1
    numbers[FLAGS] = IN_ORDER_STRICTLY if isinstance(instruction, Before | After) and instruction.strict else 0
    for k, clause in enumerate(clauses(instruction)):
        line = numbers[CLAUSES + k * CLAUSE :][:CLAUSE]
        line[VERB] = VERBS[type(clause)]
        line[STRICT] = getattr(clause, "strict", False)
        line[THING : THING + 4] = thing_numbers(clause.thing)
        if isinstance(clause, PutNext):
            line[OTHER : OTHER + 4] = thing_numbers(clause.other)
    return numbers


def thing_numbers(thing: Thing) -> tuple[int, int, int, int]:
    """A description as kind, colour, place, and whether it means several."""
    return (
        ANY if thing.kind is None else KINDS.index(thing.kind),
        ANY if thing.colour is None else COLOURS.index(thing.colour),
        ANY if thing.place is None else PLACES.index(thing.place),
        UNSAID if thing.many is None else int(thing.many),
    )


def block(row: Row) -> Row:
    """The numbers of a state's instruction, int32[BLOCK]: a view."""
    begin = HEADER + 3 * int(row[WIDTH]) * int(row[HEIGHT])
    return row[begin : begin + BLOCK]


def means(row: Row) -> Row:
    """By which descriptions each object is meant, as bits, by identity - 1: a view."""
    cells = int(row[WIDTH]) * int(row[HEIGHT])
    begin = HEADER + 3 * cells + BLOCK
    return row[begin : begin + int(row[OBJECTS])]


def has_instruction(row: Row) -> bool:
    """Whether the state's task is an instruction."""
    return bool(row[TASK] == INSTRUCTED and row[FAILED] == 0)


def instruction_of(row: Row) -> Instruction:
    """The instruction of a state."""
    return _read(_said(block(row).tobytes()))


def sentence_of(row: Row) -> str:
    """The sentence of a state's instruction."""
    return _sentence(block(row).tobytes())


def clauses_done(row: Row) -> tuple[tuple[str, int], ...]:
    """The clauses of a state's instruction as text, each with the step that did it; 0 for none yet."""
    lines = block(row)[CLAUSES:].reshape(-1, CLAUSE)
    return tuple(
        (str(clause), int(line[WHEN]) if line[STATUS] == SATISFIED else 0)
        for clause, line in zip(clauses(instruction_of(row)), lines, strict=False)
    )


def _said(numbers: bytes) -> bytes:
    """What decides the sentence: a block without what has been satisfied so far."""
    said = np.frombuffer(numbers, np.int32).copy()
    said[HANDED:CLAUSES] = 0
    said[CLAUSES:].reshape(-1, CLAUSE)[:, STATUS:THING] = 0
    return said.tobytes()


@lru_cache(maxsize=4096)
def _sentence(numbers: bytes) -> str:
    return str(_read(_said(numbers)))


@lru_cache(maxsize=1024)
def _read(said: bytes) -> Instruction:
    numbers = np.frombuffer(said, np.int32)
    join, left, right, flags = numbers[[JOIN, LEFT, RIGHT, FLAGS]].tolist()
    lines = numbers[CLAUSES:].reshape(-1, CLAUSE).tolist()
    first = _part(lines[:left])
    if join == ALONE:
        return first
    second = _part(lines[left : left + right])
    strict = bool(flags & IN_ORDER_STRICTLY)
    return Before(first, second, strict) if join == BEFORE else After(first, second, strict)


def _part(lines: list[list[int]]) -> Part:
    read = [_clause(line) for line in lines]
    return read[0] if len(read) == 1 else And(*read)


def _clause(line: list[int]) -> Clause:
    verb, strict = line[VERB], line[STRICT]
    thing = _thing(line[THING:OTHER])
    if verb == PUT_NEXT:
        return PutNext(thing, _thing(line[OTHER:CLAUSE]), bool(strict))
    if verb == GO_TO:
        return GoTo(thing)
    return Open(thing, bool(strict)) if verb == OPEN else Pickup(thing, bool(strict))


def _thing(numbers: list[int]) -> Thing:
    kind, colour, place, several = numbers
    return Thing(
        None if kind == ANY else KINDS[kind],
        None if colour == ANY else COLOURS[colour],
        None if place == ANY else PLACES[place],
        bool(several),
    )
