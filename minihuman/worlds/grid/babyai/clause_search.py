"""Best-first search for carrying out one clause under the world's own rules, and the distance heuristic that guides it.

The heuristic estimates from every pose how many actions a clause takes, including keys and locked doors. It is the
exact distance in a simplified world, computed backwards from the goal: nothing blocks the way (or it costs something to
pass), dropped objects vanish, and a key stays where it was. The states of that world are poses, the set of unlocked
doors, and the class of object in the agent's hand.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.babyai.encoding import (
    CLAUSE,
    CLAUSES,
    GO_TO,
    OPEN,
    PICK_UP,
    PUT_NEXT,
    STRICT,
    VERB,
    block_of,
    is_meant,
    means_of,
)
from minihuman.worlds.grid.core.cells import (
    BOX,
    CLOSED,
    DOOR,
    EMPTY,
    KEY,
    LAVA,
    LOCKED,
    WALL,
    ahead,
    can_be_carried,
    colour_of,
    identity_of,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.cells import OPEN as STANDS_OPEN
from minihuman.worlds.grid.core.rewards import DROP, FORWARD, PICKUP, TOGGLE, cell_in_front
from minihuman.worlds.grid.core.rules import apply
from minihuman.worlds.grid.core.search import (
    FAR,
    FOUND,
    FULL,
    LAST,
    NONE,
    actions_to_node,
    exhausted,
    load,
    object_codes,
    open_frontier,
    pop,
    push,
)
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
    contents_index,
    where_is,
)
from minihuman.worlds.kernels import device_function, kernel

MOST_LOCKS = 4  # further locked doors are treated as closed doors that are not locked
# classes of carried objects: none, any, an object to be put somewhere; from KEYS on, keys by the lock that they open
NOTHING = 0
OTHER = 1
MOVED = 2
KEYS = 3

Table = NDArray[np.int32]  # (sets of unlocked doors, classes in hand, poses); a pose is 4 * cell + direction
Locks = NDArray[np.int64]  # (locks, 2): identity of the door, its colour
Sorts = NDArray[np.int64]  # by identity - 1: the class of the object when it is carried


@kernel("(int32[::1],)")
def find_locks(row: Row) -> Locks:
    """Return the locked doors that a key fits, the first `MOST_LOCKS` of them, (locks, 2): identity and colour."""
    keys = key_colours(row)
    locks = np.zeros((MOST_LOCKS, 2), np.int64)
    count = 0
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell == NOWHERE or count == MOST_LOCKS:
            continue
        code = row[HEADER + cell]
        if kind_of(code) == DOOR and state_of(code) == LOCKED and keys >> colour_of(code) & 1:
            locks[count, 0] = identity
            locks[count, 1] = colour_of(code)
            count += 1
    return locks[:count].copy()


@device_function()
def key_colours(row: Row) -> int:
    """Return a number with bit ``1 << colour`` for each key's colour, in a cell, in the hand or in a box in a cell."""
    colours = 0
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE:
            if kind_of(row[HEADER + cell]) == KEY:
                colours |= 1 << colour_of(row[HEADER + cell])
            inside = row[contents_index(row, identity)]
            if inside != 0 and kind_of(inside) == KEY:
                colours |= 1 << colour_of(inside)
    if kind_of(row[CARRYING]) == KEY:
        colours |= 1 << colour_of(row[CARRYING])
    return colours


@kernel("(int32[::1], int64, int64[::1], int64[:, ::1])")
def sort_things(row: Row, clause: int, codes: NDArray[np.int64], locks: Locks) -> Sorts:
    """Return each object's class when it is carried, by identity - 1: OTHER, MOVED, or KEYS plus a lock's index.

    Args:
        row: the state.
        clause: the number of the clause; in a clause that puts an object next to another, objects to put are MOVED.
        codes: the code of each object, by identity - 1.
        locks: the locked doors, as `find_locks` returns them.
    """
    sorts = np.full(len(codes), OTHER, np.int64)
    verb = row[block_of(row) + CLAUSES + clause * CLAUSE + VERB]
    for k in range(len(codes)):
        code = int(codes[k])
        if verb > PICK_UP and is_meant(row[means_of(row) + k], clause):
            sorts[k] = MOVED
        elif kind_of(code) == KEY:
            for lock in range(len(locks)):
                if locks[lock, 1] == colour_of(code):
                    sorts[k] = KEYS + lock
                    break
    return sorts


@device_function()
def opens(row: Row, hand: int, lock: int, locks: Locks, sorts: Sorts, codes: NDArray[np.int64]) -> bool:
    """Return whether some object of the class ``hand`` is a key of the colour of the lock with the index ``lock``."""
    if hand >= KEYS:
        return locks[hand - KEYS, 1] == locks[lock, 1]
    if hand == MOVED:
        for k in range(len(codes)):
            if sorts[k] == MOVED and kind_of(int(codes[k])) == KEY and colour_of(int(codes[k])) == locks[lock, 1]:
                return True
    return False


@kernel("(int32[::1], int64, int64[::1], int64[:, ::1], int64[::1], boolean)")
def distance_heuristic(
    row: Row, clause: int, codes: NDArray[np.int64], locks: Locks, sorts: Sorts, careful: bool
) -> Table:
    """Return the number of actions to complete a clause from each state of the simplified world, FAR if impossible.

    With ``careful``, doors and objects in the way add what they usually take; otherwise no number is an overestimate.
    """
    width = np.int64(row[WIDTH])
    height = np.int64(row[HEIGHT])
    cells = width * height
    hands = KEYS + len(locks)
    sets = 1 << len(locks)
    steps = np.full((sets, hands, cells * 4), FAR, np.int32)
    span = 16  # more than the cost of any action: a ring of queues by distance
    queue = np.empty((span, steps.size), np.int32)
    waiting = np.zeros(span, np.int64)
    lock_at = np.full(cells, -1, np.int64)
    for lock in range(len(locks)):
        lock_at[where_is(row, locks[lock, 0])] = lock
    cost = np.ones(cells, np.int64)
    for cell in range(cells):
        code = row[HEADER + cell]
        kind = kind_of(code)
        if kind == WALL or kind == LAVA:
            cost[cell] = 0
        elif kind == DOOR and state_of(code) == LOCKED and lock_at[cell] < 0 and len(locks) < MOST_LOCKS:
            cost[cell] = 0  # no key opens it
        elif careful and kind == DOOR:
            cost[cell] = 2 if state_of(code) == CLOSED else 1
        elif careful and identity_of(code) > 0:
            cost[cell] = 5  # about as many actions as it takes to move an object out of the way
    goal(row, clause, codes, locks, sorts, cost, lock_at, steps)
    flat = steps.reshape(-1)
    at_most = 0
    for state in range(len(flat)):
        if flat[state] < FAR:
            queue[flat[state] % span, waiting[flat[state] % span]] = state
            waiting[flat[state] % span] += 1
            at_most = max(at_most, flat[state])
    distance = 0
    last = at_most
    while distance <= last:
        place = distance % span
        while waiting[place] > 0:
            waiting[place] -= 1
            state = queue[place, waiting[place]]
            if flat[state] != distance:
                continue
            pose = state % (cells * 4)
            hand = state // (cells * 4) % hands
            unlocked = state // (cells * 4 * hands)
            direction = pose & 3
            cell = pose >> 2
            x = cell // height
            y = cell % height
            base = state - pose
            for move in range(5 + hands + len(locks)):
                before = -1
                added = 1
                if move < 2:  # the action before was a turn, from the direction one further or three further
                    before = base + cell * 4 + ((direction + 1 + 2 * move) & 3)
                elif move == 2:  # a step forward
                    enters = cost[cell] > 0 and (lock_at[cell] < 0 or unlocked >> lock_at[cell] & 1)
                    from_x, from_y = ahead(x, y, direction ^ 2)
                    if enters and from_x >= 0 and from_y >= 0 and from_x < width and from_y < height:
                        behind = from_x * height + from_y
                        if cost[behind] > 0:
                            before = base + behind * 4 + direction
                            added = cost[cell]
                elif move == 3:  # picking up
                    if hand >= MOVED:
                        extra = lies_ahead(row, x, y, direction, hand, codes, locks, sorts)
                        if extra > 0:
                            before = state - hand * cells * 4
                            added = extra
                elif move == 4:  # would be dropping an object of class move - 5 = -1, which does not exist
                    continue
                elif move < 5 + hands:  # dropping an object of class move - 5
                    if hand == NOTHING and move > 5:
                        before = state + (move - 5) * cells * 4
                else:
                    lock = move - 5 - hands  # unlocking
                    i, j = ahead(x, y, direction)
                    next_cell = i * height + j
                    faced = next_cell >= 0 and next_cell < cells and lock_at[next_cell] == lock
                    if faced and unlocked >> lock & 1 and opens(row, hand, lock, locks, sorts, codes):
                        before = state - (1 << lock) * hands * cells * 4
                if before >= 0 and distance + added < flat[before]:
                    flat[before] = distance + added
                    slot = (distance + added) % span
                    if waiting[slot] < queue.shape[1]:
                        queue[slot, waiting[slot]] = before
                        waiting[slot] += 1
                    last = max(last, distance + added)
        distance += 1
    return steps


@device_function()
def lies_ahead(
    row: Row, x: int, y: int, direction: int, hand: int, codes: NDArray[np.int64], locks: Locks, sorts: Sorts
) -> int:
    """Return how many actions it takes to get an object of the class ``hand`` from the cell ahead of a pose.

    This is 1 for an object in the cell, 2 for one inside a box there, and 0 if the cell has no object of this class.
    """
    i, j = ahead(x, y, direction)
    if i < 0 or j < 0 or i >= row[WIDTH] or j >= row[HEIGHT]:
        return 0
    identity = identity_of(row[HEADER + i * row[HEIGHT] + j])
    if identity == 0:
        return 0
    if sorts[identity - 1] == hand and kind_of(int(codes[identity - 1])) != DOOR:
        return 1
    inside = row[contents_index(row, identity)]
    if inside != 0 and sorts[identity_of(inside) - 1] == hand:
        return 2
    return 0


@device_function()
def can_open(
    row: Row, code: int, lock: int, unlocked: int, hand: int, codes: NDArray[np.int64], locks: Locks, sorts: Sorts
) -> bool:
    """Return whether an agent can open a door in a state of the simplified world.

    Args:
        row: the state of the real world.
        code: the code of the door.
        lock: the index of the door's lock in ``locks``; -1 if it is not among them.
        unlocked: the locks that are unlocked, with bit ``1 << lock`` for each.
        hand: the class of the carried object.
        codes: the code of each object, by identity - 1.
        locks: the locked doors, as `find_locks` returns them.
        sorts: the class of each object, as `sort_things` returns it.
    """
    if lock >= 0 and unlocked >> lock & 1 == 0:
        return opens(row, hand, lock, locks, sorts, codes)
    return state_of(code) != LOCKED or lock >= 0


@device_function()
def goal(
    row: Row,
    clause: int,
    codes: NDArray[np.int64],
    locks: Locks,
    sorts: Sorts,
    cost: NDArray[np.int64],
    lock_at: NDArray[np.int64],
    steps: Table,
) -> None:
    """Set ``steps`` to 0 in the states that complete the clause, or to an action's cost where that action does so."""
    width = row[WIDTH]
    height = row[HEIGHT]
    verb = row[block_of(row) + CLAUSES + clause * CLAUSE + VERB]
    for x in range(width):
        for y in range(height):
            for direction in range(4):
                i, j = ahead(x, y, direction)
                if cost[x * height + y] == 0 or i < 0 or j < 0 or i >= width or j >= height:
                    continue
                pose = (x * height + y) * 4 + direction
                code = row[HEADER + i * height + j]
                identity = identity_of(code)
                meant = identity > 0 and is_meant(row[means_of(row) + identity - 1], clause)
                for unlocked in range(steps.shape[0]):
                    for hand in range(steps.shape[1]):
                        if verb == GO_TO:
                            if meant:
                                steps[unlocked, hand, pose] = 0
                        elif verb == OPEN:
                            if meant and kind_of(code) == DOOR:
                                lock = lock_at[i * height + j]
                                if can_open(row, code, lock, unlocked, hand, codes, locks, sorts):
                                    steps[unlocked, hand, pose] = 1
                        elif verb == PICK_UP:
                            if meant and hand == NOTHING:
                                steps[unlocked, hand, pose] = 1
                        else:
                            free = hand == MOVED and cost[i * height + j] > 0 and kind_of(code) != DOOR
                            if free and is_next_to(row, i, j, 2 << 2 * clause):
                                steps[unlocked, hand, pose] = cost[i * height + j]


@device_function()
def is_next_to(row: Row, x: int, y: int, meant: int) -> bool:
    """Return whether an object now lies next to the cell (x, y) that matches one of the descriptions ``meant``.

    Bit ``d`` of ``meant`` stands for description ``d``.
    """
    for k in range(4):
        i, j = ahead(x, y, k)
        if i >= 0 and j >= 0 and i < row[WIDTH] and j < row[HEIGHT]:
            identity = identity_of(row[HEADER + i * row[HEIGHT] + j])
            if identity > 0 and row[means_of(row) + identity - 1] & meant:
                return True
    return False


@kernel("(int32[::1],)")
def codes_of(row: Row) -> NDArray[np.int64]:
    """Return the code of each object, by identity - 1, wherever it is; 0 for an object that is gone."""
    return object_codes(row)


@device_function()
def is_done(row: Row, clause: int, action: int, held_before: int) -> bool:
    """Return whether the action that led to this state has completed a clause.

    ``held_before`` is the identity of the object in hand before the action, 0 for none.
    """
    at = block_of(row) + CLAUSES + clause * CLAUSE
    verb = row[at + VERB]
    meant = 1 << 2 * clause
    if verb == PICK_UP:
        carried = identity_of(row[CARRYING])
        return action == PICKUP and carried > 0 and row[means_of(row) + carried - 1] & meant != 0
    x, y = cell_in_front(row)
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


@device_function()
def may_help(row: Row, clause: int, action: int, last: int) -> bool:
    """Return whether the search for a plan of a clause tries an action in this state.

    It does not close doors, open boxes that a description matches, violate a strict clause, or pick up the object that
    was put down last (``last`` is its identity).
    """
    if action <= FORWARD:
        return True
    x, y = cell_in_front(row)
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        return False
    code = row[HEADER + x * row[HEIGHT] + y]
    at = block_of(row) + CLAUSES + clause * CLAUSE
    verb = row[at + VERB]
    strict = row[at + STRICT] != 0
    identity = identity_of(code)
    if identity > 0:
        means = row[means_of(row) + identity - 1]
    else:
        means = 0
    meant = is_meant(means, clause)
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


@device_function()
def heuristic_value(row: Row, table: Table, locks: Locks, sorts: Sorts) -> int:
    """Return the estimated number of actions from a state to the completion of the clause, FAR if it is impossible.

    ``table`` is the result of `distance_heuristic` for ``locks`` and ``sorts``.
    """
    unlocked = 0
    for lock in range(len(locks)):
        cell = where_is(row, locks[lock, 0])
        if cell != NOWHERE and state_of(row[HEADER + cell]) != LOCKED:
            unlocked |= 1 << lock
    carried = identity_of(row[CARRYING])
    hand = sorts[carried - 1] if carried > 0 else NOTHING
    return table[unlocked, hand, (row[X] * row[HEIGHT] + row[Y]) * 4 + row[DIRECTION]]


@kernel("(int32[::1], int32[:, :, ::1], int64[:, ::1], int64[::1])")
def heuristic_value_of(row: Row, table: Table, locks: Locks, sorts: Sorts) -> int:
    """Call `heuristic_value` from Python; return the estimated number of actions."""
    return heuristic_value(row, table, locks, sorts)


@kernel("(int32[::1], int64, int32[:, :, ::1], int64[:, ::1], int64[::1], int64, int64)")
def search_clause(
    start: Row, clause: int, table: Table, locks: Locks, sorts: Sorts, weight: int, limit: int
) -> tuple[int, NDArray[np.int64]]:
    """Search for actions that complete a clause.

    The list is the shortest one if the weight is 1 and the heuristic never overestimates. Otherwise it may be longer.

    Args:
        start: the state; it is not changed.
        clause: the number of the clause.
        table: the result of `distance_heuristic`; ``locks`` and ``sorts`` are those of `find_locks` and `sort_things`.
        weight: the factor by which the heuristic is multiplied; a larger one finds a list sooner.
        limit: the maximum number of states to store.

    Returns:
        FOUND and the actions; or no actions and NONE if none exist, or FULL if the search ran out of space.
    """
    row = start.copy()
    codes = object_codes(row)
    none = np.empty(0, np.int64)
    heuristic = heuristic_value(row, table, locks, sorts)
    if heuristic >= FAR:
        return NONE, none
    frontier = open_frontier(row, limit, weight * heuristic)
    node = pop(frontier)
    while node >= 0:
        for action in range(6):  # all but "done"
            load(row, frontier.nodes[node], codes)
            if not may_help(row, clause, action, frontier.nodes[node, LAST]):
                continue
            carried_before = identity_of(row[CARRYING])
            apply(row, action)
            if is_done(row, clause, action, carried_before):
                return FOUND, actions_to_node(frontier.parent, frontier.cause, node, action)
            heuristic = heuristic_value(row, table, locks, sorts)
            if not push(frontier, row, node, action, carried_before, heuristic, weight):
                return FULL, none
        node = pop(frontier)
    return exhausted(frontier), none
