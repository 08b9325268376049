"""What can stand in a cell, as one number: kind, colour, state and identity packed together.

The numbers of kinds, colours and states are Minigrid's, so an observation reads the same here and there.
"""

from minihuman.worlds.colours import COLOURS as COLOURS
from minihuman.worlds.kernels import inlined

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


@inlined
def pack(kind: int, colour: int, state: int, identity: int) -> int:
    """The cell's number; ``identity`` is 0 for scenery."""
    return kind | colour << 4 | state << 7 | identity << 9


@inlined
def kind_of(code: int) -> int:
    """The kind, an index into KINDS."""
    return code & 15


@inlined
def colour_of(code: int) -> int:
    """The colour, an index into COLOURS."""
    return code >> 4 & 7


@inlined
def state_of(code: int) -> int:
    """A door's state, an index into DOOR_STATES; 0 for everything else."""
    return code >> 7 & 3


@inlined
def identity_of(code: int) -> int:
    """The object's number within its world, 1 for the first made; 0 for scenery."""
    return code >> 9


@inlined
def in_state(code: int, state: int) -> int:
    """The same object in another state."""
    return code & ~(3 << 7) | state << 7


@inlined
def lets_pass(code: int) -> bool:
    """Whether the agent can stand here."""
    kind = code & 15
    return kind == EMPTY or kind == FLOOR or kind == GOAL or kind == LAVA or (kind == DOOR and code >> 7 & 3 == OPEN)


@inlined
def can_be_carried(code: int) -> bool:
    """Whether the agent can pick this up."""
    kind = code & 15
    return kind == KEY or kind == BALL or kind == BOX
