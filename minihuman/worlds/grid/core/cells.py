"""The code of a cell, which packs kind, colour, state and identity into one number; and the four directions.

The numbers of kinds, colours and states are Minigrid's, so observations are the same. Directions are 0 right, 1 down,
2 left, 3 up.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.colours import COLOURS as COLOURS
from minihuman.worlds.kernels import inline

STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by direction: columns, rows


@inline
def ahead(x: int, y: int, direction: int) -> tuple[int, int]:
    """Return the column and row of the next cell in a direction, in the grid or not; ``direction ^ 2`` is opposite."""
    # as in STEPS: for x, 1 in direction 0 and -1 in direction 2; for y, 1 in direction 1 and -1 in direction 3
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
    """Return the code of a cell with these properties.

    Args:
        kind: the index of the kind in KINDS.
        colour: the index of the colour in COLOURS.
        state: the index of a door's state in DOOR_STATES; 0 for everything else.
        identity: the number of the object in the world, from 1; 0 for scenery.
    """
    return kind | colour << 4 | state << 7 | identity << 9


@inline
def kind_of(code: int) -> int:
    """Return the kind in a code, an index into KINDS."""
    return code & 15


@inline
def colour_of(code: int) -> int:
    """Return the colour in a code, an index into COLOURS."""
    return code >> 4 & 7


@inline
def state_of(code: int) -> int:
    """Return a door's state in a code, an index into DOOR_STATES; 0 for everything else."""
    return code >> 7 & 3


@inline
def identity_of(code: int) -> int:
    """Return the identity in a code: objects are numbered from 1 in the order in which they are made; scenery has 0."""
    return code >> 9


@inline
def in_state(code: int, state: int) -> int:
    """Return the code of the same object in another state."""
    return code & ~(3 << 7) | state << 7


@inline
def in_colour(code: int, colour: int) -> int:
    """Return the code of the same object in another colour."""
    return code & ~(7 << 4) | colour << 4


@inline
def look_of(code: int) -> int:
    """Return the kind and state in a cell's code, without colour and identity: ``kind | state << 4``."""
    return code & 15 | code >> 3 & 48


@inline
def lets_pass(code: int) -> bool:
    """Return whether the agent can stand in a cell with this code, if its kind is one of KINDS."""
    kind = kind_of(code)
    return kind == EMPTY or kind == FLOOR or kind == GOAL or kind == LAVA or (kind == DOOR and state_of(code) == OPEN)


@inline
def can_be_carried(code: int) -> bool:
    """Return whether the agent can pick up an object with this code, if its kind is one of KINDS."""
    kind = kind_of(code)
    return kind == KEY or kind == BALL or kind == BOX


CellCodes = TypeVar("CellCodes", int, NDArray[np.integer[Any]])  # one code or an array, for plain Python


def kinds_of(codes: CellCodes) -> CellCodes:
    """Return the kind in each code, as `kind_of` does for one."""
    return codes & 15


def colours_of(codes: CellCodes) -> CellCodes:
    """Return the colour in each code, as `colour_of` does for one."""
    return codes >> 4 & 7


def states_of(codes: CellCodes) -> CellCodes:
    """Return the state in each code, as `state_of` does for one."""
    return codes >> 7 & 3


def identities_of(codes: CellCodes) -> CellCodes:
    """Return the identity in each code, as `identity_of` does for one."""
    return codes >> 9
