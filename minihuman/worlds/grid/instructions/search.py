"""Best-first search for doing one clause on the world's own rules, guided by its outlook."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import BOX, DOOR, EMPTY, can_be_carried, identity_of, kind_of, state_of
from minihuman.worlds.grid.core.cells import OPEN as STANDS_OPEN
from minihuman.worlds.grid.core.rules import apply
from minihuman.worlds.grid.core.search import FAR, FOUND, FULL, NONE, actions_to, load, object_codes, slot, store
from minihuman.worlds.grid.core.state import (
    CARRYING,
    DIRECTION,
    HEADER,
    HEIGHT,
    NOWHERE,
    OBJECTS,
    WIDTH,
    Row,
    X,
    Y,
    where_is,
)
from minihuman.worlds.grid.core.tasks import DROP, FORWARD, PICKUP, TOGGLE, front
from minihuman.worlds.grid.instructions.block import (
    CLAUSE,
    CLAUSES,
    GO_TO,
    OPEN,
    PICK_UP,
    PUT_NEXT,
    STRICT,
    VERB,
    block_of,
    means_of,
)
from minihuman.worlds.grid.instructions.outlook import NOTHING, Locks, Sorts, Table, is_next_to
from minihuman.worlds.kernels import kernel, part

_LAST, _OBJECTS = 4, 5  # places in a node
MOST = 1 << 14  # of the worth of a node


@kernel()
def codes_of(row: Row) -> NDArray[np.int64]:
    """The code of each object, by identity - 1, wherever it is."""
    return object_codes(row)


@part()
def is_done(row: Row, clause: int, action: int, held_before: int) -> bool:
    """Whether a step has done what the clause says."""
    at = block_of(row) + CLAUSES + clause * CLAUSE
    verb = row[at + VERB]
    meant = 1 << 2 * clause
    if verb == PICK_UP:
        held = identity_of(row[CARRYING])
        return action == PICKUP and held > 0 and row[means_of(row) + held - 1] & meant != 0
    x, y = front(row)
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        return False
    code = row[HEADER + x * row[HEIGHT] + y]
    identity = identity_of(code)
    if identity == 0:
        return False
    fits = row[means_of(row) + identity - 1] & meant != 0
    if verb == GO_TO:
        return fits
    if verb == OPEN:
        return action == TOGGLE and fits and kind_of(code) == DOOR and state_of(code) == STANDS_OPEN
    return action == DROP and held_before == identity and fits and is_next_to(row, x, y, meant << 1)


@part()
def may_help(row: Row, clause: int, action: int, last: int) -> bool:
    """Whether to try an action: not to close a door, take up again what was just put down, or break what is meant."""
    if action <= FORWARD:
        return True
    x, y = front(row)
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        return False
    code = row[HEADER + x * row[HEIGHT] + y]
    at = block_of(row) + CLAUSES + clause * CLAUSE
    verb, strict = row[at + VERB], row[at + STRICT] != 0
    identity = identity_of(code)
    means = row[means_of(row) + identity - 1] if identity > 0 else 0
    meant = means >> 2 * clause & 1 != 0
    if action == PICKUP:
        if row[CARRYING] != EMPTY or not can_be_carried(code) or identity == last:
            return False
        return not strict or (verb != PUT_NEXT and (verb != PICK_UP or meant))
    if action == DROP:
        return row[CARRYING] != EMPTY and code == EMPTY
    if identity == 0:
        return False
    if kind_of(code) == BOX:
        return means == 0
    if verb == OPEN and (meant or strict):
        return meant
    return kind_of(code) == DOOR and state_of(code) != STANDS_OPEN


@part()
def worth(row: Row, table: Table, locks: Locks, sorts: Sorts) -> int:
    """What the outlook says of a state."""
    unlocked = 0
    for lock in range(len(locks)):
        cell = where_is(row, locks[lock, 0])
        if cell != NOWHERE and state_of(row[HEADER + cell]) != 2:
            unlocked |= 1 << lock
    held = identity_of(row[CARRYING])
    hand = sorts[held - 1] if held > 0 else NOTHING
    return table[unlocked, hand, (row[X] * row[HEIGHT] + row[Y]) * 4 + row[DIRECTION]]


@kernel()
def worth_of(row: Row, table: Table, locks: Locks, sorts: Sorts) -> int:
    """`worth`, for Python."""
    return worth(row, table, locks, sorts)


@kernel()
def search_clause(
    start: Row, clause: int, table: Table, locks: Locks, sorts: Sorts, weight: int, limit: int
) -> tuple[int, NDArray[np.int64]]:
    """Find actions that do a clause: the fewest with weight 1 and a table that never overestimates.

    Returns:
        FOUND and the actions, or NONE or FULL and no actions.
    """
    row = start.copy()
    codes = object_codes(row)
    none = np.empty(0, np.int64)
    nodes = np.empty((limit, _OBJECTS + row[OBJECTS]), np.int32)
    cost, parent, cause = np.empty(limit, np.int32), np.empty(limit, np.int32), np.empty(limit, np.int8)
    closed = np.zeros(limit, np.bool_)
    seen = np.full(4 * limit, -1, np.int32)
    bucket = np.full(MOST, -1, np.int64)
    entry_node, entry_next = np.empty(4 * limit, np.int32), np.empty(4 * limit, np.int64)
    store(row, nodes[0], 0)
    cost[0], parent[0], cause[0] = 0, -1, -1
    seen[slot(nodes, seen, 0)] = 0
    count = 1
    guess = worth(row, table, locks, sorts)
    if guess >= FAR:
        return NONE, none
    estimate = int(weight * guess)
    bucket[estimate] = 0
    entry_node[0], entry_next[0] = 0, -1
    entries = 1
    while estimate < MOST:
        if bucket[estimate] < 0:
            estimate += 1
            continue
        node = entry_node[bucket[estimate]]
        bucket[estimate] = entry_next[bucket[estimate]]
        if closed[node]:
            continue
        closed[node] = True
        for action in range(6):
            load(row, nodes[node], codes)
            last = nodes[node, _LAST]
            if not may_help(row, clause, action, last):
                continue
            held = identity_of(row[CARRYING])
            apply(row, action)
            if is_done(row, clause, action, held):
                return FOUND, actions_to(parent, cause, node, action)
            if count == limit or entries == len(entry_node):
                return FULL, none
            if action == DROP:
                last = held
            elif action == PICKUP:
                last = 0
            store(row, nodes[count], last)
            place = slot(nodes, seen, count)
            known = seen[place]
            if known < 0:
                known = count
                seen[place] = count
                count += 1
            elif closed[known] or cost[known] <= cost[node] + 1:
                continue
            cost[known], parent[known], cause[known] = cost[node] + 1, node, action
            guess = worth(row, table, locks, sorts)
            if guess < FAR:
                key = cost[known] + weight * guess
                if key < MOST:
                    entry_node[entries], entry_next[entries] = known, bucket[key]
                    bucket[key] = entries
                    entries += 1
                    estimate = min(estimate, key)
    return NONE, none
