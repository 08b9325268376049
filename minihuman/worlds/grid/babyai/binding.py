"""Binding: which objects of a layout match an instruction's descriptions, and whether the instruction makes sense.

`instruct` sets an instruction on a finished layout, for worlds written in Python.
"""

from minihuman.errors import WorldError
from minihuman.worlds.grid.babyai.encoding import (
    ANY,
    BEHIND,
    CLAUSE,
    CLAUSES,
    COLOUR,
    FLAGS,
    IN_FRONT,
    KIND,
    LEFT,
    ON_LEFT,
    OTHER,
    OWN_STEPS,
    PLACE,
    PLURAL,
    PUT_NEXT,
    RIGHT,
    ROOM,
    SAY_DONE,
    THING,
    VERB,
    block,
    block_of,
    instructed_length,
    means_of,
    to_numbers,
)
from minihuman.worlds.grid.babyai.language import Instruction
from minihuman.worlds.grid.babyai.verifier import is_beside, note_places
from minihuman.worlds.grid.core.cells import DOOR, GREY, KEY, LOCKED, WALL, ahead, colour_of, kind_of, state_of
from minihuman.worlds.grid.core.rewards import INSTRUCTED
from minihuman.worlds.grid.core.state import (
    DIRECTION,
    HEADER,
    HEIGHT,
    NOWHERE,
    OBJECTS,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    where_is,
)
from minihuman.worlds.kernels import device_function, kernel


@device_function()
def lies_so(row: Row, cell: int, place: int) -> bool:
    """Return whether a cell is in the agent's room, walls included, and on the given side of the agent.

    Args:
        row: the state, with the agent at its first pose.
        cell: the number of the cell, x * height + y.
        place: the side: ON_LEFT, ON_RIGHT, IN_FRONT or BEHIND; for ANY, the result is True wherever the cell is.
    """
    if place == ANY:
        return True
    height = row[HEIGHT]
    x = cell // height
    y = cell % height
    room = row[block_of(row) + ROOM]
    if room > 0:
        left = row[X] // (room - 1) * (room - 1)
        top = row[Y] // (room - 1) * (room - 1)
        if x < left or y < top or x >= left + room or y >= top + room:
            return False
    ahead_x, ahead_y = ahead(0, 0, row[DIRECTION])
    right = x - row[X]
    down = y - row[Y]
    onward = right * ahead_x + down * ahead_y
    aside = down * ahead_x - right * ahead_y  # to the right
    if place == ON_LEFT:
        return aside < 0
    if place == IN_FRONT:
        return onward > 0
    if place == BEHIND:
        return onward < 0
    return aside > 0


@device_function()
def fits(row: Row, identity: int, kind: int, colour: int, place: int) -> bool:
    """Return whether the object with an identity lies in a cell and has this kind, colour and place, each maybe ANY."""
    cell = where_is(row, identity)
    if cell == NOWHERE:
        return False
    code = row[HEADER + cell]
    return (
        (kind == ANY or kind_of(code) == kind)
        and (colour == ANY or colour_of(code) == colour)
        and lies_so(row, cell, place)
    )


@device_function()
def count_walls(row: Row, colour: int, place: int) -> int:
    """Return the number of wall cells of a colour in a place (see `lies_so`), two at most; ANY matches everything.

    Minigrid counts walls among the objects that match "a grey object", and if there are several matching objects, the
    sentence has the article "a" instead of "the".
    """
    count = 0
    for cell in range(row[WIDTH] * row[HEIGHT]):
        code = row[HEADER + cell]
        if kind_of(code) == WALL and (colour == ANY or colour_of(code) == colour) and lies_so(row, cell, place):
            count += 1
            if count == 2:
                break
    return count


@device_function()
def bind(row: Row) -> bool:
    """Record which objects match each description of a state's instruction, and in which cells those objects lie.

    Also record whether each description matches several things, for its article.

    Returns:
        Whether every description matches at least one object.
    """
    block = block_of(row)
    means = means_of(row)
    for k in range(row[OBJECTS]):
        row[means + k] = 0
    everything = True
    for k in range(row[block + LEFT] + row[block + RIGHT]):
        clause = block + CLAUSES + k * CLAUSE
        for which in range(2 if row[clause + VERB] == PUT_NEXT else 1):
            at = clause + (OTHER if which else THING)
            kind = row[at + KIND]
            colour = row[at + COLOUR]
            place = row[at + PLACE]
            count = 0
            for identity in range(1, row[OBJECTS] + 1):
                if fits(row, identity, kind, colour, place):
                    row[means + identity - 1] |= 1 << 2 * k + which
                    count += 1
            everything &= count > 0
            if kind == ANY and (colour == ANY or colour == GREY):
                count += count_walls(row, colour, place)
            row[at + PLURAL] = count > 1
    note_places(row)
    return everything


@device_function()
def makes_sense(row: Row, keys_matter: bool) -> bool:
    """Return whether no clause of a state's instruction asks to put an object next to itself, or where it already is.

    The instruction must be bound. With ``keys_matter``, also return False if a clause is about a key that opens a
    locked door.
    """
    block = block_of(row)
    means = means_of(row)
    for k in range(row[block + LEFT] + row[block + RIGHT]):
        clause = block + CLAUSES + k * CLAUSE
        meant = 1 << 2 * k
        if row[clause + VERB] == PUT_NEXT:
            for j in range(row[OBJECTS]):
                if row[means + j] & meant:
                    cell = where_is(row, j + 1)
                    if row[means + j] & meant << 1 or is_beside(row, cell, meant << 1):
                        return False
        if keys_matter and (
            unlocks(row, clause + THING) or (row[clause + VERB] == PUT_NEXT and unlocks(row, clause + OTHER))
        ):
            return False
    return True


@device_function()
def unlocks(row: Row, at: int) -> bool:
    """Return whether the description that begins at index ``at`` of the row is of a key in a locked door's colour."""
    if row[at + KIND] != KEY:
        return False
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE:
            code = row[HEADER + cell]
            if kind_of(code) == DOOR and state_of(code) == LOCKED and colour_of(code) == row[at + COLOUR]:
                return True
    return False


@kernel("(int32[::1],)")
def bind_now(row: Row) -> bool:
    """Call `bind` from Python, for layouts written in Python; return whether every description matches an object."""
    return bind(row)


def instruct(
    row: Row, instruction: Instruction, *, own_steps: bool = True, done_required: bool = False, room: int = 0
) -> None:
    """Set an instruction as the task of a layout in which the agent has its first pose already.

    Args:
        row: the state of a world whose mission is an `InstructionSpace`; it is changed.
        instruction: the instruction.
        own_steps: whether a step that ends the first part does not count for the second, and objects are judged by
            where they are now; in Minigrid, neither is the case.
        done_required: whether a clause only counts when the agent says "done" right after carrying it out.
        room: the number of cells on a side of a room, including its walls, for "on your left"; 0 if the whole grid is
            one room.

    Raises:
        WorldError: if the world has no space for an instruction, or a description matches no object in it.
    """
    if len(row) < instructed_length(int(row[0]), int(row[1])):
        raise WorldError("this world has no instructions; give it mission=InstructionSpace()")
    numbers = block(row)
    numbers[:] = to_numbers(instruction)
    numbers[FLAGS] |= own_steps * OWN_STEPS | done_required * SAY_DONE
    numbers[ROOM] = room
    row[TASK] = INSTRUCTED
    if not bind_now(row):
        raise WorldError(f"'{instruction}' names an object that is not in the world; add it to the layout first")
