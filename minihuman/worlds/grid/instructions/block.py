"""Where an instruction lies in a world's state: a block of numbers after the cells, in worlds that have instructions.

An instruction is one part, or two of which one comes before the other; a part is one clause, or two in any order. A
clause is a verb with one or two descriptions of things. After the block each object has a number whose bit ``d``
says that description ``d`` means it (description ``2 * clause``, and one more for what a thing is put next to), and
each cell one that says so of what lay there when places were last noted.
"""

from minihuman.worlds.grid.core.state import HEADER, HEIGHT, WIDTH, Row
from minihuman.worlds.kernels import inlined

JOIN = 0  # how the parts are joined
LEFT, RIGHT = 1, 2  # clauses in the first and the second part as they are read; 0 for no part
FLAGS = 3
HANDED = 4  # identity of what is put into the agent's hand after the first look
ROUNDS = 5  # layouts drawn until one was accepted
ROOM = 6  # cells on a side of a room, walls included, for "on your left"; 0: the grid is one room
CLAUSES = 8  # the first clause
MOST_CLAUSES = 4

VERB = 0  # within a clause
STRICT = 1  # doing it to anything else is failure
STATUS = 2
WHEN = 3  # the step in which it was satisfied
HELD = 4  # identity of what was in hand when it was last judged; 0 for nothing
MATCHED = 5  # where "done" must be said: the last step has done it
THING = 6  # the description: kind, colour, place (-1: any), and whether it means more than one thing
OTHER = 10  # the second description
KIND, COLOUR, PLACE, PLURAL = range(4)
CLAUSE = 14  # numbers a clause

BLOCK = CLAUSES + MOST_CLAUSES * CLAUSE

ALONE, BEFORE, AFTER = range(3)  # joins
NO_VERB, GO_TO, OPEN, PICK_UP, PUT_NEXT = range(5)
IN_ORDER_STRICTLY = 1  # flags: doing the second part first is failure
OWN_STEPS = 2  # a step that ends the first part is no step of the second, and places are noted in every step
SAY_DONE = 4  # a part ends when "done" is said right after it was done
WAITING, SATISFIED, BROKEN = range(3)  # a clause's status

ANY = -1
ON_LEFT, ON_RIGHT, IN_FRONT, BEHIND = range(4)  # places, seen from the agent's first pose


def instructed_length(width: int, height: int) -> int:
    """How many numbers the state of a world with instructions takes."""
    return HEADER + 5 * width * height + BLOCK


@inlined
def block_of(row: Row) -> int:
    """Where the block begins."""
    return HEADER + 3 * row[WIDTH] * row[HEIGHT]


@inlined
def means_of(row: Row) -> int:
    """Where the numbers begin that say by which descriptions each object is meant, from identity 1."""
    return HEADER + 3 * row[WIDTH] * row[HEIGHT] + BLOCK


@inlined
def noted_of(row: Row) -> int:
    """Where the numbers begin that say by which descriptions what lay in each cell was meant."""
    return HEADER + 4 * row[WIDTH] * row[HEIGHT] + BLOCK
