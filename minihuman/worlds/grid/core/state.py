"""The state of a grid world: one row of int32, so that a batch of worlds is a matrix, and copying a row copies a state.

A row is a header, then the cells (column by column: `x * height + y`), then two numbers per object: the cell in which
it lies, and the code of its contents. Kernels work on rows; `State` gives access to the fields of one by name.

A world's own object kinds have the numbers 11 to 15. The properties of each are four bits in the header, so one
compiled kernel runs every world, and copies and hashes of the row include them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    EMPTY,
    GREY_WALL,
    OPEN,
    can_be_carried,
    colours_of,
    identities_of,
    identity_of,
    kind_of,
    kinds_of,
    lets_pass,
    pack,
    state_of,
    states_of,
)
from minihuman.worlds.kernels import inline, kernel

Row = NDArray[np.int32]

WIDTH = 0
HEIGHT = 1
# direction: 0 right, 1 down, 2 left, 3 up
X = 2
Y = 3
DIRECTION = 4
CARRYING = 5  # code of the object in hand, EMPTY for none
STEP = 6
MAX_STEPS = 7
PHASE = 8
SEE_THROUGH = 9  # bit 0: walls hide nothing; above it, four bits with the properties of each of the world's own kinds
ACTIONS = 10  # how many of the seven actions this world takes
OBJECTS = 11  # how many objects were made so far
TASK = 12  # which rule of `rewards` judges a step
TARGET = 13  # 13..18: what the task is about
MISSION = 19  # 19..22: the choices that fill the mission's template
FAILED = 23  # 1: the layout found no place for something
HEADER = 24

# phases
NEW = 0
PLAYING = 1
OVER = 2

_POSITIVE = (1 << 31) - 1  # a mask that keeps a coordinate of 0 or more, and makes a negative one larger than any size
NOWHERE = -1  # an object's cell while it is carried, contained or gone


def row_length(width: int, height: int) -> int:
    """Return the length of the row of state of a world of this size, without an instruction's block."""
    return HEADER + 3 * width * height


@inline
def place_index(row: Row, identity: int) -> int:
    """Return the index in the row at which an object's cell is stored."""
    return HEADER + row[WIDTH] * row[HEIGHT] + identity - 1


@inline
def where_is(row: Row, identity: int) -> int:
    """Return the cell (x * height + y) in which an object lies, or NOWHERE if it lies in none."""
    return row[place_index(row, identity)]


@inline
def contents_index(row: Row, identity: int) -> int:
    """Return the index in the row at which the code of an object's contents is stored; 0 there means no contents."""
    return HEADER + 2 * row[WIDTH] * row[HEIGHT] + identity - 1


@kernel("(int32[::1],)", hold_gil=True)
def clear(row: Row) -> None:
    """Reset the row to an empty floor without objects and agent, at step 0. Sizes and settings stay."""
    row[X] = row[Y] = row[DIRECTION] = -1
    row[CARRYING] = EMPTY
    row[STEP] = 0
    row[PHASE] = NEW
    row[OBJECTS:] = 0
    row[HEADER : HEADER + row[WIDTH] * row[HEIGHT]] = EMPTY


@kernel("int64(int32[::1], int64, int64)", "int64(int16[::1], int64, int64)", only=True)
def cell_at(row: Row, x: int, y: int) -> int:
    """Return the code of the cell (x, y). All cells outside the grid are grey walls."""
    is_inside = (int(x) & _POSITIVE < row[WIDTH]) & (int(y) & _POSITIVE < row[HEIGHT])
    place = np.uint64(HEADER + x * row[HEIGHT] + y if is_inside else 0)  # unsigned, so that no index can be negative
    return row[place] if is_inside else GREY_WALL


@kernel("int64(int32[::1], int64, int64)", "int64(int16[::1], int64, int64)", only=True)
def lift(row: Row, x: int, y: int) -> int:
    """Empty the cell (x, y) and return the code that was in it.

    For a cell outside the grid, return EMPTY and mark the row as FAILED.
    """
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        row[FAILED] = 1
        return EMPTY
    code = row[HEADER + x * row[HEIGHT] + y]
    row[HEADER + x * row[HEIGHT] + y] = EMPTY
    identity = identity_of(code)
    if identity > 0:
        row[place_index(row, identity)] = NOWHERE
    return code


@kernel("void(int32[::1], int64, int64, int64)", "void(int16[::1], int64, int64, int64)", only=True)
def put(row: Row, x: int, y: int, code: int) -> None:
    """Put a code into the cell (x, y), replacing whatever was there, and update the places of the objects.

    For a cell outside the grid, only mark the row as FAILED.
    """
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        row[FAILED] = 1
        return
    identity = identity_of(row[HEADER + x * row[HEIGHT] + y])
    if identity > 0:
        row[place_index(row, identity)] = NOWHERE
    row[HEADER + x * row[HEIGHT] + y] = code
    identity = identity_of(code)
    if identity > 0:
        row[place_index(row, identity)] = x * row[HEIGHT] + y


@kernel("(int32[::1], int64, int64)")
def move(row: Row, identity: int, cell: int) -> None:
    """Move an object from its cell to an empty one (x * height + y)."""
    place = place_index(row, identity)
    row[HEADER + cell] = row[HEADER + row[place]]
    row[HEADER + row[place]] = EMPTY
    row[place] = cell


@kernel("int64(int32[::1], int64, int64, int64)", only=True)
def make(row: Row, kind: int, colour: int, state: int) -> int:
    """Make a new object with its own identity, which lies in no cell yet; return its code.

    ``kind``, ``colour`` and ``state`` are numbers as in `cells.pack`. If there are as many objects as cells, return
    EMPTY and mark the row as FAILED.
    """
    if row[OBJECTS] >= row[WIDTH] * row[HEIGHT]:
        row[FAILED] = 1
        return EMPTY
    row[OBJECTS] += 1
    row[place_index(row, row[OBJECTS])] = NOWHERE
    return pack(kind, colour, state, row[OBJECTS])


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A row with named fields.

    The arrays are views: they change with the world, and writing to them changes the world.
    """

    row: Row

    @property
    def width(self) -> int:
        """Return the number of columns."""
        return int(self.row[WIDTH])

    @property
    def height(self) -> int:
        """Return the number of rows."""
        return int(self.row[HEIGHT])

    @property
    def position(self) -> tuple[int, int]:
        """Return the agent's column and row."""
        return int(self.row[X]), int(self.row[Y])

    @property
    def direction(self) -> int:
        """Return the direction in which the agent looks: 0 right, 1 down, 2 left, 3 up."""
        return int(self.row[DIRECTION])

    @property
    def carrying(self) -> int:
        """Return the code of the object that the agent carries; EMPTY if it carries none."""
        return int(self.row[CARRYING])

    @property
    def step(self) -> int:
        """Return the number of steps taken in this episode."""
        return int(self.row[STEP])

    @property
    def max_steps(self) -> int:
        """Return the number of steps after which the episode is truncated."""
        return int(self.row[MAX_STEPS])

    @property
    def cells(self) -> NDArray[np.int32]:
        """Return the codes of the cells, (width, height), indexed [x, y]; functions of ``core.cells`` read them."""
        return self.row[HEADER : HEADER + self.width * self.height].reshape(self.width, self.height)

    @property
    def kinds(self) -> NDArray[np.integer[Any]]:
        """Return the kinds in the cells, (width, height), indexed [x, y], as indices into ``cells.KINDS``."""
        return kinds_of(self.cells.astype(np.int64))

    @property
    def colours(self) -> NDArray[np.integer[Any]]:
        """Return the colours in the cells, (width, height), indexed [x, y], as indices into ``cells.COLOURS``."""
        return colours_of(self.cells.astype(np.int64))

    @property
    def states(self) -> NDArray[np.integer[Any]]:
        """Return the doors' states, (width, height), indexed [x, y], as indices into ``cells.DOOR_STATES``; else 0."""
        return states_of(self.cells)

    @property
    def identities(self) -> NDArray[np.integer[Any]]:
        """Return the identities of the objects in the cells, (width, height), indexed [x, y]; 0 for no object."""
        return identities_of(self.cells)

    @property
    def contents(self) -> NDArray[np.int32]:
        """Return the code of each object's contents, by identity - 1; 0 for none."""
        cells = self.width * self.height
        return self.row[HEADER + 2 * cells : HEADER + 3 * cells]

    def find(self, identity: int) -> tuple[int, int] | None:
        """Return the column and row of an object; None while it is carried or in a box, and after it is gone."""
        cell = int(self.row[HEADER + self.width * self.height + identity - 1])
        if cell == NOWHERE:
            return None
        return divmod(cell, self.height)


FIRST_OWN_KIND = 11  # the number of a world's first own kind
MAX_OWN_KINDS = 5

# the properties of a kind, as bits
STEPPED_ON = 1
CARRIED = 2
HIDES = 4
OPENS = 8


@inline
def own_properties(row: Row, code: int) -> int:
    """Return the property bits of a code's kind, such as `STEPPED_ON`, if the kind is the world's own; else 0."""
    if kind_of(code) >= FIRST_OWN_KIND:
        return row[SEE_THROUGH] >> 1 + 4 * (kind_of(code) - FIRST_OWN_KIND) & 15
    return 0


@inline
def can_enter(row: Row, code: int) -> bool:
    """Return whether the agent can stand in a cell with this code. An object that opens can be entered while open."""
    own = own_properties(row, code)
    return lets_pass(code) or own & STEPPED_ON != 0 or (own & OPENS != 0 and state_of(code) == OPEN)


@inline
def can_carry(row: Row, code: int) -> bool:
    """Return whether the agent can pick up an object with this code."""
    return can_be_carried(code) or (code != EMPTY and own_properties(row, code) & CARRIED != 0)


@inline
def hiding_looks(row: Row) -> int:
    """Return which looks of the world's own kinds hide what is behind them, with bit ``kind | state << 4`` for each.

    An object that is open hides nothing.
    """
    looks = 0
    for own in range(MAX_OWN_KINDS if row[SEE_THROUGH] > 1 else 0):
        bits = row[SEE_THROUGH] >> 1 + 4 * own & 15
        if bits & HIDES:  # in the states open, closed and locked
            looks |= 1 << FIRST_OWN_KIND + own | 1 << FIRST_OWN_KIND + own + 16 | 1 << FIRST_OWN_KIND + own + 32
            if bits & OPENS:
                looks &= ~(1 << FIRST_OWN_KIND + own)
    return looks
