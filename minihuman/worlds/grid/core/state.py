"""The state of a grid world: one row of int32, so that a batch of worlds is a matrix and a copy is a copy of a row.

A row is a header, then the cells (column by column: `x * height + y`), then two numbers per object: the cell it lies
in, and the code of what it contains. Kernels work on rows; `State` reads one by name.

A world's own object kinds have the numbers 11 to 15. What each of them allows is four bits in the header, so one
compiled kernel plays every world, and a copy or a hash of the row holds them.
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
SEE_THROUGH = 9  # bit 0: walls hide nothing; above it what kinds of the world's own let happen
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

_POSITIVE = (1 << 31) - 1  # bits of a number that is 0 or more; of a negative one they are more than any size
NOWHERE = -1  # an object's cell while it is carried, contained or gone


def row_length(width: int, height: int) -> int:
    """Return how many numbers the state of a world of this size takes."""
    return HEADER + 3 * width * height


@inline
def place_index(row: Row, identity: int) -> int:
    """Return where in the row the cell is that an object lies in."""
    return HEADER + row[WIDTH] * row[HEIGHT] + identity - 1


@inline
def where_is(row: Row, identity: int) -> int:
    """Return the cell (x * height + y) an object lies in, NOWHERE while it lies in none."""
    return row[place_index(row, identity)]


@inline
def contents_index(row: Row, identity: int) -> int:
    """Return where in the row the code of an object's contents is; 0 there means nothing inside."""
    return HEADER + 2 * row[WIDTH] * row[HEIGHT] + identity - 1


@kernel("(int32[::1],)", hold_gil=True)
def clear(row: Row) -> None:
    """Make the row an empty floor before a layout: no objects, no agent, step 0; sizes and settings stay."""
    row[X] = row[Y] = row[DIRECTION] = -1
    row[CARRYING] = EMPTY
    row[STEP] = 0
    row[PHASE] = NEW
    row[OBJECTS:] = 0
    row[HEADER : HEADER + row[WIDTH] * row[HEIGHT]] = EMPTY


@kernel("int64(int32[::1], int64, int64)", "int64(int16[::1], int64, int64)", only=True)
def cell_at(row: Row, x: int, y: int) -> int:
    """Return the code in a cell; outside the grid everything is wall."""
    is_inside = (int(x) & _POSITIVE < row[WIDTH]) & (int(y) & _POSITIVE < row[HEIGHT])
    place = np.uint64(HEADER + x * row[HEIGHT] + y if is_inside else 0)  # unsigned: not looked for from the end
    return row[place] if is_inside else GREY_WALL


@kernel("int64(int32[::1], int64, int64)", "int64(int16[::1], int64, int64)", only=True)
def lift(row: Row, x: int, y: int) -> int:
    """Return empty a cell and return what lay there. Outside the grid nothing does, and the row is marked FAILED."""
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
    """Lay a code into a cell of the grid, instead of whatever was there; objects know where they lie.

    Outside the grid nothing is laid, and the row is marked FAILED.
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
    """Move an object that lies in a cell to an empty one (x * height + y)."""
    place = place_index(row, identity)
    row[HEADER + cell] = row[HEADER + row[place]]
    row[HEADER + row[place]] = EMPTY
    row[place] = cell


@kernel("int64(int32[::1], int64, int64, int64)", only=True)
def make(row: Row, kind: int, colour: int, state: int) -> int:
    """Make a new object with its own identity, lying nowhere yet. More objects than cells mark the row FAILED."""
    if row[OBJECTS] >= row[WIDTH] * row[HEIGHT]:
        row[FAILED] = 1
        return EMPTY
    row[OBJECTS] += 1
    row[place_index(row, row[OBJECTS])] = NOWHERE
    return pack(kind, colour, state, row[OBJECTS])


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """One row, by name. The arrays are views: they change with the world, and writing to them changes it."""

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
        """Return where the agent looks: 0 right, 1 down, 2 left, 3 up."""
        return int(self.row[DIRECTION])

    @property
    def carrying(self) -> int:
        """Return the code of the object in hand; EMPTY for none."""
        return int(self.row[CARRYING])

    @property
    def step(self) -> int:
        """Return the steps taken in this episode."""
        return int(self.row[STEP])

    @property
    def max_steps(self) -> int:
        """Return the steps after which the episode is truncated."""
        return int(self.row[MAX_STEPS])

    @property
    def cells(self) -> NDArray[np.int32]:
        """Return the codes, (width, height), indexed [x, y]; read them with the functions of ``cells``."""
        return self.row[HEADER : HEADER + self.width * self.height].reshape(self.width, self.height)

    @property
    def kinds(self) -> NDArray[np.integer[Any]]:
        """Return the kinds, (width, height), indexed [x, y]: places in ``cells.KINDS``."""
        return kinds_of(self.cells.astype(np.int64))

    @property
    def colours(self) -> NDArray[np.integer[Any]]:
        """Return the colours, (width, height), indexed [x, y]: places in ``cells.COLOURS``."""
        return colours_of(self.cells.astype(np.int64))

    @property
    def states(self) -> NDArray[np.integer[Any]]:
        """Return doors' states, (width, height), indexed [x, y]: places in ``cells.DOOR_STATES``; 0 for all else."""
        return states_of(self.cells)

    @property
    def identities(self) -> NDArray[np.integer[Any]]:
        """Return the identities, (width, height), indexed [x, y]; 0 where no object lies."""
        return identities_of(self.cells)

    @property
    def contents(self) -> NDArray[np.int32]:
        """Return the code of what each object contains, by identity - 1; 0 for nothing."""
        cells = self.width * self.height
        return self.row[HEADER + 2 * cells : HEADER + 3 * cells]

    def find(self, identity: int) -> tuple[int, int] | None:
        """Return where an object lies; None while it is carried, inside a box, or gone."""
        cell = int(self.row[HEADER + self.width * self.height + identity - 1])
        if cell == NOWHERE:
            return None
        return divmod(cell, self.height)


FIRST_OWN_KIND = 11  # the number of a world's first own kind
MAX_OWN_KINDS = 5

# what a kind lets happen, as bits
STEPPED_ON = 1
CARRIED = 2
HIDES = 4
OPENS = 8


@inline
def own_properties(row: Row, code: int) -> int:
    """Return the bits of an own kind; 0 for every kind of ours."""
    if kind_of(code) >= FIRST_OWN_KIND:
        return row[SEE_THROUGH] >> 1 + 4 * (kind_of(code) - FIRST_OWN_KIND) & 15
    return 0


@inline
def can_enter(row: Row, code: int) -> bool:
    """Return whether the agent can stand in a cell with this in it: own things that open let pass while open."""
    own = own_properties(row, code)
    return lets_pass(code) or own & STEPPED_ON != 0 or (own & OPENS != 0 and state_of(code) == OPEN)


@inline
def can_carry(row: Row, code: int) -> bool:
    """Return whether the agent can pick this up."""
    return can_be_carried(code) or (code != EMPTY and own_properties(row, code) & CARRIED != 0)


@inline
def hiding_looks(row: Row) -> int:
    """Return the looks of own things that hide what is behind: bit ``kind | state << 4``; an open one hides nothing."""
    looks = 0
    for own in range(MAX_OWN_KINDS if row[SEE_THROUGH] > 1 else 0):
        bits = row[SEE_THROUGH] >> 1 + 4 * own & 15
        if bits & HIDES:
            looks |= 1 << FIRST_OWN_KIND + own | 1 << FIRST_OWN_KIND + own + 16 | 1 << FIRST_OWN_KIND + own + 32
            if bits & OPENS:
                looks &= ~(1 << FIRST_OWN_KIND + own)
    return looks
