"""Draws, placements and moves in translated rules, for Numba: what `Layout` and `OwnRules` do, with the same draws.

Each function takes the address of a world's context (see `context`), and most the number of a place in the author's
source. Numbers that index a row are those of `minihuman.worlds.grid.core.state`: 0 and 1 are its columns and rows, 2 to
5 the agent, 11 the number of objects, 23 a failed layout, and 24 the first of the cells.
"""
# mypy: ignore-errors

import numba
import numpy as np
from numba import types

from minihuman.worlds import rng
from minihuman.worlds.grid.core import placement, state
from minihuman.worlds.grid.core.bodies import BLOCK
from minihuman.worlds.grid.own.elements import check_code
from minihuman.worlds.grid.own.faults import BAD_RANGE, INDEX, NO_AGENT, NO_PLACE, OUTSIDE, TOO_MANY, WRONG_COLOUR
from minihuman.worlds.grid.own.numba_forms import fail, mission, njit, numba_form, overloaded, rng_state, row

put_code = numba_form(state.put)
lift_code = numba_form(state.lift)
move_code = numba_form(state.move)
make_code = numba_form(state.make)
cell_code = numba_form(state.cell_at)
clear_row = numba_form(state.clear)
draw_place = numba_form(placement.draw_place)
draw_integer = numba_form(rng.integer)
draw_unit = numba_form(rng.unit)


@njit
def draw(c, place, low, high):
    """Draw a whole number in [low, high), as NumPy's generator does; a range that is empty or too wide is a fault."""
    if low >= high or high - low > 4294967295:  # 2**32 - 1
        fail(c, place, BAD_RANGE, low, high)
    return draw_integer(rng_state(c), low, high)


@njit
def draw_random(c, place):
    """Draw a number in [0, 1), as NumPy's generator does."""
    return draw_unit(rng_state(c)) * (1.0 / 9007199254740992.0)  # 2**53


@njit
def choice(c, place, options):
    """Draw one of a tuple's values."""
    return options[draw(c, place, 0, len(options))]


@njit
def width(c):
    """Return the number of columns."""
    return np.int64(row(c)[0])


@njit
def height(c):
    """Return the number of rows."""
    return np.int64(row(c)[1])


@njit
def code_at(c, x, y):
    """Return the code of the cell (x, y). All cells outside the grid are walls."""
    return np.int64(cell_code(row(c), x, y))


@njit
def is_inside(c, x, y):
    """Return whether a cell is in the grid."""
    return 0 <= x < np.int64(row(c)[0]) and 0 <= y < np.int64(row(c)[1])


@njit
def find(c, place, identity):
    """Return the cell (x, y) of an object; None if it lies in no cell. An identity that cannot exist is a fault."""
    if identity < 1 or identity > np.int64(row(c)[0]) * np.int64(row(c)[1]):
        fail(c, place, INDEX, identity, np.int64(row(c)[0]) * np.int64(row(c)[1]))
    cell = np.int64(row(c)[24 + np.int64(row(c)[0]) * np.int64(row(c)[1]) + identity - 1])
    if cell == -1:
        return None
    return cell // np.int64(row(c)[1]), cell % np.int64(row(c)[1])


@njit
def body_start(c, bodies, body):
    """Return the index in the row of a body's column; its row, direction and carried object follow."""
    # the first body is in the header; the others have blocks at the end of the row
    return np.int64(2) if body == 0 else row(c).shape[0] - BLOCK * (bodies - body)


@njit
def is_body_at(c, bodies, x, y):
    """Return whether any of the ``bodies`` bodies stands in the cell (x, y)."""
    for body in range(bodies):
        start = body_start(c, bodies, body)
        if np.int64(row(c)[start]) == x and np.int64(row(c)[start + 1]) == y:
            return True
    return False


@njit
def remove(c, x, y):
    """Empty the cell (x, y) and return its code; outside the grid, do nothing and return the code of empty."""
    if not is_inside(c, x, y):
        return np.int64(1)
    return np.int64(lift_code(row(c), x, y))


@njit
def move(c, bodies, identity, x, y):
    """Move an object into the cell (x, y); return whether it was moved.

    It is not moved if it lies in no cell, or if the cell is not empty, outside the grid or one in which a body stands.
    """
    if identity < 1 or identity > np.int64(row(c)[11]) or not is_inside(c, x, y) or is_body_at(c, bodies, x, y):
        return False
    if row(c)[24 + np.int64(row(c)[0]) * np.int64(row(c)[1]) + identity - 1] < 0 or cell_code(row(c), x, y) != 1:
        return False
    move_code(row(c), identity, x * np.int64(row(c)[1]) + y)
    return True


@njit
def make_item(c, place, kind, colour, door_state, has_identity):
    """Return the code of a new item; it is a fault if the grid has as many objects with identities as it can have.

    The numbers are those of `source_names.item_numbers`; if ``has_identity`` is 0, the item is scenery.
    """
    if has_identity == 0:
        return kind | colour << 4
    if np.int64(row(c)[11]) >= np.int64(row(c)[0]) * np.int64(row(c)[1]) or np.int64(row(c)[11]) >= 4194303:
        fail(c, place, TOO_MANY, np.int64(row(c)[11]), 0)
    return np.int64(make_code(row(c), kind, colour, door_state))


@njit
def put(c, place, item_fields, x, y):
    """Put a new item into the cell (x, y); return its identity, x and y. A cell outside the grid is a fault.

    ``item_fields`` are the eight numbers of the item, as `source_names.item_numbers` returns them.
    """
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    code = make_item(c, place, item_fields[0], item_fields[1], item_fields[2], item_fields[3])
    if item_fields[4] >= 0:
        inside = make_item(c, place, item_fields[4], item_fields[5], item_fields[6], item_fields[7])
        row(c)[24 + 2 * np.int64(row(c)[0]) * np.int64(row(c)[1]) + (code >> 9) - 1] = inside
    put_code(row(c), x, y, code)
    return code >> 9, np.int64(x), np.int64(y)


@njit
def put_line(c, place, item_fields, x, y, dx, dy, length):
    """Put a new item into each of ``length`` cells from (x, y) on, with the step (dx, dy) between them."""
    for i in range(length):
        put(c, place, item_fields, x + i * dx, y + i * dy)


@njit
def put_code_checked(c, place, x, y, code):
    """Put a code into the cell (x, y), as the kernel `state.put` does; a code of no existing object is a fault."""
    check_code(c, place, code)
    put_code(row(c), x, y, code)


@njit
def wall_rect(c, place, x, y, w, h):
    """Put the four walls of a room of w x h cells, whose first corner is the cell (x, y)."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    if not is_inside(c, x + w - 1, y + h - 1):
        fail(c, place, OUTSIDE, x + w - 1, y + h - 1)
    for i in range(w):
        put_code(row(c), x + i, y, 82)  # 82 is the code of a grey wall
        put_code(row(c), x + i, y + h - 1, 82)
    for j in range(h):
        put_code(row(c), x, y + j, 82)
        put_code(row(c), x + w - 1, y + j, 82)


@njit
def clear_cell(c, place, x, y):
    """Make the cell (x, y) empty; a cell outside the grid is a fault."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    put_code(row(c), x, y, 1)  # 1 is the code of an empty cell


@njit
def is_taken(c, bodies, x, y):
    """Return whether a body other than the first stands in the cell (x, y)."""
    for body in range(1, bodies):
        start = body_start(c, bodies, body)
        if np.int64(row(c)[start]) == x and np.int64(row(c)[start + 1]) == y:
            return True
    return False


@njit
def draw_cell(c, place, bodies, top, size, tries):
    """Return a random free cell (x, y) of a rectangle in which no body stands.

    It is a fault if there is none, or if none is found in ``tries`` draws. ``top`` is the rectangle's top left cell,
    and ``size`` its numbers of columns and rows.
    """
    for _ in range(tries):
        x, y = draw_place(row(c), rng_state(c), top[0], top[1], size[0], size[1], 1 << 30)
        if x < 0:
            row(c)[23] = 0
            fail(c, place, NO_PLACE, size[0], size[1])
        if not is_taken(c, bodies, x, y):
            return np.int64(x), np.int64(y)
    fail(c, place, NO_PLACE, size[0], size[1])
    return np.int64(0), np.int64(0)


@njit
def place_item(c, place, bodies, item_fields, top, size, tries):
    """Put a new item into a random free cell of a rectangle; return its identity, x and y.

    The parameters are those of `draw_cell` and `put`.
    """
    x, y = draw_cell(c, place, bodies, top, size, tries)
    return put(c, place, item_fields, x, y)


@njit
def stand(c, place, bodies, body, x, y, direction):
    """Put a body into the cell (x, y), which is not checked, looking in a direction; a missing body is a fault."""
    if body < 0 or body >= bodies:
        fail(c, place, INDEX, body, bodies)
    start = body_start(c, bodies, body)
    row(c)[start] = x
    row(c)[start + 1] = y
    row(c)[start + 2] = direction


@njit
def put_agent(c, place, bodies, x, y, direction, body):
    """Put a body into the cell (x, y), looking in a direction; a cell outside the grid is a fault."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    stand(c, place, bodies, body, x, y, direction)


@njit
def place_agent(c, place, bodies, top, size, direction, body):
    """Put a body into a random free cell of a rectangle, and return the cell (x, y); a direction of -1 is drawn."""
    stand(c, place, bodies, body, -1, -1, -1)
    x, y = draw_cell(c, place, bodies, top, size, 1 if bodies == 1 else 10_000)
    way = draw_integer(rng_state(c), 0, 4) if direction == -1 else direction
    stand(c, place, bodies, body, x, y, way)
    return x, y


@overloaded
def colour_number(c, place, colour, numbers):
    """Return the number of a colour; it is a fault if there is no such colour.

    ``colour`` is a tuple with the number of its name among the program's texts, and ``numbers`` has by number of a text
    the number of the colour, or -1.
    """

    def look_up(c, place, colour, numbers):
        if numbers[colour[0]] < 0:
            fail(c, place, WRONG_COLOUR, colour[0], 0)
        return numbers[colour[0]]

    return look_up


@overloaded
def text_part(c, place, nth, part):
    """Record the text (a tuple with its number) or whole number that fills placeholder ``nth`` of the mission."""
    if isinstance(part, types.UniTuple) and len(part) == 1:

        def record_text(c, place, nth, part):
            mission(c)[1 + 2 * nth] = 1
            mission(c)[2 + 2 * nth] = part[0]

        return record_text
    if isinstance(part, types.Integer):

        def record_number(c, place, nth, part):
            mission(c)[1 + 2 * nth] = 0
            mission(c)[2 + 2 * nth] = part

        return record_number
    raise numba.core.errors.TypingError("a mission's placeholder takes a text or a whole number")


@njit
def set_task(c, nth, number):
    """Set the number of the task (``nth`` is 0), or the task's parameter with the number ``nth``, from 1."""
    row(c)[12 + nth] = number


@njit
def ahead(x, y, direction):
    """Return the next cell (x, y) in a direction."""
    # as in `cells.ahead`
    return x + (1 - direction) * (1 - direction % 2), y + (2 - direction) * (direction % 2)


@njit
def move_to_cell(c, place, identity, cell):
    """Move an object to an empty cell (x * height + y), as the kernel `state.move` does.

    It is a fault if the object lies in no cell, or the cell is outside the grid.
    """
    count = np.int64(row(c)[0]) * np.int64(row(c)[1])
    if identity < 1 or identity > np.int64(row(c)[11]) or cell < 0 or cell >= count:
        fail(c, place, OUTSIDE, identity, cell)
    if np.int64(row(c)[24 + count + identity - 1]) < 0:
        fail(c, place, OUTSIDE, identity, cell)
    move_code(row(c), identity, cell)


@njit
def draw_once(c, place, top, size):
    """Return a random empty cell (x, y) of a rectangle in which the first body does not stand; none is a fault.

    ``top`` and ``size`` are as in `draw_cell`.
    """
    x, y = draw_place(row(c), rng_state(c), top[0], top[1], size[0], size[1], 1 << 30)
    if x < 0:
        row(c)[23] = 0
        fail(c, place, NO_PLACE, size[0], size[1])
    return np.int64(x), np.int64(y)


@njit
def check_bodies(c, place, bodies):
    """Check that every body stands in a cell of the grid, alone, and looks in a direction; otherwise it is a fault."""
    for body in range(bodies):
        start = body_start(c, bodies, body)
        x = np.int64(row(c)[start])
        y = np.int64(row(c)[start + 1])
        if not is_inside(c, x, y) or np.int64(row(c)[start + 2]) < 0 or np.int64(row(c)[start + 2]) > 3:
            fail(c, place, NO_AGENT, x, y)
        for other in range(body):
            at = body_start(c, bodies, other)
            if np.int64(row(c)[at]) == x and np.int64(row(c)[at + 1]) == y:
                fail(c, place, NO_AGENT, x, y)


@njit
def clear_bodies(c, bodies):
    """Remove every body but the first, which `clear_row` removes."""
    for body in range(1, bodies):
        start = body_start(c, bodies, body)
        row(c)[start] = -1
        row(c)[start + 1] = -1
        row(c)[start + 2] = -1
        row(c)[start + 3] = 1


@njit
def body(c, place, bodies, nth):
    """Return the column, row, direction and the code of what it carries of body ``nth``; a missing body is a fault."""
    if nth < 0 or nth >= bodies:
        fail(c, place, INDEX, nth, bodies)
    start = body_start(c, bodies, nth)
    return (
        np.int64(row(c)[start]),
        np.int64(row(c)[start + 1]),
        np.int64(row(c)[start + 2]),
        np.int64(row(c)[start + 3]),
    )
