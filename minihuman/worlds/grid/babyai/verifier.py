"""The verifier: whether a step has done what the instruction says, and the grid's step that it judges.

Kernels on a row of state decide here when GoTo, Open, Pickup and PutNext are done. The order of operations is
Minigrid's, and it affects results: places are noted at every "drop" but not when something is picked up, so "go to the
ball" is satisfied by the cell from which the ball was taken; and a step that ends the first part of "a, then b" is also
judged by the second. With the flag OWN_STEPS, neither is the case.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.babyai.encoding import (
    AFTER,
    ALONE,
    BROKEN,
    CLAUSE,
    CLAUSES,
    FLAGS,
    GO_TO,
    HANDED,
    HELD,
    IN_ORDER_STRICTLY,
    JOIN,
    LEFT,
    MATCHED,
    OPEN,
    OWN_STEPS,
    PICK_UP,
    RIGHT,
    SATISFIED,
    SAY_DONE,
    STATUS,
    STRICT,
    VERB,
    WAITING,
    WHEN,
    block_of,
    means_of,
    noted_of,
)
from minihuman.worlds.grid.core.cells import DOOR, EMPTY, ahead, identity_of, kind_of, state_of
from minihuman.worlds.grid.core.cells import OPEN as STANDS_OPEN
from minihuman.worlds.grid.core.rewards import INSTRUCTED, success_reward
from minihuman.worlds.grid.core.rules import act, apply, close, refusal
from minihuman.worlds.grid.core.state import (
    CARRYING,
    DIRECTION,
    HEIGHT,
    NOWHERE,
    OBJECTS,
    STEP,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    cell_at,
    lift,
    where_is,
)
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.kernels import device_function, inline, kernel
from minihuman.worlds.rng import RngState

# actions
_PICKUP = 3
_DROP = 4
_TOGGLE = 5
_DONE = 6


@device_function()
def note_places(row: Row) -> None:
    """Record in each cell's number which descriptions match the object that now lies in the cell."""
    noted = noted_of(row)
    means = means_of(row)
    row[noted : noted + row[WIDTH] * row[HEIGHT]] = 0
    for k in range(row[OBJECTS]):
        cell = where_is(row, k + 1)
        if cell != NOWHERE:
            row[noted + cell] = row[means + k]


@kernel("(int32[::1],)")
def hand_over(row: Row) -> None:
    """Put the object that the agent carries from the start, if any, into its hand, after the first observation."""
    at = block_of(row) + HANDED
    identity = row[at]
    if identity > 0:
        cell = where_is(row, identity)
        row[CARRYING] = lift(row, cell // row[HEIGHT], cell % row[HEIGHT])
        row[at] = 0


@inline
def is_any_gone(row: Row) -> bool:
    """Return whether any object lies in no cell: one that is carried, in a box or gone."""
    gone = 0
    for k in range(row[OBJECTS]):
        gone += where_is(row, k + 1) == NOWHERE
    return gone > 0


@device_function(force_inline=True)
def verify(row: Row, action: int, noted: bool) -> int:
    """Judge by the instruction the step that led to this state; return WAITING, SATISFIED or BROKEN.

    With ``noted``, nothing was carried before the step, so the recorded places of objects in cells are up to date.
    """
    block = block_of(row)
    flags = row[block + FLAGS]
    notes = action == _DROP or (flags & OWN_STEPS and (action == _PICKUP or action == _TOGGLE))
    if notes and not (noted and not is_any_gone(row)):
        note_places(row)
    left = row[block + LEFT]
    right = row[block + RIGHT]
    join = row[block + JOIN]
    if join == ALONE:
        return judge_part(row, 0, left, action)
    first = 0
    in_first = left
    second = left
    in_second = right
    if join == AFTER:
        first = left
        in_first = right
        second = 0
        in_second = left
    if not part_is_done(row, first, in_first):
        outcome = judge_part(row, first, in_first, action)
        if outcome != SATISFIED:
            strictly = outcome == WAITING and flags & IN_ORDER_STRICTLY
            if strictly and judge_part(row, second, in_second, action) == SATISFIED:
                return BROKEN
            return outcome
        if flags & (OWN_STEPS | SAY_DONE):
            return WAITING
    return judge_part(row, second, in_second, action)


@inline
def part_is_done(row: Row, first: int, clauses: int) -> bool:
    """Return whether every clause of a part is satisfied: ``clauses`` clauses from the number ``first`` on."""
    satisfied = True
    for k in range(first, first + clauses):
        satisfied &= row[block_of(row) + CLAUSES + k * CLAUSE + STATUS] == SATISFIED
    return satisfied


@device_function()
def judge_part(row: Row, first: int, clauses: int, action: int) -> int:
    """Judge a step by a part, the one or two clauses from the number ``first`` on, and return the part's status.

    A failure of a part of two clauses counts only if "done" is said when neither of them was just carried out.
    """
    if clauses == 1:
        return judge_clause(row, first, action)
    broken = 0
    for k in range(first, first + clauses):
        if row[block_of(row) + CLAUSES + k * CLAUSE + STATUS] != SATISFIED:
            broken += judge_clause(row, k, action) == BROKEN
    if part_is_done(row, first, clauses):
        return SATISFIED
    if broken == clauses and action == _DONE:
        return BROKEN
    return WAITING


@device_function()
def judge_clause(row: Row, k: int, action: int) -> int:
    """Judge a step by clause number ``k``; record and return its status: WAITING, SATISFIED or BROKEN."""
    clause = block_of(row) + CLAUSES + k * CLAUSE
    if row[block_of(row) + FLAGS] & SAY_DONE:
        if action == _DONE:
            if row[clause + MATCHED]:
                outcome = SATISFIED
            else:
                outcome = BROKEN
        else:
            row[clause + MATCHED] = does(row, clause, k, action) == SATISFIED
            outcome = WAITING
    else:
        outcome = does(row, clause, k, action)
    row[clause + STATUS] = outcome
    if outcome == SATISFIED:
        row[clause + WHEN] = row[STEP]
    return outcome


@device_function(force_inline=True)
def does(row: Row, clause: int, k: int, action: int) -> int:
    """Return the status that a step gives to a clause: WAITING, SATISFIED or BROKEN; record what the agent carries.

    ``clause`` is the index in the row at which the clause begins, and ``k`` is the clause's number.
    """
    verb = row[clause + VERB]
    strict = row[clause + STRICT]
    meant = 1 << 2 * k  # bit of the first description
    x, y = ahead(row[X], row[Y], row[DIRECTION])
    if verb == GO_TO:
        inside = x >= 0 and y >= 0 and x < row[WIDTH] and y < row[HEIGHT]
        if inside and row[noted_of(row) + x * row[HEIGHT] + y] & meant:
            return SATISFIED
        return WAITING
    if verb == OPEN:
        code = cell_at(row, x, y)
        if action != _TOGGLE or kind_of(code) != DOOR:
            return WAITING
        if state_of(code) == STANDS_OPEN and row[means_of(row) + identity_of(code) - 1] & meant:
            return SATISFIED
        return BROKEN if strict else WAITING
    carried = row[CARRYING]
    held_before = row[clause + HELD]
    row[clause + HELD] = identity_of(carried)
    if verb == PICK_UP:
        if action != _PICKUP or carried == EMPTY:
            return WAITING
        if held_before == 0 and row[means_of(row) + identity_of(carried) - 1] & meant:
            return SATISFIED
        return BROKEN if strict else WAITING
    if action == _PICKUP and strict and carried != EMPTY:
        return BROKEN
    if action != _DROP or held_before == 0 or not row[means_of(row) + held_before - 1] & meant:
        return WAITING
    cell = where_is(row, held_before)
    if cell != NOWHERE and is_beside(row, cell, meant << 1):
        return SATISFIED
    return WAITING


@device_function()
def is_beside(row: Row, cell: int, meant: int) -> bool:
    """Return whether an object was noted in one of the four cells next to a cell that matches a description ``meant``.

    Bit ``d`` of ``meant`` stands for description ``d``.
    """
    width = row[WIDTH]
    height = row[HEIGHT]
    noted = noted_of(row)
    x = cell // height
    y = cell % height
    return (
        (x + 1 < width and row[noted + cell + height] & meant != 0)
        or (y + 1 < height and row[noted + cell + 1] & meant != 0)
        or (x > 0 and row[noted + cell - height] & meant != 0)
        or (y > 0 and row[noted + cell - 1] & meant != 0)
    )


_NO_CHANCE = np.zeros(6, np.uint64)  # in place of the random stream


@kernel("(int32[::1], int64, uint64[::1], uint8[:, :, ::1])", hold_gil=True)
def step_instructed(row: Row, action: int, rng_state: RngState, image: NDArray[np.uint8]) -> tuple[int, int, float]:
    """Make one step and observe its result as `core.rules.step` does, in a row that has space for an instruction."""
    status, reward = act_instructed(row, action, rng_state)
    if status >= 0:
        see(row, image)
    return status, row[DIRECTION], reward


@kernel("(int32[::1], int64, uint64[::1])", hold_gil=True)
def act_instructed(row: Row, action: int, rng_state: RngState) -> tuple[int, float]:
    """Make one step as `core.rules.act` does, in a row that has space for an instruction; return status and reward."""
    return act_unedited(row, action, rng_state, False)


@device_function(force_inline=True)
def act_unedited(row: Row, action: int, rng_state: RngState, unedited: bool) -> tuple[int, float]:
    """Make one step as `act_instructed` does; return the status and the reward.

    If the row is ``unedited``, that is, changed by steps alone, places are recorded only when they can have changed.
    """
    if row[TASK] != INSTRUCTED:
        return act(row, action, rng_state)
    refused = refusal(row, action)
    if refused < 0:
        return refused, 0.0
    row[STEP] += 1
    noted = unedited and row[CARRYING] == EMPTY
    apply(row, action)
    outcome = verify(row, action, noted)
    reward = success_reward(row) if outcome == SATISFIED else 0.0
    return close(row, outcome != WAITING), reward


def try_action(row: Row, action: int) -> tuple[int, float]:
    """Take an action in a planner's copy of a state, which changes; return the status and the reward.

    The state must have no moving obstacles, as there is no random stream for them.
    """
    status, reward = (act_instructed if row[TASK] == INSTRUCTED else act)(row, action, _NO_CHANCE)
    return status, reward
