"""The code of a cell: kind, colour, state and identity packed into one number; and the four directions.

The numbers of kinds, colours and states are Minigrid's, so an observation reads the same here and there. Directions are
0 right, 1 down, 2 left, 3 up.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.colours import COLOURS as COLOURS
from minihuman.worlds.kernels import inline

STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by direction: columns, rows


@inline
def ahead(x: int, y: int, direction: int) -> tuple[int, int]:
    """Return the next cell in a direction, in the grid or not; ``direction ^ 2`` is the opposite one."""
    return x + (1 - direction) * (1 - direction % 2), y + (2 - direction) * (direction % 2)


KINDS = ("unseen", "empty", "wall", "floor", "door", "key", "ball", "box", "goal", "lava", "agent")
UNSEEN, EMPTY, WALL, FLOOR, DOOR, KEY, BALL, BOX, GOAL, LAVA, AGENT = range(len(KINDS))

RED, GREEN, BLUE, PURPLE, YELLOW, GREY = range(len(COLOURS))
SORTED_COLOURS = (BLUE, GREEN, GREY, PURPLE, RED, YELLOW)  # by English name: the order in which layouts draw them

DOOR_STATES = ("open", "closed", "locked")
OPEN, CLOSED, LOCKED = range(len(DOOR_STATES))

# kind: bits 0-3, colour: bits 4-6, state: bits 7-8, identity: the rest (0 for scenery, which has none)
GREY_WALL = WALL | GREY << 4
GREEN_GOAL = GOAL | GREEN << 4
RED_LAVA = LAVA | RED << 4


@inline
def pack(kind: int, colour: int, state: int, identity: int) -> int:
    """Return the cell's number; ``identity`` is 0 for scenery."""
    return kind | colour << 4 | state << 7 | identity << 9


@inline
def kind_of(code: int) -> int:
    """Return the kind, an index into KINDS."""
    return code & 15


@inline
def colour_of(code: int) -> int:
    """Return the colour, an index into COLOURS."""
    return code >> 4 & 7


@inline
def state_of(code: int) -> int:
    """Return a door's state, an index into DOOR_STATES; 0 for everything else."""
    return code >> 7 & 3


@inline
def identity_of(code: int) -> int:
    """Return the object's number within its world, 1 for the first made; 0 for scenery."""
    return code >> 9


@inline
def in_state(code: int, state: int) -> int:
    """Return the same object in another state."""
    return code & ~(3 << 7) | state << 7


@inline
def in_colour(code: int, colour: int) -> int:
    """Return the same object in another colour."""
    return code & ~(7 << 4) | colour << 4


@inline
def look_of(code: int) -> int:
    """Return kind and state without colour and identity: ``kind | state << 4``."""
    return code & 15 | code >> 3 & 48


@inline
def lets_pass(code: int) -> bool:
    """Return whether the agent can stand here."""
    kind = kind_of(code)
    return kind == EMPTY or kind == FLOOR or kind == GOAL or kind == LAVA or (kind == DOOR and state_of(code) == OPEN)


@inline
def can_be_carried(code: int) -> bool:
    """Return whether the agent can pick this up."""
    kind = kind_of(code)
    return kind == KEY or kind == BALL or kind == BOX


CellCodes = TypeVar("CellCodes", int, NDArray[np.integer[Any]])  # one or an array, in plain Python


def kinds_of(codes: CellCodes) -> CellCodes:
    """Return `kind_of` of each code."""
    return codes & 15


def colours_of(codes: CellCodes) -> CellCodes:
    """Return `colour_of` of each code."""
    return codes >> 4 & 7


def states_of(codes: CellCodes) -> CellCodes:
    """Return `state_of` of each code."""
    return codes >> 7 & 3


def identities_of(codes: CellCodes) -> CellCodes:
    """Return `identity_of` of each code."""
    return codes >> 9
