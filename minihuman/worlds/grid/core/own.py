"""Kinds of a world's own, as kernels see them: four bits a kind, kept in the row beside whether walls hide.

Numbers 11 to 15 are left of the sixteen that a cell has room for. What each of them lets happen is in the row, so that
one compiled kernel plays every world, and a copy or a hash of the row holds it.
"""

from minihuman.worlds.grid.core.cells import EMPTY, OPEN, can_be_carried, kind_of, lets_pass, state_of
from minihuman.worlds.grid.core.state import SEE_THROUGH, Row
from minihuman.worlds.kernels import inlined

OWN = 11  # the number of a world's first own kind
MOST_OWN = 5

STEPPED_ON, CARRIED, HIDES, OPENS = 1, 2, 4, 8  # what a kind lets happen, as bits


@inlined
def nature(row: Row, code: int) -> int:
    """The bits of an own kind; 0 for every kind of ours."""
    return row[SEE_THROUGH] >> 1 + 4 * (kind_of(code) - OWN) & 15 if kind_of(code) >= OWN else 0


@inlined
def passes(row: Row, code: int) -> bool:
    """Whether the agent can stand in a cell with this in it: own things that open let pass while they are open."""
    own = nature(row, code)
    return lets_pass(code) or own & STEPPED_ON != 0 or (own & OPENS != 0 and state_of(code) == OPEN)


@inlined
def carries(row: Row, code: int) -> bool:
    """Whether the agent can pick this up."""
    return can_be_carried(code) or (code != EMPTY and nature(row, code) & CARRIED != 0)


@inlined
def hiding_looks(row: Row) -> int:
    """What own things hide what is behind them: bit ``kind | state << 4`` of a number; an open one hides nothing."""
    looks = 0
    for own in range(MOST_OWN if row[SEE_THROUGH] > 1 else 0):
        bits = row[SEE_THROUGH] >> 1 + 4 * own & 15
        if bits & HIDES:
            looks |= 1 << OWN + own | 1 << OWN + own + 16 | 1 << OWN + own + 32
            if bits & OPENS:
                looks &= ~(1 << OWN + own)
    return looks
