"""Instructions as numbers: a block in the row of state after the cells, and conversions to and from it.

An instruction is one part, or two parts of which one comes before the other; a part is one clause, or two in any order.
A clause is a verb with one or two descriptions of objects. Description `2 * clause` is that of the object to act on,
and `2 * clause + 1` that of the object next to which it is put. After the block, each object has a number, bit `d` of
which says whether description `d` matches it. Each cell has such a number too, for the object that lay there when
places were last recorded.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.babyai.language import (
    PLACES,
    After,
    And,
    Before,
    Clause,
    GoTo,
    Instruction,
    ObjectDescription,
    Open,
    Pickup,
    PutNext,
    clauses,
    parts,
)
from minihuman.worlds.grid.core.cells import KINDS
from minihuman.worlds.grid.core.state import HEADER, HEIGHT, OBJECTS, WIDTH, Row
from minihuman.worlds.kernels import inline

JOIN = 0  # how the parts are joined
# clauses in the first and the second part as they are read; 0 for no part
LEFT = 1
RIGHT = 2
FLAGS = 3
HANDED = 4  # identity of the object that is put into the agent's hand after the first observation; 0 for none
ROUNDS = 5  # number of layouts drawn, up to the accepted one
ROOM = 6  # cells on a side of a room, walls included, for "on your left"; 0: the grid is one room
CLAUSES = 8  # the first clause
MOST_CLAUSES = 4

VERB = 0  # within a clause
STRICT = 1  # doing it to anything else is failure
STATUS = 2
WHEN = 3  # the step in which it was satisfied
HELD = 4  # identity of what was in hand when it was last judged; 0 for nothing
MATCHED = 5  # with SAY_DONE: whether the last step has completed the clause
THING = 6  # the description: kind, colour, place (-1: any), and whether it means more than one thing
OTHER = 10  # the second description
KIND, COLOUR, PLACE, PLURAL = range(4)
CLAUSE = 14  # numbers per clause

BLOCK = CLAUSES + MOST_CLAUSES * CLAUSE

ALONE, BEFORE, AFTER = range(3)  # joins
NO_VERB, GO_TO, OPEN, PICK_UP, PUT_NEXT = range(5)
IN_ORDER_STRICTLY = 1  # flags: doing the second part first is failure
OWN_STEPS = 2  # a step that ends the first part does not count for the second, and places are noted in every step
SAY_DONE = 4  # a part ends when "done" is said right after it was done
WAITING, SATISFIED, BROKEN = range(3)  # a clause's status

ANY = -1
ON_LEFT, ON_RIGHT, IN_FRONT, BEHIND = range(4)  # places, seen from the agent's first pose


def instructed_length(width: int, height: int) -> int:
    """Return the length of the row of state of a world with instructions."""
    return HEADER + 5 * width * height + BLOCK


@inline
def block_of(row: Row) -> int:
    """Return the index in the row at which the block of the instruction begins."""
    return HEADER + 3 * row[WIDTH] * row[HEIGHT]


@inline
def means_of(row: Row) -> int:
    """Return the index in the row of the objects' numbers, by identity - 1; each says which descriptions match."""
    return HEADER + 3 * row[WIDTH] * row[HEIGHT] + BLOCK


@inline
def is_meant(bits: int, clause: int) -> bool:
    """Return whether a clause's first description matches an object whose number in the row is ``bits``."""
    return bits >> 2 * clause & 1 != 0


@inline
def noted_of(row: Row) -> int:
    """Return the index in the row of the cells' numbers; each says which descriptions match the object noted there."""
    return HEADER + 4 * row[WIDTH] * row[HEIGHT] + BLOCK


VERBS: dict[type[Clause], int] = {GoTo: GO_TO, Open: OPEN, Pickup: PICK_UP, PutNext: PUT_NEXT}
JOINS: dict[type, int] = {Before: BEFORE, After: AFTER}
UNSAID = -1  # in the place of PLURAL: "a" or "the" was not said


def to_numbers(instruction: Instruction) -> NDArray[np.int64]:
    """Return the block that encodes an instruction, int64[BLOCK], not yet bound to any layout."""
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


def thing_numbers(thing: ObjectDescription) -> tuple[int, int, int, int]:
    """Return a description's kind, colour and place as numbers or ANY; and 1 if it is plural, 0 if not, or UNSAID."""
    return (
        ANY if thing.kind is None else KINDS.index(thing.kind),
        ANY if thing.colour is None else COLOURS.index(thing.colour),
        ANY if thing.place is None else PLACES.index(thing.place),
        UNSAID if thing.many is None else int(thing.many),
    )


def block(row: Row) -> Row:
    """Return the block of a state's instruction as a view, int32[BLOCK]."""
    begin = HEADER + 3 * int(row[WIDTH]) * int(row[HEIGHT])  # not `block_of`, a kernel that would be compiled first
    return row[begin : begin + BLOCK]


def described_objects(row: Row) -> Row:
    """Return a view of the objects' numbers, by identity - 1; bit ``d`` says whether description ``d`` matches."""
    cells = int(row[WIDTH]) * int(row[HEIGHT])
    begin = HEADER + 3 * cells + BLOCK
    return row[begin : begin + int(row[OBJECTS])]


def instruction_of(row: Row) -> Instruction:
    """Return the instruction that a state encodes."""
    instruction: Instruction = _build_instruction(*_sentence_numbers(block(row).tobytes()), _build_clause)
    return instruction


def sentence_of(row: Row) -> str:
    """Return the instruction of a state as a sentence."""
    return _sentence(block(row).tobytes())


def clauses_done(row: Row) -> tuple[tuple[str, int], ...]:
    """Return the clauses of a state's instruction as text, each with the number of the step that completed it.

    The number is 0 for a clause that is not satisfied.
    """
    lines = block(row)[CLAUSES:].reshape(-1, CLAUSE)
    return tuple(
        (str(clause), int(line[WHEN]) if line[STATUS] == SATISFIED else 0)
        for clause, line in zip(clauses(instruction_of(row)), lines, strict=False)
    )


@lru_cache(maxsize=4096)
def _sentence(numbers: bytes) -> str:
    return str(_build_instruction(*_sentence_numbers(numbers), _clause_text))


def _sentence_numbers(block_bytes: bytes) -> tuple[int, int, int, tuple[tuple[int, ...], ...]]:
    """Return the numbers of a block that determine the sentence.

    They are the join, the number of clauses in the first part, the flag IN_ORDER_STRICTLY (1 or 0), and for each clause
    its verb, whether it is strict, and its two descriptions.
    """
    numbers = np.frombuffer(block_bytes, np.int32).tolist()
    clause_count = numbers[LEFT] + numbers[RIGHT]
    clauses = []
    for start in range(CLAUSES, CLAUSES + CLAUSE * clause_count, CLAUSE):
        clause = numbers[start : start + CLAUSE]
        clauses.append((*clause[:STATUS], *clause[THING:]))
    return numbers[JOIN], numbers[LEFT], numbers[FLAGS] & IN_ORDER_STRICTLY, tuple(clauses)


@lru_cache(maxsize=4096)
def _build_instruction(
    join: int,
    first_count: int,
    strict: int,
    clause_numbers: tuple[tuple[int, ...], ...],
    build_clause: Callable[..., Any],
) -> Any:
    """Return the instruction that numbers encode.

    Args:
        join: how the parts are joined: ALONE, BEFORE or AFTER.
        first_count: the number of clauses in the first part.
        strict: 1 if doing the second part first is failure, else 0.
        clause_numbers: the numbers of each clause, as `_sentence_numbers` returns them.
        build_clause: a function that returns a clause, or its text, from its numbers.
    """
    built_clauses = [build_clause(*numbers) for numbers in clause_numbers]
    first = built_clauses[0] if first_count == 1 else And(*built_clauses[:first_count])
    if join == ALONE:
        return first
    if first_count + 1 == len(built_clauses):
        second = built_clauses[first_count]
    else:
        second = And(*built_clauses[first_count:])
    if join == BEFORE:
        return Before(first, second, bool(strict))
    return After(first, second, bool(strict))


@lru_cache(maxsize=4096)
def _build_clause(verb: int, strict: int, *numbers: int) -> Clause:
    thing = _build_description(*numbers[:4])
    if verb == PUT_NEXT:
        return PutNext(thing, _build_description(*numbers[4:]), bool(strict))
    if verb == GO_TO:
        return GoTo(thing)
    if verb == OPEN:
        return Open(thing, bool(strict))
    return Pickup(thing, bool(strict))


@lru_cache(maxsize=4096)
def _clause_text(*numbers: int) -> str:
    return str(_build_clause(*numbers))


@lru_cache(maxsize=512)
def _build_description(kind: int, colour: int, place: int, is_plural: int) -> ObjectDescription:
    return ObjectDescription(
        None if kind == ANY else KINDS[kind],
        None if colour == ANY else COLOURS[colour],
        None if place == ANY else PLACES[place],
        bool(is_plural),
    )
